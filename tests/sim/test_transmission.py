"""Transmissions of every kind: the velocity of each, its dual force, and a simulation of it."""

from typing import NamedTuple

import mujoco
import numpy as np
import pytest
import scipy.linalg

from prioritized import ConstrainedSystem
from sim import Jacobians, assemble, jacobians
from tests.motions import motions

# A planar four-bar closed by a connect; on its coupler a tool on a ball joint, a free body pinned
# to it by another connect, and a spool geared to the knee. Seven freedoms.
LINKAGE = """
<mujoco>
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <worldbody>
    <site name="post" pos="0.1 0.1 0.5" euler="20 30 40"/>
    <site name="deck" pos="0.6 0 -0.2"/>
    <body name="crank">
      <joint name="crank" axis="0 1 0"/><geom size="0.05"/>
      <geom name="roll" pos="0.3 0 0.1" size="0.06"/><site name="side" pos="0.4 0 0.12"/>
      <body name="coupler" pos="0 0 0.3">
        <joint name="knee" axis="0 1 0"/><geom size="0.05"/>
        <site name="end" pos="0.3 0 0.1"/><site name="up" pos="0.1 0 0.1"/>
        <body name="wrist" pos="0.25 0 0.1">
          <joint name="wrist" type="ball"/><geom size="0.05"/>
          <site name="tool" pos="0.02 0.03 0.1"/>
        </body>
        <body name="spool"><joint name="spool" axis="1 0 0"/><geom size="0.05"/></body>
        <body name="rocker" pos="0.5 0 0">
          <joint name="elbow" axis="0 1 0"/><geom size="0.05"/>
        </body>
      </body>
    </body>
    <body name="float" pos="0.4 0 0.6">
      <freejoint name="float"/><geom size="0.05"/><site name="buoy" euler="30 20 10"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cable">
      <joint joint="crank" coef="0.3"/><joint joint="elbow" coef="-0.1"/>
      <joint joint="spool" coef="0.05"/>
    </fixed>
    <spatial name="hoist">
      <site site="post"/><site site="end"/><pulley divisor="2"/><site site="buoy"/>
      <site site="deck"/>
    </spatial>
    <spatial name="wrap">
      <site site="deck"/><geom geom="roll" sidesite="side"/><site site="up"/>
    </spatial>
  </tendon>
  <equality>
    <connect body1="rocker" anchor="0 0 -0.3"/>
    <connect body1="float" body2="coupler" anchor="0 0 -0.1"/>
    <joint joint1="spool" joint2="knee" polycoef="0 2 1 0 0"/>
  </equality>
  <actuator>{}</actuator>
</mujoco>
"""
FREEDOMS = 7


class Case(NamedTuple):
    """Actuators; of each velocity the name, the actuators that share it, and their gears."""

    mjcf: str
    drives: list[tuple[str, tuple[str, ...], tuple[float, ...]]]


