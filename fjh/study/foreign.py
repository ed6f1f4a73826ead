"""Files that anybody may have written: read whole, or refused in one sentence.

No pipe is waited for, nothing that a file holds is executed, and none fills the memory.
"""

import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fjh.study.errors import WrongInput
from fjh.study.spelling import LARGEST_FILE, check_file

if TYPE_CHECKING:  # the help text does not wait for NumPy's import
    from numpy.typing import NDArray


def read_json(path: Path) -> Any:
    """What a JSON file holds.

    Raises:
        WrongInput: It is no file, or none of JSON.
    """
    check_file(path)
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        raise WrongInput(f"{path} is not readable JSON") from None


def read_arrays(path: Path) -> "dict[str, NDArray[Any]]":
    """All arrays of an `.npz`; of objects, which may be programs, none is read.

    Raises:
        WrongInput: It is no such file, or unpacks to more than :data:`LARGEST_FILE`.
    """
    import numpy as np  # late, as above

    check_file(path)
    try:
        with zipfile.ZipFile(path) as packed:
            size = sum(each.file_size for each in packed.infolist())
        if size <= LARGEST_FILE:
            with np.load(path, allow_pickle=False) as file:
                # What is no array comes as bytes, which are none of objects either.
                return {name: np.asarray(file[name]) for name in file}
    except Exception:  # numpy and zipfile raise a dozen kinds, MemoryError among them
        raise WrongInput(f"{path} is not a readable .npz file") from None
    raise WrongInput(f"{path} unpacks to {size / 1e9:.3g} GB, expected at most 1")
