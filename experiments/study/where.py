"""Options of studies whose runs are rows: where they run, and whether they go on."""

from experiments.study.study import Option

PATIENCE_S = 300.0
"""How long a scheduler may be without workers; here, as the help text states it."""

SCHEDULER = Option(
    "scheduler",
    str | None,
    None,
    f"A Dask scheduler, e.g. tcp://host:8786; fails after {PATIENCE_S:g} s without a worker.  "
    "[default: a cluster on this computer]",
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
