"""What rows depend on: the same for all workers, and when unfinished runs are resumed."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from experiments.study.provenance import code_sha256, versions
from experiments.study.study import WrongInput

Basis = dict[str, Any]

BASIS = "_basis.json"
"""A name that readers of Parquet datasets pass over."""


@dataclass(frozen=True)
class Sources:
    """Patterns of the files that rows depend on, below the project's root.

    Attributes:
        files: Sources that rows, or the bytes in which they are stored, depend on.
        without: Those among them that only distribute the runs, or describe and draw their rows.
    """

    files: tuple[str, ...]
    without: tuple[str, ...]


SHARED = Sources(
    (
        "argument_checks/**/*.py",
        "ftc/**/*.py",
        "models/*.xml",
        "prioritized/**/*.py",
        "sim/**/*.py",
        "experiments/rig/hexapod/**/*.py",
        "experiments/rig/mismatch.py",
        *(
            f"experiments/study/{name}.py"
            for name in ("basis", "campaign", "dataset", "draw", "parquet")
        ),
    ),
    (
        *(
            f"experiments/rig/hexapod/{name}.py"
            for name in ("animation", "drawing", "plots", "solids")
        ),
        "experiments/recording/*.py",
    ),
)
"""Of every study on the testbed."""


def sources_of(study: str, *, without: tuple[str, ...]) -> Sources:
    """Those of a study's folder beside the shared ones, without some of its modules."""
    own = f"experiments/{study}"
    left_out = tuple(f"{own}/{name}.py" for name in without)
    return Sources((*SHARED.files, f"{own}/*.py"), (*SHARED.without, *left_out))


@cache
def identity(sources: Sources) -> dict[str, str]:
    """Code, machine file and package versions of this process: equal wherever a run is equal."""
    from sim import model_sha256  # late: the help text does not wait for MuJoCo's import

    code = code_sha256(sources.files, sources.without)
    own = {"code_sha256": code, "model_sha256": model_sha256()}
    return own | {f"version of {name}": version for name, version in versions().items()}


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
        f"{path} {why}, so it is unknown to which study the runs in the folder belong; to "
        f"start again, remove {folder}"
    )


def check_same(former: Basis, basis: Basis, folder: Path) -> None:
    """Raise a `WrongInput` that names what has changed, if runs would not go on as they began."""
    changed = [name for name in basis if former.get(name) != basis[name]]
    if changed:
        raise WrongInput(
            f"--resume cannot continue the study in {folder}: it has another {', '.join(changed)}"
        )


def check_workers(ours: dict[str, str], answers: Mapping[str, dict[str, str] | Exception]) -> None:
    """Raise a `WrongInput` if a worker, by its address, has not the identity of this process."""
    for worker, theirs in answers.items():
        if isinstance(theirs, Exception):
            raise WrongInput(f"worker {worker} cannot run this package: {theirs}")
        names = [name for name, own in ours.items() if theirs.get(name) != own]
        if names:
            raise WrongInput(
                f"worker {worker} has another {', '.join(names)}: install the same release there"
            )
