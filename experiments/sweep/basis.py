"""What the numbers of a sweep depend on: a dataset goes on only with what it was begun with."""

import hashlib
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa

from experiments.output.provenance import processor
from experiments.output.study import WrongInput
from experiments.sweep.design import Cases
from experiments.sweep.identity import identity

Basis = dict[str, Any]

BASIS = "_basis.json"
"""A name that readers of Parquet datasets pass over."""

OF = "basis_sha256"
"""Key in the metadata of a Parquet file: the digest of the basis that its rows are of."""


def basis_of(cases: Cases) -> Basis:
    """All that the bytes of a dataset depend on; as JSON it is the same again."""
    basis = {
        "design": cases.design.as_json(),
        "seed": cases.seed,
        **identity(),
        "version of pyarrow": version("pyarrow"),
        "processor": processor(),
    }
    return json.loads(json.dumps(basis))


def basis_in(folder: Path) -> Basis | None:
    """What the dataset in a folder belongs to; None if there is none.

    Raises:
        WrongInput: There is one, but nothing says what it belongs to.
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
        f"{path} {why}, and nothing else says which sweep the runs beside it are of; to begin "
        f"anew, remove {folder}"
    )


def check_same(former: Any, basis: Basis, folder: Path) -> None:
    """Whether a sweep goes on as it began.

    Raises:
        WrongInput: It does not; the message says what has changed.
    """
    changed = [name for name in basis if former.get(name) != basis[name]]
    if changed:
        raise WrongInput(
            f"--resume cannot go on with the sweep in {folder}: it has another {', '.join(changed)}"
        )


def digest(basis: Basis) -> str:
    """The basis in 64 letters."""
    return hashlib.sha256(json.dumps(basis, sort_keys=True).encode()).hexdigest()


def is_of(schema: pa.Schema, basis: Basis) -> bool:
    """Whether the rows of a Parquet file with this schema say that they are of the basis."""
    return (schema.metadata or {}).get(OF.encode()) == digest(basis).encode()
