"""A scheduler without workers: said at once, waited for, and given up."""

from typing import TYPE_CHECKING

from experiments.output.study import Unsound, WrongInput
from experiments.output.terminal import notice

if TYPE_CHECKING:  # the help text need not wait for Dask's import
    from distributed import Client

PATIENCE_S = 300.0
"""So long a scheduler may be without workers."""

GONE = "the scheduler has gone; finished runs are kept, and --resume goes on"


def wait_for_worker(client: "Client") -> None:
    """Return as soon as the scheduler has a worker.

    Raises:
        WrongInput: It has had none for `PATIENCE_S`.
        Unsound: It has gone.
    """
    try:
        if client.scheduler_info(n_workers=0)["n_workers"]:
            return
        notice(f"the scheduler has no workers; waiting up to {PATIENCE_S:g} s for one")
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        raise WrongInput(
            f"the scheduler has had no workers for {PATIENCE_S:g} s: start some with dask worker; "
            "finished runs are kept, and --resume goes on"
        ) from None
    except (OSError, KeyError):
        raise Unsound(GONE) from None
