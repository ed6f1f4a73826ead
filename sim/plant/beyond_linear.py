"""Effects that a file states, or that a run meets, and that are not in a linear model."""

from collections.abc import Callable, Iterable
from typing import Any

import mujoco
import numpy as np

from sim.array import Array
from sim.closing.equalities import equality_name
from sim.mjcf.limits import at_limits, touching
from sim.mjcf.locks import stiffness_of
from sim.mjcf.model import name_of
from sim.mjcf.part import Part
from sim.mjcf.transmission import drives
from sim.plant.friction import dry_friction

_STIFFNESS = 1 / (0.95 * 0.02) ** 2
"""Of MuJoCo's default `solref`, 20 ms critically damped, [1/s^2]."""
_SOFT = 0.1
"""Part of it below which an equality counts as soft."""
_AT = 1e-6
"""Part of a force range within which a force stands at its end."""


def beyond_linear(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, ...]:
    """What a file states that is not linear, besides contacts and limits, a sentence each.

    Args:
        model: Of the file.
        data: Which of its equalities are active.
    """
    found = []
    if names := dry_friction(model):
        found.append(
            f"dry friction of {', '.join(names)}: the prediction includes it, the diagnosis takes "
            "its size as uncertain; the design of the loops leaves it out"
        )
    for what, names in _curved(model).items():
        if names:
            found.append(
                f"{what} of {', '.join(names)} is not linear: the model has its slope at the start"
            )
    for k in np.flatnonzero(data.eq_active).tolist():
        if _is_soft(model, k):
            found.append(
                f"{equality_name(model, k)} is soft and gives like backlash: the model has it rigid"
            )
    if model.opt.density > 0:
        found.append(
            f"drag of a medium of density {model.opt.density:g} grows with the square of the speed:"
            " the model leaves it out"
        )
    return tuple(found)


def _curved(model: mujoco.MjModel) -> dict[str, list[str]]:
    """Names of joints, tendons and actuators with polynomial damping or stiffness."""
    of_joints = model.dof_jntid[np.flatnonzero(model.dof_dampingpoly.any(axis=1))]
    joints, tendons = model.joint, model.tendon
    return {
        "damping": [
            *_names(joints, dict.fromkeys(of_joints)),
            *_names(tendons, np.flatnonzero(model.tendon_dampingpoly.any(axis=1))),
            *_names(model.actuator, np.flatnonzero(model.actuator_dampingpoly.any(axis=1))),
        ],
        "stiffness": [
            *_names(joints, np.flatnonzero(model.jnt_stiffnesspoly.any(axis=1))),
            *_names(tendons, np.flatnonzero(model.tendon_stiffnesspoly.any(axis=1))),
        ],
    }


def _names(of_kind: Callable[[int], Any], numbers: Iterable[int]) -> list[str]:
    return [name_of(of_kind(int(k))) for k in numbers]


def _is_soft(model: mujoco.MjModel, equality: int) -> bool:
    """Whether it is much softer at its centre than equalities are by default."""
    stiffness = stiffness_of(model, equality) * model.eq_solimp[equality, 0]
    return bool(stiffness < _SOFT * _STIFFNESS)


class Met:
    """What a run meets that is not in a linear model: events of a :class:`sim.Bench`.

    Attributes:
        sentences: So far, each once.
    """

    def __init__(self, model: mujoco.MjModel, part: Part | None = None) -> None:
        """With a model of the plant, and what of it counts; None is everything."""
        self.sentences: dict[str, None] = {}
        self._part, among = part, None if part is None else part.actuators
        own = drives(model, among=among)
        self._forces = [(out, each.name) for each in own for out in each.outputs]

    def plant(self, tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Look at the end of the tick before."""
        if data.ncon:
            for a, b in touching(model, data):
                if self._part is None or set(model.body_weldid[[a, b]]) & self._part.bodies:
                    ends = (name_of(model.body(k)) for k in (b, a))
                    self._meet("{} touched {}".format(*(f'"{end}"' for end in ends)))
        if data.nl:
            for limit in at_limits(model, data):
                if self._part is None or limit.name not in self._part.left_out:
                    self._meet(f'{limit.kind} "{limit.name}" reached its limit')
        for output, name in self._forces:
            if model.actuator_forcelimited[output] and _at_end(
                data.actuator_force[output], model.actuator_forcerange[output]
            ):
                self._meet(f'the force of "{name}" reached its limit')

    def _meet(self, sentence: str) -> None:
        self.sentences.setdefault(sentence)


def _at_end(force: float, span: Array) -> bool:
    slack = _AT * (span[1] - span[0])
    return not span[0] + slack < force < span[1] - slack
