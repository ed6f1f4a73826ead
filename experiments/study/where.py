"""Options of studies whose runs are rows: where they run, and whether they go on."""

from dataclasses import dataclass

from experiments.study.study import Option, WrongInput

PATIENCE_S = 300.0
"""How long a scheduler may be without workers; here, as the help text states it."""

SCHEDULER = Option(
    "scheduler",
    str | None,
    None,
    f"A Dask scheduler, e.g. tcp://host:8786; fails after {PATIENCE_S:g} s without a worker.  "
    "[default: processes on this computer]",
    "ADDRESS",
)
WHERE = (
    SCHEDULER,
    Option(
        "workers",
        int | None,
        None,
        "Processes on this computer.  [default: one for each core]",
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

    A `WrongInput` is raised if both are given, the address is none, or there are no workers.
    """

    scheduler: str | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.scheduler.split() != [self.scheduler]:
            raise WrongInput(
                f"--scheduler must be an address, as tcp://host:8786, got {self.scheduler!r}"
            )
        if self.workers is not None and self.workers < 1:
            raise WrongInput(f"--workers must be a number from 1 on, got {self.workers}")
        if self.scheduler and self.workers:
            raise WrongInput("--workers are processes on this computer: omit it with --scheduler")
