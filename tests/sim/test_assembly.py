"""Closure: assembled from afar, verdicts that no small gap changes, motion that stays closed."""

import re
import warnings

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from prioritized import ConstrainedSystem
from sim import (
    Body,
    ClosureError,
    Mechanism,
    ModelError,
    Pin,
    advance,
    assemble,
    jacobians,
    pose_error,
    pose_of,
)
from sim.mjcf import mass_matrix
from tests.sim.test_jacobian import everything

# A parallelogram in the plane, on a base that turns about an axis in that plane: of the connect's
# three rows one is redundant, and the base's hinge carries both ends of it.
PARALLELOGRAM = """
<mujoco>
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <default><geom type="capsule" size="0.01" mass="0.3"/></default>
  <worldbody>
    <body name="base">
      <joint name="base" axis="0 0 1"/><geom fromto="0 0 0 0.4 0 0"/>
      <body name="left"><joint name="left" axis="0 1 0"/><geom fromto="0 0 0 0 0 0.3"/>
        <body name="bar" pos="0 0 0.3"><joint name="bar" axis="0 1 0"/>
          <geom fromto="0 0 0 0.4 0 0"/><site name="tool" pos="0.2 0 0.1"/>
        </body>
      </body>
      <body name="right" pos="0.4 0 0">
        <joint name="right" axis="0 1 0"/><geom fromto="0 0 0 0 0 0.3"/>
      </body>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="bar" body2="right" anchor="0.4 0 0"/></equality>
  <actuator><motor name="turn" joint="base"/><motor name="swing" joint="left"/></actuator>
</mujoco>
"""

# A planar five-bar: two motors, a tool whose place has two freedoms.
FIVE_BAR = """
<mujoco>
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <default><geom type="capsule" size="0.01" mass="0.3"/><joint axis="0 0 1"/></default>
  <worldbody>
    <body name="a1" pos="-0.1 0 0"><joint name="left"/><geom fromto="0 0 0 -0.1 0.2 0"/>
      <body name="a2" pos="-0.1 0.2 0">
        <joint name="left_elbow"/><geom fromto="0 0 0 0.2 0.2 0"/>
      </body>
    </body>
    <body name="b1" pos="0.1 0 0"><joint name="right"/><geom fromto="0 0 0 0.1 0.2 0"/>
      <body name="b2" pos="0.1 0.2 0"><joint name="right_elbow"/><geom fromto="0 0 0 -0.2 0.2 0"/>
        <body name="wrist" pos="-0.2 0.2 0"><joint name="wrist"/><geom fromto="0 0 0 0 0.1 0"/>
          <site name="tool" pos="0 0.1 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="a2" body2="b2" anchor="0.2 0.2 0"/></equality>
  <actuator>
    <motor name="m1" joint="left"/><motor name="m2" joint="right"/><motor name="m3" joint="wrist"/>
  </actuator>
</mujoco>
"""