WITH_LENGTH = {
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
}
WITHOUT_LENGTH = {  # or with one whose slope is not the velocity, as the rotation vector's
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
CASES = WITH_LENGTH | WITHOUT_LENGTH
every_kind = pytest.mark.parametrize("kind", CASES)


def mechanism(actuators: str, seed: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The linkage with these actuators, closed in a random pose."""
    model = mujoco.MjModel.from_xml_string(LINKAGE.format(actuators))
    data = mujoco.MjData(model)
    motion = 0.1 * np.random.default_rng(seed).normal(size=model.nv)
    mujoco.mj_integratePos(model, data.qpos, motion, 1.0)
    return model, assemble(model, data)


def along(
    model: mujoco.MjModel, data: mujoco.MjData, velocity: np.ndarray, h: float
) -> mujoco.MjData:
    """The state after a motion by h, loops closed again."""
    moved = mujoco.MjData(model)
    moved.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, moved.qpos, velocity[: model.nv], h)
    return assemble(model, moved)


def of_drives(model: mujoco.MjModel, jac: Jacobians, qvel: np.ndarray) -> np.ndarray:
    """Velocity of each drive under any qvel, whether it opens loops or not, by the rows of J_C."""
    extra = jac.J_C.shape[1] - model.nv
    own = jac.J_C[len(jac.J_C) - extra :]
    np.testing.assert_array_equal(own[:, model.nv :], -np.eye(extra))
    return np.append(qvel, own[:, : model.nv] @ qvel)[jac.active]


@every_kind
def test_each_velocity_is_known_by_its_name_its_actuators_and_their_gears(kind):
    """Actuators of one joint, of one tendon, or along one line share an active velocity."""
    model, data = mechanism(CASES[kind].mjcf)
    jac = jacobians(model, data, "tool")
    seen = [(drive.name, drive.actuators, drive.gear) for drive in jac.drives]
    assert seen == CASES[kind].drives
    assert jac.names.actuators == tuple(actuators for _, actuators, _ in seen)
    assert [jac.names.velocities[k] for k in jac.active] == [name for name, _, _ in seen]
    np.testing.assert_array_equal(jac.gear, [gear[0] for _, _, gear in seen])
    extra = [drive for drive in jac.drives if drive.joint is None]
    assert jac.J_T.shape == (6, model.nv + len(extra))
    assert len(set(jac.active.tolist())) == len(seen)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", WITH_LENGTH)
def test_the_velocity_is_the_slope_of_the_length_by_the_gear_along_the_closed_loops(kind, seed):
    model, data = mechanism(CASES[kind].mjcf, seed)
    jac = jacobians(model, data, "tool")
    Z = scipy.linalg.null_space(jac.J_C, rcond=1e-9)
    assert Z.shape[1] == FREEDOMS
    velocity = Z @ np.random.default_rng(seed).normal(size=FREEDOMS)
    velocity /= np.linalg.norm(velocity)

    if kind == "wrapping":
        assert data.ten_wrapnum[model.tendon("wrap").id] == 4  # two ends, and an arc on the sphere
    errors = []
    for h in (1e-2, 5e-3):
        there, back = (along(model, data, velocity, s) for s in (h, -h))
        slope = (there.actuator_length[0] - back.actuator_length[0]) / (2 * h * jac.gear[0])
        errors.append(abs(slope - velocity[jac.active[0]]))
    assert errors[1] < 2e-4  # of a unit velocity
    assert errors[1] < 0.3 * errors[0] + 1e-7  # central differences: the error falls as h^2


@every_kind
def test_the_velocity_is_mujocos_actuator_velocity_by_the_gear(kind):
    """For every actuator of a drive, and along every qvel, whether it opens loops or not."""
    model, data = mechanism(CASES[kind].mjcf)
    jac = jacobians(model, data, "tool")
    for qvel in np.random.default_rng(1).normal(size=(3, model.nv)):
        data.qvel[:] = qvel
        mujoco.mj_forward(model, data)
        rates = of_drives(model, jac, qvel)
        for rate, drive in zip(rates, jac.drives, strict=True):
            seen = data.actuator_velocity[list(drive.outputs)] / drive.gear
            np.testing.assert_allclose(seen, rate, rtol=1e-9, atol=1e-12)


@every_kind
def test_the_drives_do_the_power_of_the_actuators(kind):
    """Sum of gear force times velocity = qfrc_actuator . qvel: forces map by the transpose."""
    model, data = mechanism(CASES[kind].mjcf)
    jac = jacobians(model, data, "tool")
    rng = np.random.default_rng(2)
    for qvel in rng.normal(size=(3, model.nv)):
        data.qvel[:], data.ctrl[:] = qvel, rng.uniform(0.1, 1.0, size=model.nu)
        data.act[:] = rng.uniform(0.1, 1.0, size=model.na)
        mujoco.mj_forward(model, data)
        assert np.abs(data.actuator_force).min() > 1e-3
        forces = [drive.gear @ data.actuator_force[list(drive.outputs)] for drive in jac.drives]
        power = forces @ of_drives(model, jac, qvel)
        assert power == pytest.approx(data.qfrc_actuator @ qvel, rel=1e-9)


@pytest.mark.parametrize("at", ['site="tool"', 'site="tool" refsite="post"', 'joint="float"'])
@pytest.mark.parametrize("gear", ["-.6 .8 0 0 0 0", "0 0 -2 0 0 0", "0 0 0 0 -1 0", "0 -1 0 2 0 0"])
def test_along_a_direction_the_velocity_is_that_along_the_gear_of_the_first_actuator(at, gear):
    """Whatever the sign of its first component; a second one that pushes back has gear -3."""
    first, back = np.array(gear.split(), dtype=float), -3.0 * np.array(gear.split(), dtype=float)
    pair = f'<motor {at} gear="{gear}"/><motor {at} gear="{" ".join(map(str, back))}"/>'
    model, data = mechanism(pair)
    jac = jacobians(model, data, "tool" if "site" in at else "buoy")
    data.qvel[:] = np.random.default_rng(3).normal(size=model.nv)
    mujoco.mj_forward(model, data)
    size = np.linalg.norm(first)
    np.testing.assert_allclose(jac.gear, [size])
    rate = of_drives(model, jac, data.qvel)[0]
    assert rate == pytest.approx(data.actuator_velocity[0] / size, rel=1e-9)
    assert jac.drives[0].gear[1] == pytest.approx(-3.0 * size)


@pytest.mark.parametrize("tendon", ["cable", "hoist", "wrap"])
def test_a_locked_tendon_keeps_its_length_and_a_free_one_constrains_nothing(tendon):
    """Locked takes one freedom, free takes none, along every motion that the mappings know."""
    model, data = mechanism(f'<motor joint="crank"/><motor tendon="{tendon}" gear="2"/>')
    jac = jacobians(model, data, "tool")
    system = ConstrainedSystem(jac.J_T, jac.J_C, jac.active)
    length = model.tendon(tendon).id

    def slope(velocity: np.ndarray, h: float) -> float:
        there, back = (along(model, data, velocity, s) for s in (h, -h))
        return (there.ten_length[length] - back.ten_length[length]) / (2 * h)

    locked = motions(system.with_failures(locked=[1]).kinematics())
    assert locked.shape[1] == FREEDOMS - 1
    for velocity in locked.T / np.linalg.norm(locked, axis=0)[:, None]:
        coarse, fine = slope(velocity, 1e-2), slope(velocity, 5e-3)
        assert abs(fine) < 2e-4 and abs(fine) < 0.3 * abs(coarse) + 1e-7
    free = motions(system.with_failures(free=[1]).kinematics())
    assert free.shape[1] == FREEDOMS
    assert np.linalg.norm(free[jac.active[1]]) > 0.1
