"""Machines shared by several test modules, in their start states."""

from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
import scipy.linalg

from sim import MODELS, Plant, assemble, linearize, load_model
from tests.models import model_of
from tests.motions import shifted

SHIPPED = "fjh", "arm", "arms", "hand", "platform"
"""Models of this repository that a plant can simulate."""
SPARSE = 'jacobian="dense"', 'jacobian="sparse"'
stored_options = pytest.mark.parametrize("storage", [(), (SPARSE,)], ids=["dense", "sparse"])


def state_at(model: mujoco.MjModel, **joints: object) -> mujoco.MjData:
    """Create a state with given positions of some joints."""
    data = mujoco.MjData(model)
    for name, value in joints.items():
        data.joint(name).qpos = value
    mujoco.mj_forward(model, data)
    return data


def open_state(model: mujoco.MjModel, size: float, seed: int = 0) -> mujoco.MjData:
    """Create a state a random step away from the default."""
    step = size * np.random.default_rng(seed).normal(size=model.nv)
    return shifted(model, mujoco.MjData(model), step)


def closed_state(model: mujoco.MjModel, seed: int = 0) -> mujoco.MjData:
    """Create a random state with closed loops."""
    return assemble(model, open_state(model, 0.1, seed))


def stretched(unit: float, bend: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Create two links of 0.3 and 0.25 units, nearly in line."""
    arm = mujoco.MjModel.from_xml_string(f"""
    <mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size="0.03" mass="1"/>
      <body pos="{0.3 * unit} 0 0"><joint name="b" axis="0 0 1"/><geom size="0.03" mass="1"/>
        <site name="tip" pos="{0.25 * unit} 0 0"/></body></body></worldbody>
      <actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>""")
    return arm, state_at(arm, b=bend)


TURN = np.array([2.0, -1.0, 2.0]) / 3.0
"""Axis about which the ball joint of `limited` is turned."""


def limited(hinge: float = 0.1, slide: float = 0.05, ball: float = 0.2) -> mujoco.MjData:
    """Create a state of three joints that have limits."""
    data = mujoco.MjData(model_of("limited"))
    data.qpos[:2] = hinge, slide
    mujoco.mju_axisAngle2Quat(data.qpos[2:], TURN, ball)
    return data


@cache
def humanoid() -> mujoco.MjModel:
    return load_model(MODELS / "humanoid.xml")


POSES = {
    "drives": {"shoulder": 0.4, "elbow": 0.5, "tube": 0.02, "lift": 0.05, "pin": 0.3},
    "squeezed_loop": {"left": 0.1, "elbow": 0.05},
}
"""Start positions of machines in `tests/models`."""
WORLD: dict[str, Any] = {"base": None, "payload": "tool"}


def started_model(name: str, *changes: tuple[str, str]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Load a model with locks, and a closed start."""
    model = model_of(name, *changes, add_locks=True)
    return model, assemble(model, state_at(model, **POSES[name]))


def plant_of(name: str, *changes: tuple[str, str]) -> Plant:
    """Create the plant of a model at its closed start."""
    model, start = started_model(name, *changes)
    return Plant(model, **WORLD, start=start)


def pendulum(actuators: str, joint: str = "", cable: str = "") -> mujoco.MjModel:
    """Create a pendulum with actuators, and attributes of its joint and cable."""
    kind, name = ("tendon", "c") if "tendon" in actuators else ("joint", "a")
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option gravity="0 0 0" timestep="1e-3"/>
      <worldbody><body name="arm"><joint name="a" axis="0 1 0" {joint}/>
      <geom size="0.05" mass="2" pos="0 0 -0.7"/><site name="tool" pos="0.1 0 -0.7"/></body>
      </worldbody><tendon><fixed name="c" {cable}><joint joint="a" coef="0.5"/></fixed></tendon>
      <equality><{kind} name="lock1" {kind}1="{name}" active="false"/></equality>
      <actuator>{actuators}</actuator></mujoco>""")


FREEDOMS = 7


class Case(NamedTuple):
    """Actuators, and the name, actuators and gears of each active velocity."""

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
    # Drives without a length, or with one whose slope is not the velocity (rotation vector).
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


def linkage(*changes: tuple[str, str], actuators: str = TWO) -> mujoco.MjModel:
    """Load the linkage with some actuators."""
    return model_of("linkage", ("<actuator/>", f"<actuator>{actuators}</actuator>"), *changes)


def mechanism(actuators: str, seed: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Load the linkage with some actuators, and a random closed state."""
    model = linkage(actuators=actuators)
    return model, closed_state(model, seed)


@cache
def mode_shapes() -> np.ndarray:
    """Return the six undamped modes (6, nv), orthonormal on the closed loops."""
    plant = Plant(load_model())
    stiffness = -linearize(plant.model, plant.data).A[6:, :6]
    values, vectors = map(np.real, np.linalg.eig(stiffness))
    Z = scipy.linalg.null_space(plant.data.efc_J.reshape(-1, plant.model.nv))
    return (Z @ vectors[:, np.argsort(values)]).T


@cache
def settled(seconds: float) -> Plant:
    """Return the settled hexapod, to be copied."""
    plant = Plant(load_model())
    plant.settle(seconds)
    return plant


def ring_down(model: mujoco.MjModel, shape: np.ndarray, seconds: float) -> np.ndarray:
    """Simulate free motion after a velocity along one mode; return its amplitude, (N,)."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qvel[:] = shape * 1e-3
    samples, step = [], np.empty(model.nv)
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_differentiatePos(model, step, 1.0, model.qpos0, data.qpos)
        samples.append(shape @ step)
    return np.array(samples)


def pole_of(samples: np.ndarray, dt: float) -> complex:
    """Fit y[k+1] = a y[k] + b y[k-1] to a decaying oscillation; return its continuous pole."""
    history = np.column_stack([samples[1:-1], samples[:-2]])
    a, b = np.linalg.lstsq(history, samples[2:], rcond=None)[0]
    return np.log(complex(max(np.roots([1.0, -a, -b]), key=np.imag))) / dt