def model_of(xml: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(xml)


def opened(model: mujoco.MjModel, size: float, seed: int = 0) -> mujoco.MjData:
    data = mujoco.MjData(model)
    step = size * np.random.default_rng(seed).normal(size=model.nv)
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    return data


def moved(model: mujoco.MjModel, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    change = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, change, 1.0, start, end)
    return change


@pytest.mark.parametrize("storage", ["dense", "sparse"])
@pytest.mark.parametrize("seed", range(6))
def test_every_kind_of_closure_closes_from_afar(storage, seed):
    """Connects, a weld, a polynomial gear and a cable, 0.1 m and rad away in every joint."""
    model, _ = everything(storage)
    data = opened(model, 0.1, seed)
    before = data.qpos.copy()
    closed = assemble(model, data)
    gaps = closed.efc_pos[: closed.ne]
    assert np.abs(gaps).max() < 1e-10
    np.testing.assert_array_equal(data.qpos, before)
    assert jacobians(model, closed, "tool").closure_residual < 1e-10


def test_a_weld_is_closed_in_radians_whatever_its_torquescale():
    """At a torquescale of 1e-3 MuJoCo's own residual is a two-thousandth of the angle."""
    xml = """<mujoco><worldbody>
      <body name="a"><joint name="a" axis="0 0 1"/><geom size="0.1"/><site name="tool"/>
        <body name="b" pos="0 0 1"><joint name="b" axis="0 0 1"/><geom size="0.1"/></body></body>
      </worldbody>
      <equality><weld name="grip" body1="b" torquescale="1e-3"/></equality>
      <actuator><motor joint="a"/></actuator></mujoco>"""
    model = model_of(xml)
    data = mujoco.MjData(model)
    data.qpos[1] = 1e-4
    assert jacobians(model, data, "tool").closure_residual == pytest.approx(1e-4, rel=1e-6)
    closed = assemble(model, data)
    assert np.abs(closed.qpos).max() < 1e-10


def test_small_gaps_close_with_the_least_change_in_the_mass_metric():
    """The change is M-orthogonal to every motion that leaves the loops closed."""
    model = model_of(FIVE_BAR)
    data = opened(model, 1e-5)
    closed = assemble(model, data)
    change = moved(model, data.qpos, closed.qpos)
    J_C = jacobians(model, closed, "tool").J_C
    _, sigma, Vt = np.linalg.svd(J_C)
    Z = Vt[int((sigma > 1e-9).sum()) :].T
    M = mass_matrix(model, closed)
    assert np.abs(Z.T @ M @ change).max() < 1e-4 * np.linalg.norm(M @ change)
    assert np.linalg.norm(change) > 1e-6


@pytest.mark.parametrize("held", [["left"], [0], ["left", "right"]])
def test_held_joints_stay(held):
    model = model_of(FIVE_BAR)
    data = opened(model, 0.02)
    closed = assemble(model, data, held=held)
    for name in ("left", "right") if "right" in held else ("left",):
        assert closed.joint(name).qpos[0] == data.joint(name).qpos[0]


def test_what_cannot_close_is_named_with_its_gap():
    """With every joint held the pin stays open as it was; a loop of rods too short never closes."""
    model = model_of(FIVE_BAR)
    data = opened(model, 1e-3)
    every = [model.joint(k).name for k in range(model.njnt)]
    with pytest.raises(ClosureError, match='equality "pin" is open by') as raised:
        assemble(model, data, held=every)
    mujoco.mj_fwdPosition(model, data)
    assert raised.value.gap == pytest.approx(np.abs(data.efc_pos[:3]).max())

    short = model_of(FIVE_BAR)
    short.eq_data[0, :3] *= 0.1
    short.eq_data[0, 3:6] = [-0.01, -0.2, 0]
    with pytest.raises(ClosureError, match="hold or pin less, or begin nearer"):
        assemble(short, held=["left", "right"])


def test_an_unnamed_equality_is_called_by_what_it_ties():
    model = model_of(FIVE_BAR.replace('connect name="pin"', "connect"))
    with pytest.raises(ClosureError, match=r'equality 0 \(connect of "a2" and "b2"\) is open'):
        jacobians(model, opened(model, 0.01), "tool")


def test_jacobians_of_open_loops_are_refused_beyond_the_tolerance():
    model = model_of(FIVE_BAR)
    data = opened(model, 0.01)
    with pytest.raises(ClosureError, match=r"call sim\.assemble\(model, data\)"):
        jacobians(model, data, "tool")
    residual = jacobians(model, data, "tool", closure_tolerance=np.inf).closure_residual
    assert residual == pytest.approx(np.abs(data.efc_pos).max())


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 9e-4])
def test_verdicts_and_rates_depend_on_a_gap_by_no_more_than_its_size(gap):
    """A hinge that carries both ends of a pin cannot open it, however far apart they are."""
    model = model_of(PARALLELOGRAM)
    data = mujoco.MjData(model)
    data.joint("right").qpos[0] = gap / 0.3
    jac = jacobians(model, data, "tool")
    assert jac.closure_residual == pytest.approx(gap, rel=1e-2, abs=1e-15)
    assert np.abs(jac.J_C[:, model.joint("base").dofadr[0]]).max() < 1e-15
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
    assert kin.active_constraint.shape == (0, 2)
    assert kin.self_motion.shape == (6, 0)
    exact = jacobians(model, mujoco.MjData(model), "tool")
    J = ConstrainedSystem(exact.J_T, exact.J_C, exact.active).kinematics().J
    assert np.abs(kin.J - J).max() < 10 * gap + 1e-12


