"""Options of studies whose runs are rows: where they run, and whether they go on."""

from dataclasses import dataclass

from experiments.study.interrupts import notice
from experiments.study.parallel import CORES
from experiments.study.study import Option, WrongInput

PATIENCE_S = 300.0
"""How long a scheduler may be without workers; here, as the help text states it."""

SCHEDULER = Option(
    "scheduler",
    str | None,
    None,
    f"A Dask scheduler, e.g. tls://host:8786; fails after {PATIENCE_S:g} s without a worker.  "
    "[default: processes on this computer]",
    "ADDRESS",
)
WHERE = (
    SCHEDULER,
    Option(
        "workers",
        int | None,
        None,
        "Processes on this computer, at most one for each core.  [default: as many]",
        "N",
    ),
    Option(
        "resume",
        bool,
        False,
        "Continue the unfinished runs in the folder; refused if their options or code differ.",
    ),
)


@dataclass(frozen=True)
class Where:
    """A Dask scheduler; if there is no address, processes of this machine, by default one a core.

    A notice is given of more workers than cores: there are no more, whose runs would wait for each
    other; a scheduler takes any number. A `WrongInput` is raised if both are given, the address is
    none, or there are no workers.
    """

    scheduler: str | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.scheduler.split() != [self.scheduler]:
            raise WrongInput(
                f"--scheduler must be an address, as tls://host:8786, got {self.scheduler!r}"
            )
        if self.workers is not None and self.workers < 1:
            raise WrongInput(f"--workers must be a number from 1 on, got {self.workers}")
        if self.scheduler and self.workers:
            raise WrongInput("--workers are processes on this computer: omit it with --scheduler")
        if (self.workers or 0) > CORES:
            notice(
                f"--workers {self.workers} are more than the cores: {CORES} are used; "
                "a Dask scheduler takes any number"
            )

    @property
    def processes(self) -> int:
        """How many are used, if they are of this machine."""
        return min(self.workers or CORES, CORES)
