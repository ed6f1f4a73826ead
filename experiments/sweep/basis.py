"""What the rows of a sweep depend on: the same for all its workers, and when it is resumed."""

import hashlib
import json
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from experiments.output.provenance import code_sha256, processor, versions
from experiments.output.study import WrongInput
from experiments.sweep.design import SweepRuns
from experiments.sweep.row import Row, row_of
from experiments.sweep.sweep_run import SweepRun
from sim import model_sha256

Basis = dict[str, Any]

ROWS_FROM = (
    "argument_checks/**/*.py",
    "ftc/**/*.py",
    "models/*.xml",
    "prioritized/**/*.py",
    "sim/**/*.py",
    "experiments/hexapod/**/*.py",
    "experiments/output/parquet.py",
    "experiments/sweep/*.py",
)
"""Sources that rows, or the bytes in which they are stored, depend on."""

NOT_FROM = (
    *(f"experiments/hexapod/{name}.py" for name in ("animation", "drawing", "plots", "solids")),
    "experiments/hexapod/recording/*.py",
    *(
        f"experiments/sweep/{name}.py"
        for name in ("__init__", "atlas", "cluster", "figure", "results", "runs", "words")
    ),
)
"""And those among them that only distribute the runs, or describe and draw their rows."""

BASIS = "_basis.json"
"""A name that readers of Parquet datasets pass over."""


@cache
def identity() -> dict[str, str]:
    """Code, machine file and package versions of this process: equal wherever a run is equal."""
    own = {"code_sha256": code_sha256(ROWS_FROM, NOT_FROM), "model_sha256": model_sha256()}
    return own | {f"version of {name}": version for name, version in versions().items()}


def basis_of(runs: SweepRuns) -> Basis:
    """All that the bytes of a dataset depend on; it is the same again when read from JSON."""
    basis = {
        "design": runs.design.as_json(),
        "seed": runs.seed,
        **identity(),
        "version of pyarrow": version("pyarrow"),
        "processor": processor(),
    }
    return json.loads(json.dumps(basis))


def digest(content: dict[str, Any]) -> str:
    """SHA-256 of a basis or an identity."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def basis_in(folder: Path) -> Basis | None:
    """Basis of the dataset in a folder; None if there is no dataset.

    Raises:
        WrongInput: There is one, but its basis is missing or cannot be read.
    """
    path = folder / BASIS
    try:
        basis = json.loads(path.read_bytes())
        if isinstance(basis, dict):
            return basis
        why = "is broken: it has no names"
    except FileNotFoundError:
        if not any(folder.glob("*.parquet")):
            return None
        why = "is missing"
    except OSError as error:
        why = f"cannot be read: {error.strerror}"
    except (ValueError, RecursionError):
        why = "is broken: it is not JSON"
    raise WrongInput(
        f"{path} {why}, so it is unknown to which sweep the runs in the folder belong; to "
        f"start again, remove {folder}"
    )


def check_same(former: Basis, basis: Basis, folder: Path) -> None:
    """Raise a `WrongInput` that names what has changed, if a sweep would not go on as it began."""
    changed = [name for name in basis if former.get(name) != basis[name]]
    if changed:
        raise WrongInput(
            f"--resume cannot continue the sweep in {folder}: it has another {', '.join(changed)}"
        )


def check_workers(answers: Mapping[str, dict[str, str] | Exception]) -> None:
    """Raise a `WrongInput` if a worker, by its address, has not the identity of this process."""
    for worker, theirs in answers.items():
        if isinstance(theirs, Exception):
            raise WrongInput(f"worker {worker} cannot run this package: {theirs}")
        names = [name for name, ours in identity().items() if theirs.get(name) != ours]
        if names:
            raise WrongInput(
                f"worker {worker} has another {', '.join(names)}: install the same release there"
            )


class ForeignWorker(RuntimeError):
    """A worker that would run other code: it joined the sweep later."""


def simulate(run: SweepRun, code: str) -> Row:
    """The row of a run, on a worker; `ForeignWorker` if its identity has not this digest."""
    if code != digest(identity()):
        host = platform.node()
        raise ForeignWorker(f"{host} has another version of this package, or of what it needs")
    return row_of(run)
