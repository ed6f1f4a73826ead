"""A planar 3-RRR whose numbers are written with as many digits as wanted."""

from collections.abc import Callable

import mujoco
import numpy as np

from sim import Jacobians, jacobians

EXACT = (0, 0, 3)
"""Three freedoms, each driven: no self-motion, no constraint."""


def exact(x: float) -> str:
    return f"{x:.17g}"


def six_digits(x: float) -> str:
    return f"{x:.6g}"


def three_rrr(
    write: Callable[[float], str] = exact,
    axes: np.ndarray | None = None,
    base: str = "",
    driven: str = "",
) -> mujoco.MjModel:
    """A planar 3-RRR: seven hinges, two connects of which one row each is redundant.

    Axes are along z, or as given, shape (7, 3); `base` is the joint of the body that carries all.
    """
    axes = np.tile([0.0, 0.0, 1.0], (7, 1)) if axes is None else axes
    feet = np.array([[np.cos(a), np.sin(a)] for a in (0.5, 0.5 + 2.1, 0.5 + 4.1)]) * 0.87654321
    tips, knees = 0.3 * feet + 0.01234567, np.array([[0.8, 0.3], [-0.75, 0.25], [-0.1, -0.85]])

    def place(v: np.ndarray) -> str:
        return " ".join(map(write, (*v, 0.0)))

    def axis(k: int) -> str:
        return " ".join(map(exact, axes[k]))

    def leg(k: int, carried: str) -> str:
        return f"""
        <body name="thigh{k}" pos="{place(feet[k])}">
          <joint name="foot{k}" axis="{axis(2 * k)}"/><geom size="0.05"/>
          <body name="shank{k}" pos="{place(knees[k] - feet[k])}">
            <joint name="knee{k}" axis="{axis(2 * k + 1)}"/><geom size="0.05"/>{carried}
          </body>
        </body>"""

    platform = f"""
        <body name="platform" pos="{place(tips[0] - knees[0])}">
          <joint name="tip0" axis="{axis(6)}"/><geom size="0.05"/><site name="tool"/>
        </body>"""
    closures = "".join(
        f'<connect body1="shank{k}" body2="platform" anchor="{place(tips[k] - knees[k])}"/>'
        for k in (1, 2)
    )
    motors = "".join(f'<motor joint="foot{k}"/>' for k in range(3))
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option><flag contact="disable"/></option>
      <worldbody><body name="base">{base}<geom size="0.1"/>
        {leg(0, platform)}{leg(1, "")}{leg(2, "")}
      </body></worldbody>
      <equality>{closures}</equality><actuator>{motors}{driven}</actuator>
    </mujoco>""")


def taken(model: mujoco.MjModel) -> Jacobians:
    return jacobians(model, mujoco.MjData(model), "tool")