def test_welds_and_connects_between_sites_have_one_common_point_too():
    xml = PARALLELOGRAM.replace(
        '<connect name="pin" body1="bar" body2="right" anchor="0.4 0 0"/>',
        '<connect name="pin" site1="end" site2="top"/>'
        '<weld name="bond" body1="right" body2="far"/>',
    )
    xml = xml.replace('<site name="tool"', '<site name="end" pos="0.4 0 0"/><site name="tool"')
    xml = xml.replace(
        '<geom fromto="0 0 0 0 0 0.3"/>\n      </body>\n    </body>',
        '<geom fromto="0 0 0 0 0 0.3"/><site name="top" pos="0 0 0.3"/>\n      </body>\n'
        '<body name="far" pos="0.4 0 0.3"><joint name="ball" type="ball"/>'
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        '<geom fromto="0 0 0 0 0 0.1"/></body>\n    </body>',
    )
    model = model_of(xml)
    data = opened(model, 2e-4)
    J_C = jacobians(model, data, "tool").J_C
    assert J_C.shape == (9, model.nv)
    assert np.abs(J_C[:, model.joint("base").dofadr[0]]).max() < 1e-15


def circle(turn: float, radius_m: float = 0.02) -> np.ndarray:
    return radius_m * np.array([np.cos(turn) - 1.0, np.sin(turn), 0.0])


@pytest.mark.long
def test_ten_lines_follow_a_circle_of_20_mm_through_a_lock_within_a_micrometre():
    """The place of the tool is major; the motor of its wrist locks halfway round."""
    model = model_of(FIVE_BAR)
    data = assemble(model)
    start = pose_of(model, data, "tool").translation_m
    system = ConstrainedSystem.of(jacobians(model, data, "tool"))
    errors, wrist = [], 0.0
    for k, turn in enumerate(np.linspace(0, 2 * np.pi, 721)[1:]):
        if k == 360:
            system = system.with_failures(locked=["wrist"])
            wrist = data.joint("wrist").qpos[0]
        jac = jacobians(model, data, "tool")
        kin = system.at(jac.J_T, jac.J_C).kinematics()
        step = pose_error(model, data, "tool", start + circle(turn))[[3, 4]]
        rates = kin.velocity_mapping(major=[3, 4], joint_weight=np.ones(3))(step)
        data = advance(model, data, kin.velocities(rates), held=system.stuck)
        errors.append(
            np.linalg.norm(pose_of(model, data, "tool").translation_m - start - circle(turn))
        )
        assert k < 360 or data.joint("wrist").qpos[0] == wrist
    assert max(errors) < 1e-6


@pytest.mark.parametrize("size", [1e-10, 3e-10])
def test_gaps_about_as_large_as_the_tolerance_close(size):
    """Of 7 out of 300 such openings it was said that no pose nearby closes them."""
    model = model_of(PARALLELOGRAM)
    for seed in range(300):
        closed = assemble(model, opened(model, size, seed))
        assert np.abs(closed.efc_pos[: closed.ne]).max() < 1e-10


def test_the_error_of_an_advance_falls_with_the_square_of_the_step():
    model, data = everything()
    data = assemble(model, data)
    J_C = jacobians(model, data, "tool").J_C
    velocity = np.linalg.svd(J_C)[2][-1]
    errors = [
        np.linalg.norm(
            moved(model, data.qpos, advance(model, data, velocity, h).qpos) - h * velocity
        )
        for h in (1e-2, 5e-3)
    ]
    assert 3.0 < errors[0] / errors[1] < 5.0


