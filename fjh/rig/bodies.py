"""Names of a model and of its bodies."""

from pathlib import Path

import mujoco

_USUAL = "MuJoCo Model"
"""MuJoCo's name of a model whose file states none."""


def model_name(model: mujoco.MjModel, file: Path) -> str:
    """Return the file's name of the model in one printable line, or the name of the file."""
    stated = model.names.split(b"\0", 1)[0].decode(errors="replace")
    name = " ".join("".join(c if c.isprintable() else " " for c in stated).split())
    return file.stem if name in ("", _USUAL) else f"{name:.80}"


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body in a recording, its number if it has no name."""
    return model.body(body).name or f"body_{body}"
