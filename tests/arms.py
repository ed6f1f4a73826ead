"""MJCF of three arms: links are rods from joint to joint; servos are those of MuJoCo Menagerie.

Modified Denavit-Hartenberg rows as the makers publish them (Universal Robots, KUKA, Franka Emika),
masses of data sheets and identifications (Gaz et al. 2019 for the Panda).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

_THICKNESS_M, _ARMATURE = 0.06, 0.1


@dataclass(frozen=True)
class Arm:
    """Arm whose tool is `flange` beyond its last joint; rows are a and d [m] and alpha [deg]."""

    rows: Sequence[tuple[float, float, float]]  # a and alpha before a joint, d along it
    flange: float
    mass: Sequence[float]
    home: Sequence[float]
    servos: Sequence[tuple[float, float, float]]  # kp, kv and largest torque

    def write(self, file: Path, joint: str = "") -> Path:
        """Return the arm as MJCF; `joint` has further attributes of all joints."""
        ends = [np.array(_offset(row)) for row in self.rows[1:]] + [np.array([0, 0, self.flange])]
        bodies = ""
        for k, (row, mass, end) in enumerate(zip(self.rows, self.mass, ends, strict=True), 1):
            inertia = mass * (float(end @ end) / 12 + _THICKNESS_M**2 / 2)
            bodies += (
                f'<body pos="{_listed(_offset(row))}" euler="{row[1]} 0 0">'
                f'<inertial pos="{_listed(end / 2)}" mass="{mass}" '
                f'diaginertia="{inertia:.6g} {inertia:.6g} {inertia:.6g}"/>'
                f'<joint name="joint{k}" axis="0 0 1" armature="{_ARMATURE}" {joint}/>'
            )
        bodies += f'<site name="tool" pos="0 0 {self.flange}"/>' + "</body>" * len(self.rows)
        servos = "".join(
            f'<position name="servo{k}" joint="joint{k}" kp="{kp}" kv="{kv}" '
            f'forcerange="{-most} {most}"/>'
            for k, (kp, kv, most) in enumerate(self.servos, 1)
        )
        home = _listed(self.home)
        file.write_text(
            '<mujoco><option integrator="implicitfast"/><statistic extent="1"/>'
            f"<worldbody>{bodies}</worldbody><actuator>{servos}</actuator>"
            f'<keyframe><key name="home" qpos="{home}" ctrl="{home}"/></keyframe></mujoco>'
        )
        return file


def _offset(row: tuple[float, float, float]) -> tuple[float, float, float]:
    a, alpha, d = row[0], np.deg2rad(row[1]), row[2]
    return a, -float(np.sin(alpha)) * d, float(np.cos(alpha)) * d


def _listed(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)


ARMS = {
    "ur5e": Arm(
        rows=[
            *[(0, 0, 0.1625), (0, 90, 0), (-0.425, 0, 0)],
            *[(-0.3922, 0, 0.1333), (0, 90, 0.0997), (0, -90, 0.0996)],
        ],
        flange=0.05,
        mass=[3.761, 8.058, 2.846, 1.37, 1.3, 0.365],
        home=[-1.5708, -1.5708, 1.5708, -1.5708, -1.5708, 0],
        servos=[(2000, 400, 150)] * 3 + [(500, 100, 28)] * 3,
    ),
    "iiwa14": Arm(
        rows=[
            *[(0, 0, 0.36), (0, -90, 0), (0, 90, 0.42), (0, 90, 0)],
            *[(0, -90, 0.4), (0, -90, 0), (0, 90, 0.126)],
        ],
        flange=0.045,
        mass=[5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2],
        home=[0, 0.785398, 0, -1.5708, 0, 0.785398, 0],
        servos=[(2000, 200, 300)] * 7,
    ),
    "panda": Arm(
        rows=[
            *[(0, 0, 0.333), (0, -90, 0), (0, 90, 0.316), (0.0825, 90, 0)],
            *[(-0.0825, -90, 0.384), (0, 90, 0), (0.088, 90, 0)],
        ],
        flange=0.107,
        mass=[4.97, 0.65, 3.23, 3.59, 1.23, 1.67, 0.74],
        home=[0, 0, 0, -1.57079, 0, 1.57079, -0.7853],
        servos=[*[(4500, 450, 87)] * 2, *[(3500, 350, 87)] * 2, *[(2000, 200, 12)] * 3],
    ),
}