def test_a_held_tendon_grows_as_commanded_and_not_at_all_when_stuck():
    """A cable over both elbows of the five-bar, whose length is no joint's position."""
    cable = """<tendon><fixed name="cable"><joint joint="left_elbow" coef="0.03"/>
      <joint joint="right_elbow" coef="-0.02"/></fixed></tendon>"""
    xml = FIVE_BAR.replace("<actuator>", cable + "<actuator>")
    xml = xml.replace('<motor name="m2" joint="right"/>', '<motor name="m2" tendon="cable"/>')
    model = model_of(xml)
    data = assemble(model)
    kin = ConstrainedSystem.of(jacobians(model, data, "tool")).kinematics()
    velocity = kin.velocities([0.05, 1e-3, 0.0])
    there = advance(model, data, velocity, held=["cable", "left", "wrist"])
    assert there.ten_length[0] - data.ten_length[0] == pytest.approx(1e-3, abs=1e-12)
    stuck = kin.velocities([0.05, 0.0, 0.0])
    there = advance(model, data, stuck, held=["cable"])
    assert there.ten_length[0] == pytest.approx(data.ten_length[0], abs=1e-10)


def planar_linkage(accuracy: float) -> str:
    """The five-bar with axes and anchors off by random angles and lengths of this size."""
    rng = np.random.default_rng(3)
    xml = FIVE_BAR.replace(' axis="0 0 1"', "")
    for name in ("left", "left_elbow", "right", "right_elbow"):
        axis = " ".join(map(str, [*rng.normal(size=2) * accuracy, 1.0]))
        xml = xml.replace(f'<joint name="{name}"', f'<joint axis="{axis}" name="{name}"')
    place = " ".join(map(str, np.array([0.2, 0.2, 0.0]) + accuracy * rng.normal(size=3)))
    return xml.replace('anchor="0.2 0.2 0"', f'anchor="{place}"')


@pytest.mark.parametrize("accuracy", [1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 5e-6])
def test_a_planar_mechanism_goes_its_way_although_its_axes_are_not_quite_parallel(accuracy):
    """Gaps that no motion closes stay, of the size of the inaccuracy; the path is followed."""
    model = model_of(planar_linkage(accuracy))
    known = {"geometry_accuracy": 3 * accuracy}
    data = assemble(model, **known)
    start = pose_of(model, data, "tool").translation_m
    system = ConstrainedSystem.of(jacobians(model, data, "tool"), **known)
    for turn in np.linspace(0, 2 * np.pi, 181)[1:]:
        jac = jacobians(model, data, "tool")
        assert jac.closure_residual < max(1e-10, 10 * accuracy)
        kin = system.at(jac.J_T, jac.J_C).kinematics()
        step = pose_error(model, data, "tool", start + circle(turn))[[3, 4]]
        rates = kin.velocity_mapping(major=[3, 4], joint_weight=np.ones(3))(step)
        data = advance(model, data, kin.velocities(rates), **known)
    there = pose_of(model, data, "tool").translation_m
    assert np.linalg.norm((there - start)[:2]) < 1e-5 + 20 * accuracy


def test_what_the_numbers_of_a_model_show_needs_no_statement():
    """Components of 1e-7 in its axes: the mechanism assembles and moves by itself."""
    model = model_of(planar_linkage(0.0))
    model.joint("left").axis, model.joint("right_elbow").axis = [1e-7, 0, 1], [0, 2e-7, 1]
    data = opened(model, 0.02)
    data = assemble(model, data)
    kin = ConstrainedSystem.of(jacobians(model, data, "tool")).kinematics()
    assert kin.active_constraint.shape == (0, 3)
    before = data.qpos.copy()
    data = advance(model, data, kin.velocities([0.01, 0.0, 0.0]), held=["left"])
    assert moved(model, before, data.qpos)[0] == pytest.approx(0.01)
    assert 1e-12 < jacobians(model, data, "tool").closure_residual < 1e-6


