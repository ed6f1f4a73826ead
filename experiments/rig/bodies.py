"""Bodies of a model by name."""

import mujoco


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Of a body in a recording, also of one that has none."""
    return model.body(body).name or f"body_{body}"
