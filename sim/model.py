"""Loading MJCF models and finding their elements by name."""

import copy
import hashlib
import math
from pathlib import Path

import mujoco

from sim.errors import ModelError

# The rooms are neighbours in a checkout and in site-packages alike.
HEXAPOD_MJCF = Path(__file__).parents[1] / "models" / "fjh.xml"


def load_model(path: str | Path | None = None) -> mujoco.MjModel:
    """Compile an MJCF file; without a path, the hexapod `models/fjh.xml`.

    Raises:
        ModelError: The file is missing or not valid MJCF, or its time step is not positive.
    """
    file = _file(path)
    if not file.is_file():
        raise ModelError(f"there is no MJCF file {file}")
    try:
        model = mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise ModelError(f"{file} is not a valid MJCF model: {reason}") from None
    if not 0 < model.opt.timestep < math.inf:  # MuJoCo takes any
        raise ModelError(f"{file}: timestep must be positive and finite, got {model.opt.timestep}")
    return model


def weightless(model: mujoco.MjModel) -> mujoco.MjModel:
    """The machine in orbit: no gravity, and springs without the preload that carried the weight."""
    orbiting = copy.copy(model)
    orbiting.opt.gravity[:] = 0.0
    orbiting.qpos_spring[:] = orbiting.qpos0
    return orbiting


def model_sha256(path: str | Path | None = None) -> str:
    """SHA-256 of the MJCF file, so that a result names the machine it came from."""
    return hashlib.sha256(_file(path).read_bytes()).hexdigest()


def element_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Id of a named element; `kind` as in MJCF: "site", "joint", "body", "equality", "actuator".

    Raises:
        ModelError: There is none of that name; the message lists those there are.
    """
    try:
        return getattr(model, kind)(name).id
    except KeyError:
        count = {"joint": model.njnt, "equality": model.neq, "actuator": model.nu}
        number = count.get(kind, getattr(model, f"n{kind}", 0))
        names = [getattr(model, kind)(k).name for k in range(number)]
        present = ", ".join(filter(None, names)) or "none"
        raise ModelError(f'the model has no {kind} named "{name}"; it has: {present}') from None


def _file(path: str | Path | None) -> Path:
    return HEXAPOD_MJCF if path is None else Path(path)