def test_a_ball_joint_stuck_about_one_axis_keeps_its_rate_there():
    """Far from its nominal turn, where the length of its actuator is no coordinate of that rate."""
    xml = FIVE_BAR.replace(
        '<joint name="wrist"/><geom fromto="0 0 0 0 0.1 0"/>',
        '<joint name="wrist" type="ball"/><geom fromto="0 0 0 0 0.1 0.02"/>',
    ).replace(
        '<motor name="m3" joint="wrist"/>',
        '<motor name="mx" joint="wrist" gear="1 0 0"/><motor name="my" joint="wrist" gear="0 1 0"/>'
        '<motor name="mz" joint="wrist" gear="0 0 1"/>',
    )
    model = model_of(xml)
    data = mujoco.MjData(model)
    data.joint("wrist").qpos = Rotation.from_rotvec([1.0, -0.8, 1.2]).as_quat(scalar_first=True)
    data = assemble(model, data)
    system = ConstrainedSystem.of(jacobians(model, data, "tool")).with_failures(locked=["mz"])
    kin = system.kinematics()
    rates = kin.velocity_mapping(major=[3, 4, 5], joint_weight=np.ones(4))([1e-3, 5e-4, -5e-4])
    velocity = kin.velocities(rates)
    there = advance(model, data, velocity, held=system.stuck)
    change = moved(model, data.qpos, there.qpos)
    assert np.abs(change - velocity[: model.nv]).max() < 1e-2 * np.abs(velocity).max()


STANDING = """
<mujoco>
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <default><geom type="capsule" size="0.01" mass="0.3"/></default>
  <worldbody>
    <body name="trunk"><freejoint name="float"/><geom fromto="-0.2 0 0 0.2 0 0" mass="2"/>
      <site name="trunk"/>
      <body name="thigh1" pos="-0.2 0 0"><joint name="hip1" axis="0 1 0"/>
        <geom fromto="0 0 0 -.1 0 -.3"/>
        <body name="shin1" pos="-0.1 0 -0.3"><joint name="knee1" axis="0 1 0"/>
          <geom fromto="0 0 0 0.1 0 -0.3"/><site name="foot1" pos="0.1 0 -0.3"/></body></body>
      <body name="thigh2" pos="0.2 0 0"><joint name="hip2" axis="0 1 0"/>
        <geom fromto="0 0 0 .1 0 -.3"/>
        <body name="shin2" pos="0.1 0 -0.3"><joint name="knee2" axis="0 1 0"/>
          <geom fromto="0 0 0 -0.1 0 -0.3"/><body name="foot2" pos="-0.1 0 -0.3"/></body></body>
    </body>
  </worldbody>
  <actuator>
    <motor name="h1" joint="hip1"/><motor name="k1" joint="knee1"/>
    <motor name="h2" joint="hip2"/><motor name="k2" joint="knee2"/>
  </actuator>
</mujoco>
"""
FEET = [Pin("foot1", weld=True), Pin(Body("foot2"))]


def test_feet_that_stand_stay_where_they_are_while_the_trunk_moves():
    model = model_of(STANDING)
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    feet = pose_of(model, data, "foot1"), pose_of(model, data, Body("foot2"))
    height = pose_of(model, data, "trunk").translation_m[2]
    for _ in range(20):
        jac = jacobians(model, data, "trunk", pinned=FEET)
        kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
        mapping = kin.velocity_mapping(major=[5], joint_weight=np.ones(4))
        assert mapping.status.name == "EXACT"
        rates = mapping([-1e-3])
        data = advance(model, data, kin.velocities(rates), pinned=FEET)
    there = pose_of(model, data, "foot1"), pose_of(model, data, Body("foot2"))
    np.testing.assert_allclose(there[0].translation_m, feet[0].translation_m, atol=1e-9)
    np.testing.assert_allclose(there[0].rotation, feet[0].rotation, atol=1e-9)
    np.testing.assert_allclose(there[1].translation_m, feet[1].translation_m, atol=1e-9)
    lowered = pose_of(model, data, "trunk").translation_m[2] - height
    assert lowered == pytest.approx(-0.02, rel=2e-2)


