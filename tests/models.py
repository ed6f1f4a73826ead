"""Models for tests, `tests/models/*.xml`, each with a comment on its purpose."""

import copy
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

FOLDER = Path(__file__).with_suffix("")


def text(name: str, *changes: tuple[str, str]) -> str:
    """Return the text of a model file with replacements, each of which must apply."""
    content = (FOLDER / f"{name}.xml").read_text()
    for old, new in changes:
        assert old in content, old
        content = content.replace(old, new)
    return content


def saved(folder: Path, name: str, *changes: tuple[str, str]) -> Path:
    """Write the text of a model with replacements to a folder."""
    file = folder / f"{name}.xml"
    file.write_text(text(name, *changes))
    return file


def model_of(name: str, *changes: tuple[str, str], add_locks: bool = False) -> "mujoco.MjModel":
    """Return a copy of a model, compiled once, with locks added by `load_model` on request."""
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
