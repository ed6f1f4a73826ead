"""Models for tests, `tests/models/*.xml`: a comment in each says what it is for."""

import copy
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

FOLDER = Path(__file__).with_suffix("")


def text(name: str, *changes: tuple[str, str]) -> str:
    """The file, with words replaced, each of which must be there."""
    found = (FOLDER / f"{name}.xml").read_text()
    for old, new in changes:
        assert old in found, old
        found = found.replace(old, new)
    return found


def saved(folder: Path, name: str, *changes: tuple[str, str]) -> Path:
    """A file of this text in a folder."""
    file = folder / f"{name}.xml"
    file.write_text(text(name, *changes))
    return file


def model(name: str, *changes: tuple[str, str], add_locks: bool = False) -> "mujoco.MjModel":
    """The model, compiled once, as it is or as `load_model` adds locks: who asks gets a copy."""
    return copy.copy(_compiled(text(name, *changes), add_locks))


@cache
def _compiled(xml: str, add_locks: bool) -> "mujoco.MjModel":
    import mujoco

    from sim import load_model

    if not add_locks:
        return mujoco.MjModel.from_xml_string(xml)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.xml"
        file.write_text(xml)
        return load_model(file, add_locks=True)
