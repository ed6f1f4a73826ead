"""Transmissions of every kind on one linkage, `tests/models/linkage.xml`."""

from typing import NamedTuple

import mujoco

from tests.models import model
from tests.sim.machines import closed

FREEDOMS = 7


class Case(NamedTuple):
    """Actuators; of each velocity the name, the actuators that share it, and their gears."""

    mjcf: str
    drives: list[tuple[str, tuple[str, ...], tuple[float, ...]]]


CASES = {
    "hinge": Case('<motor name="m" joint="crank" gear="-50"/>', [("crank", ("m",), (-50.0,))]),
    "hinge in parent": Case('<motor name="m" jointinparent="knee"/>', [("knee", ("m",), (1.0,))]),
    "position and velocity servo": Case(
        '<position name="p" joint="crank" gear="2"/><velocity name="v" joint="crank" gear="3"/>',
        [("crank", ("p", "v"), (2.0, 3.0))],
    ),
    "muscles on a joint": Case(
        '<muscle name="a" joint="knee" gear="0.1" lengthrange="-1 1" force="9"/>'
        '<muscle name="b" joint="knee" gear="-0.2" lengthrange="-1 1" force="9"/>',
        [("knee", ("a", "b"), (0.1, -0.2))],
    ),
    "muscles on a tendon": Case(
        '<muscle name="a" tendon="cable" lengthrange="-1 1" force="9"/>'
        '<muscle name="b" tendon="cable" gear="-1" lengthrange="-1 1" force="9"/>',
        [("cable", ("a", "b"), (1.0, -1.0))],
    ),
    "fixed tendon": Case('<motor name="m" tendon="cable" gear="3"/>', [("cable", ("m",), (3.0,))]),
    "pulley": Case('<motor name="m" tendon="hoist" gear="-2"/>', [("hoist", ("m",), (-2.0,))]),
    "wrapping": Case('<motor name="m" tendon="wrap" gear="2"/>', [("wrap", ("m",), (2.0,))]),
    "slider-crank": Case(
        '<motor name="m" cranksite="end" slidersite="deck" cranklength="0.9" gear="2"/>',
        [("m", ("m",), (2.0,))],
    ),
    "site with refsite": Case(
        '<motor name="m" site="tool" refsite="post" gear="3 0 -4 0 0 0"/>', [("m", ("m",), (5.0,))]
    ),
    # Without a length, or with one whose slope is not the velocity, as the rotation vector's.
    "site": Case('<motor name="m" site="tool" gear="0 3 0 4 0 0"/>', [("m", ("m",), (5.0,))]),
    "turn of a site": Case(
        '<motor name="m" site="tool" refsite="post" gear="0 0 0 0 -1 0"/>', [("m", ("m",), (1.0,))]
    ),
    "thrusters": Case(
        '<motor name="a" site="buoy" gear="0 0 3 0 4 0"/>'
        '<motor name="b" site="buoy" gear="0 0 -6 0 -8 0"/>',
        [("a", ("a", "b"), (5.0, -10.0))],
    ),
    "thrusters that cross": Case(
        '<motor name="a" site="buoy" gear="0 0 3 0 4 0"/>'
        '<motor name="b" site="buoy" gear="0 0 3 0 -4 0"/>',
        [("a", ("a",), (5.0,)), ("b", ("b",), (5.0,))],
    ),
    "ball": Case('<motor name="m" joint="wrist" gear="2 -1 2"/>', [("m", ("m",), (3.0,))]),
    "ball, also in parent": Case(
        '<motor name="a" joint="wrist" gear="1 2 2"/>'
        '<motor name="b" jointinparent="wrist" gear="1 2 2"/>',
        [("a", ("a",), (3.0,)), ("b", ("b",), (3.0,))],
    ),
    "free": Case('<motor name="m" joint="float" gear="1 0 2 0 0 -2"/>', [("m", ("m",), (3.0,))]),
    "orientation servo": Case(
        '<orientation name="m" joint="wrist" kp="3"/><motor name="b" joint="crank" gear="7"/>',
        [("m", ("m",), (1.0,))] * 3 + [("crank", ("b",), (7.0,))],
    ),
}


TWO = '<motor name="m1" joint="crank" gear="-3"/><motor name="m2" jointinparent="knee"/>'


def linkage(actuators: str = TWO, *changes: tuple[str, str]) -> mujoco.MjModel:
    """The linkage with these actuators."""
    return model("linkage", ("<actuator/>", f"<actuator>{actuators}</actuator>"), *changes)


def mechanism(actuators: str, seed: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """And a random closed state."""
    of = linkage(actuators)
    return of, closed(of, seed)
