"""Readers of untrusted files, which return the complete contents or raise one sentence.

The readers do not wait for pipes, execute no content, and limit the memory.
"""

import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fjh.study.errors import WrongInput
from fjh.study.input_checks import LARGEST_FILE, check_file

if TYPE_CHECKING:  # the help text must not depend on the slow import of NumPy
    from numpy.typing import NDArray


def read_json(path: Path) -> Any:
    """Return the contents of a JSON file.

    Raises:
        WrongInput: The file does not exist, or is not JSON.
    """
    check_file(path)
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise WrongInput(f"{path} is not readable JSON") from None


def read_arrays(path: Path) -> "dict[str, NDArray[Any]]":
    """Return all arrays of an `.npz` file, without unpickling objects, which could execute code.

    Raises:
        WrongInput: The file is no `.npz`, or unpacks to more than :data:`LARGEST_FILE` bytes.
    """
    import numpy as np  # late, as above

    check_file(path)
    try:
        with zipfile.ZipFile(path) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
        if size <= LARGEST_FILE:
            with np.load(path, allow_pickle=False) as file:
                # Entries that are no arrays come as bytes, which are no objects either.
                return {name: np.asarray(file[name]) for name in file}
    except Exception:  # numpy and zipfile raise a dozen kinds, MemoryError among them
        raise WrongInput(f"{path} is not a readable .npz file") from None
    raise WrongInput(f"{path} unpacks to {size / 1e9:.3g} GB, expected at most 1")
