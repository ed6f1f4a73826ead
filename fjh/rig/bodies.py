"""Names of a model and of its bodies."""

from pathlib import Path

import mujoco

_USUAL = "MuJoCo Model"
"""Of a file that states no name."""


def model_name(model: mujoco.MjModel, file: Path) -> str:
    """What the file calls the model, in one printable line; else the name of the file."""
    stated = model.names.split(b"\0", 1)[0].decode(errors="replace")
    name = " ".join("".join(c if c.isprintable() else " " for c in stated).split())
    return file.stem if name in ("", _USUAL) else f"{name:.80}"


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Of a body in a recording, also of one that has none."""
    return model.body(body).name or f"body_{body}"