def test_a_held_free_joint_and_names_that_do_not_exist():
    model = model_of(STANDING)
    closed = assemble(model, held=["float"], pinned=["foot1"])
    np.testing.assert_array_equal(closed.qpos[:7], model.qpos0[:7])
    with pytest.raises(
        ModelError, match=r'held: the model has no joint "hip"; did you mean "hip[12]"\?'
    ):
        assemble(model, held=["hip"])
    with pytest.raises(ModelError, match='no site named "foot"'):
        assemble(model, pinned=["foot"])
    with pytest.raises(TypeError, match="held must be a list"):
        assemble(model, held="hip1")
    with pytest.raises(ModelError, match=r"held must lie in 0\.\.9, got 10"):
        assemble(model, held=[10])
    with pytest.raises(
        ValueError, match=r"velocity must have shape \(N,\), N at least 10, got \(3,\)"
    ):
        advance(model, closed, np.zeros(3))


def test_the_hexapod_assembles_onto_its_closed_form(model):
    """A pose of the payload held, the struts take the lengths of the closed form."""
    data = mujoco.MjData(model)
    joint = model.joint("payload")
    turn = Rotation.from_rotvec([1e-3, -2e-3, 5e-4]).as_quat(scalar_first=True)
    data.qpos[joint.qposadr[0] + 3 : joint.qposadr[0] + 7] = turn
    closed = assemble(model, data, held=["payload"])
    np.testing.assert_array_equal(closed.joint("payload").qpos, data.joint("payload").qpos)
    assert np.abs(closed.efc_pos[: closed.ne]).max() < 1e-10


