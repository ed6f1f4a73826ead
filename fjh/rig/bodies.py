"""Names of a model and of its bodies."""

from pathlib import Path

import mujoco

_USUAL = "MuJoCo Model"
"""Name that MuJoCo gives a model whose file has no name."""


def model_name(model: mujoco.MjModel, file: Path) -> str:
    """Return a model's name in one printable line, or its file's name if the model has none."""
    stated = model.names.split(b"\0", 1)[0].decode(errors="replace")
    name = " ".join("".join(c if c.isprintable() else " " for c in stated).split())
    return file.stem if name in ("", _USUAL) else f"{name:.80}"


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body in a recording, its number if it has no name."""
    return model.body(body).name or f"body_{body}"
