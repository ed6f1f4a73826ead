"""Random mechanisms of six actuators: a tick whose loops tie rates together, and classification.

Nothing of another library does the same, so these are compared with a tick of square loops.
"""

from collections.abc import Callable

import numpy as np

from experiments.benchmark.measurement import Contender, Entry
from prioritized import ConstrainedSystem
from sim import Array

_ACTUATORS, _PASSIVE, _MAJOR = 6, 6, (0, 1)
_FLAGS = (
    *("unmanipulable", "unmanipulable_task", "unstable", "irresolvable"),
    "constrained_active",
)
_LOOPS = {"square": _PASSIVE, "tied": _PASSIVE + 2}
"""Rows of J_C: as many as passive velocities, or two more."""


def entry(rng: np.random.Generator) -> Entry:
    """Kinematics with a mapping for each kind of loops; and kinematics with classification."""
    N, found = _ACTUATORS + _PASSIVE, []
    for name, rows in _LOOPS.items():
        given = [
            (rng.normal(size=(6, N)), rng.normal(size=(rows, N)), rng.normal(size=2))
            for _ in range(16)
        ]
        system = ConstrainedSystem(*given[0][:2], active=np.arange(_ACTUATORS))
        found.append(_contender(f"{name}_loops", _tick(system), given))
        if name == "square":
            found.append(_contender("manipulability", _classification(system), given))
    return Entry(found)


def _contender(name: str, call: Callable[..., object], given: list[tuple[Array, ...]]) -> Contender:
    return Contender(name, call, lambda: given, units=len(given), samples=5)


def _tick(system: ConstrainedSystem) -> Callable[[Array, Array, Array], Array]:
    mapping = system.kinematics().velocity_mapping(_MAJOR, joint_weight=np.ones(_ACTUATORS))
    return lambda J_T, J_C, v: mapping.at(system.at(J_T=J_T, J_C=J_C).kinematics())(v)


def _classification(system: ConstrainedSystem) -> Callable[[Array, Array, Array], object]:
    def flags(J_T: Array, J_C: Array, _: Array) -> list[bool]:
        report = system.at(J_T=J_T, J_C=J_C).kinematics().manipulability(_MAJOR)
        return [getattr(report, flag) for flag in _FLAGS]

    return flags