def stretched(unit: float, bend: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Two links of 0.3 and 0.25 units, nearly in line."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size="0.03" mass="1"/>
      <body pos="{0.3 * unit} 0 0"><joint name="b" axis="0 0 1"/><geom size="0.03" mass="1"/>
        <site name="tip" pos="{0.25 * unit} 0 0"/></body></body></worldbody>
      <actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0, bend
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_step_that_misses_its_way_says_so_and_by_how_much_to_shorten_it(unit):
    """Along a nearly stretched arm joints turn far for a little way: the rest is curvature."""
    for bend, step, misses in ((0.004, -1e-4, True), (0.004, -1e-7, False), (1.0, -1e-2, False)):
        model, data = stretched(unit, bend)
        kin = ConstrainedSystem.of(jacobians(model, data, "tip")).kinematics()
        motion = kin.velocities(kin.velocity_mapping([3, 4])([step * unit, 0.0]))
        with warnings.catch_warnings(record=True) as given:
            warnings.simplefilter("always")
            advance(model, data, motion)
        assert len(given) == misses
        if misses:
            part = float(str(given[0].message).split("at most ")[1].split()[0])
            there = advance(model, data, part * motion)
            off = there.site("tip").xpos - data.site("tip").xpos - [part * step * unit, 0.0, 0.0]
            assert np.linalg.norm(off) < 0.25 * part * abs(step) * unit


@pytest.mark.parametrize(("offset", "is_dropped"), [(2e-6, False), (9e-7, True), (0.0, False)])
def test_an_offset_that_mujoco_drops_is_warned_of(offset, is_dropped):
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size="0.03" mass="1"/>
      <site name="tip" pos="0 0 0.1"/><site name="near" pos="{offset} 0 0"/></body></worldbody>
      <actuator><motor joint="a"/></actuator></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (data.site("near").xpos[0] != offset) == is_dropped
    said = jacobians(model, data, "tip").warnings
    assert ["near" in sentence for sentence in said] == [True] * is_dropped


def crane(L: float) -> mujoco.MjModel:
    """A box that hangs on a rod by a weld, on a slide that a gear couples; in 1/L of a metre."""
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><compiler angle="radian"/><worldbody>
      <body pos="{0.3 * L} 0 0"><joint name="lift" type="slide" axis="0 0 1"/>
        <geom size="{0.05 * L}" mass="1"/>
        <body name="arm" pos="0 0 {0.4 * L}"><joint name="swing" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 {0.5 * L} 0 0" size="{0.02 * L}" mass="1"/>
          <site name="end" pos="{0.5 * L} 0 0"/></body></body>
      <body name="box" pos="{0.8 * L} 0 {0.4 * L}"><freejoint name="box"/>
        <geom type="box" size="{0.1 * L} {0.1 * L} {0.05 * L}" mass="2"/><site name="top"/></body>
      <body pos="{0.9 * L} 0 0"><joint name="weight" type="slide" axis="0 0 1"/>
        <geom size="{0.05 * L}" mass="1"/></body>
    </worldbody>
    <tendon><fixed name="rope">
      <joint joint="lift" coef="1"/><joint joint="weight" coef="1"/></fixed></tendon>
    <equality><weld site1="end" site2="top"/><tendon tendon1="rope"/></equality>
    <actuator><position joint="lift"/></actuator></mujoco>""")


@pytest.mark.parametrize("L", [1e-3, 1.0, 1e3, 1e4])
def test_in_any_unit_of_length_the_same_pose_is_closed_to_a_part_of_the_own_length(L):
    """From half a length off; a weld, a slide, a coupling of slides and a pinned frame."""
    model = crane(L)
    data = mujoco.MjData(model)
    data.joint("lift").qpos = 0.3 * L
    data.joint("swing").qpos = 0.4
    data.joint("weight").qpos = 0.6 * L
    data.joint("box").qpos[:3] += np.array([-0.4, 0.3, 0.5]) * L
    closed = assemble(model, data, pinned=["end"])
    mujoco.mj_kinematics(model, data)
    end, top, was = (one.xpos for one in (closed.site("end"), closed.site("top"), data.site("end")))
    assert np.abs(end - top).max() < 1e-9 * L
    assert np.abs(end - was).max() < 1e-9 * L
    np.testing.assert_allclose(closed.site("end").xmat, closed.site("top").xmat, atol=1e-9)
    assert abs(closed.joint("lift").qpos[0] + closed.joint("weight").qpos[0]) < 1e-9 * L


KEYED = """
<mujoco><compiler angle="radian"/><worldbody><body><joint name="joint1" axis="0 0 1"/>
  <geom size="0.03" mass="1"/><body pos="0.3 0 0"><joint name="joint2" axis="0 0 1"/>
  <geom size="0.03" mass="1"/><site name="payload" pos="0.3 0 0"/></body></body></worldbody>
<actuator><position joint="joint1" kp="9"/><position joint="joint2" kp="9"/></actuator>
<keyframe><key name="home" qpos="0.3 0.8"/><key name="away" qpos="0.1 2.0"/></keyframe></mujoco>"""


def test_without_a_state_a_model_starts_at_its_first_keyframe():
    """As a rig does: at qpos0 this arm is stretched and cannot move along itself."""
    model = model_of(KEYED)
    start = assemble(model)
    np.testing.assert_array_equal(start.qpos, [0.3, 0.8])
    report = ConstrainedSystem.of(jacobians(model, start, "payload")).kinematics()
    assert not report.manipulability(major=[3, 4]).unmanipulable
    nominal = Mechanism(model, site="payload").nominal
    np.testing.assert_array_equal(nominal.qpos, start.qpos)
    given = mujoco.MjData(model)
    np.testing.assert_array_equal(assemble(model, given).qpos, model.qpos0)
    plain = model_of(re.sub("<keyframe>.*</keyframe>", "", KEYED))
    np.testing.assert_array_equal(assemble(plain).qpos, model.qpos0)
