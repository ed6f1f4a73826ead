"""Jacobians of any MJCF: against finite differences on the manifold, and what is refused."""

import mujoco
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from fjh.rig.hexapod.closed_form import hexapod
from prioritized import ConstrainedSystem
from sim import (
    Body,
    CenterOfMass,
    ClosureError,
    JacobianReader,
    ModelError,
    Plant,
    Pose,
    assemble,
    jacobians,
    linearize,
)
from sim.mjcf import joint_stiffness, mass_matrix

# A planar four-bar closed by a connect: three closure rows of rank two.
FOUR_BAR = """
<mujoco>
  <option jacobian="{storage}"><flag contact="disable"/></option>
  <worldbody>
    <site name="ground" euler="20 30 40"/>
    <body name="crank">
      <joint name="crank" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.01"/>
      <body name="coupler" pos="0 0 0.3">
        <joint name="knee" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.01"/>
        <site name="tool" pos="0.25 0 0.1"/>
        <body name="rocker" pos="0.5 0 0">
          <joint name="elbow" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect body1="rocker" anchor="0 0 -0.3"/></equality>
  <actuator><motor name="drive" joint="crank" gear="50"/></actuator>
</mujoco>
"""

SERIAL = """
<mujoco>
  <worldbody>
    <body><joint name="a" axis="0 0 1"/><geom size="0.1"/>
      <body pos="0.4 0 0"><joint name="b" type="{kind}" axis="0 1 0"/><geom size="0.1"/>
        <site name="tool" pos="0.3 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m1" joint="a"/><motor name="m2" joint="{second}"/></actuator>
</mujoco>
"""

# Every kind of joint and of closure at once, on tilted ground: a free platform on two spherical
# legs and a universal one, a free payload welded to it, two legs coupled by a quadratic gear, the
# third by a cable to a drum.  Frictions, limits and contacts are there to be left out.
EVERYTHING = """
<mujoco>
  <option jacobian="{storage}"/>
  <default><geom contype="0" conaffinity="0" mass="1"/></default>
  <worldbody>
    <body name="ground" euler="20 30 40">
      <site name="ground"/>
      <body name="leg1" pos="0.3 0 0">
        <joint name="ball1" type="ball"/><geom size="0.02"/>
        <body name="rod1" pos="0 0 0.4">
          <joint name="slide1" type="slide" axis="-0.2 0 1" frictionloss="2"/><geom size="0.02"/>
        </body>
      </body>
      <body name="leg2" pos="-0.15 0.26 0">
        <joint name="hinge_x" axis="1 0 0"/><joint name="hinge_y" axis="0 1 0"/><geom size="0.02"/>
        <body name="rod2" pos="0 0 0.4">
          <joint name="slide2" type="slide" axis="0 -0.2 1"/><geom size="0.02"/>
        </body>
      </body>
      <body name="leg3" pos="-0.15 -0.26 0">
        <joint name="ball3" type="ball"/><geom size="0.02"/>
        <body name="rod3" pos="0 0 0.4">
          <joint name="slide3" type="slide" axis="0 0.2 1"/><geom size="0.02"/>
        </body>
      </body>
      <body name="drum" pos="0 0 -0.1">
        <joint name="drum" axis="1 1 0" limited="true" range="40 50"/><geom size="0.02"/>
      </body>
    </body>
    <body name="platform" pos="0.1 -0.1 0.4" euler="10 0 20">
      <freejoint/><geom type="box" size="0.1 0.1 0.02" contype="1" conaffinity="1"/>
    </body>
    <body name="payload" pos="0.1 -0.1 0.43">
      <freejoint/><geom type="box" size="0.05 0.05 0.02" contype="1" conaffinity="1"/>
      <site name="tool" pos="0.02 0.03 0.1"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cable"><joint joint="slide3" coef="1"/><joint joint="drum" coef="-0.05"/></fixed>
  </tendon>
  <equality>
    <connect name="pin1" body1="platform" body2="rod1" anchor="0.2 0 0"/>
    <connect name="pin2" body1="rod2" body2="platform" anchor="0 0 0"/>
    <connect name="pin3" body1="platform" body2="rod3" anchor="-0.1 -0.17 0"/>
    <weld name="grip" body1="payload" body2="platform" torquescale="0.3"/>
    <joint name="gear" joint1="slide1" joint2="slide2" polycoef="0 1.5 2 0 0"/>
    <tendon name="reel" tendon1="cable"/>
    <joint name="brake" joint1="drum" active="false"/>
  </equality>
  <actuator>
    <motor name="m1" joint="slide1" gear="-3"/>
    <motor name="m2" jointinparent="hinge_y" gear="0.5"/>
  </actuator>
</mujoco>
"""
ROWS, FREEDOMS = 3 * 3 + 6 + 1 + 1, 7


def everything(storage: str = "dense") -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(EVERYTHING.format(storage=storage))
    return model, mujoco.MjData(model)


def gaps(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """How far each closure is open, row by row."""
    mujoco.mj_fwdPosition(model, data)
    return data.efc_pos[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)].copy()


def move(model: mujoco.MjModel, data: mujoco.MjData, step: np.ndarray) -> None:
    mujoco.mj_integratePos(model, data.qpos, step, 1.0)


def close(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    data.qpos[:] = assemble(model, data).qpos
    assert np.abs(gaps(model, data)).max() < 1e-10


def random_closed_pose(model: mujoco.MjModel, data: mujoco.MjData, seed: int) -> None:
    move(model, data, 0.1 * np.random.default_rng(seed).normal(size=model.nv))
    close(model, data)


@pytest.mark.parametrize("storage", ["dense", "sparse"])
@pytest.mark.parametrize("seed", range(4))
def test_the_task_jacobian_is_the_slope_of_the_tools_pose_along_the_closed_loops(storage, seed):
    """Move along the null space of J_C, close the loops again, and see where the tool went."""
    model, data = everything(storage)
    random_closed_pose(model, data, seed)
    jac = jacobians(model, data, "tool", "ground")
    Z = scipy.linalg.null_space(jac.J_C)
    assert Z.shape == (model.nv, FREEDOMS)
    velocity = Z @ np.random.default_rng(seed).normal(size=FREEDOMS)
    velocity /= np.linalg.norm(velocity)
    here = data.qpos.copy()
    to_ground = data.site("ground").xmat.reshape(3, 3).T

    def pose(h: float) -> tuple[Rotation, np.ndarray]:
        data.qpos[:] = here
        move(model, data, h * velocity)
        close(model, data)
        tool = data.site("tool")
        return Rotation.from_matrix(to_ground @ tool.xmat.reshape(3, 3)), to_ground @ tool.xpos

    errors = []
    for h in (4e-3, 2e-3):
        (turn, place), (turn_back, place_back) = pose(h), pose(-h)
        change = np.concatenate([(turn * turn_back.inv()).as_rotvec(), place - place_back])
        errors.append(np.linalg.norm(change / (2 * h) - jac.J_T @ velocity))
    assert errors[1] < 1e-4  # of a unit velocity
    assert errors[1] < 0.3 * errors[0] + 1e-9  # central differences: the error falls as h^2


@pytest.mark.parametrize("storage", ["dense", "sparse"])
@pytest.mark.parametrize("seed", range(4))
def test_the_rows_of_the_closures_are_the_slopes_of_their_gaps(storage, seed):
    """At a closed pose, along every velocity, admissible or not."""
    model, data = everything(storage)
    random_closed_pose(model, data, seed)
    J_C = jacobians(model, data, "tool").J_C
    assert J_C.shape == (ROWS, model.nv)
    here = data.qpos.copy()

    def opening(step: np.ndarray) -> np.ndarray:
        data.qpos[:] = here
        move(model, data, step)
        return gaps(model, data)

    errors = []
    for h in (4e-3, 2e-3):
        slope = [(opening(e) - opening(-e)) / (2 * h) for e in h * np.eye(model.nv)]
        errors.append(np.linalg.norm(np.array(slope).T - J_C))
    assert errors[1] < 1e-4
    assert errors[1] < 0.3 * errors[0] + 1e-9  # central differences: the error falls as h^2


def test_the_rows_are_the_same_stored_dense_or_sparse():
    for seed in range(4):
        (model, data), (sparse_model, sparse_data) = everything("dense"), everything("sparse")
        random_closed_pose(model, data, seed)
        sparse_data.qpos[:] = data.qpos
        dense = jacobians(model, data, "tool", "ground")
        sparse = jacobians(sparse_model, sparse_data, "tool", "ground")
        assert mujoco.mj_isSparse(sparse_model) and not mujoco.mj_isSparse(model)
        np.testing.assert_allclose(sparse.J_C, dense.J_C, atol=1e-15)  # sums in another order
        np.testing.assert_array_equal(sparse.J_T, dense.J_T)


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_contacts_limits_and_dry_friction_hold_nothing_in_the_theory(storage):
    """They are at work in the physics, and no row of J_C is theirs."""
    model, data = everything(storage)
    mujoco.mj_fwdPosition(model, data)  # finds the contacts
    full = jacobians(model, data, "tool").J_C
    at_work = {mujoco.mjtConstraint(kind).name for kind in data.efc_type}
    assert {"mjCNSTR_FRICTION_DOF", "mjCNSTR_LIMIT_JOINT", "mjCNSTR_CONTACT_PYRAMIDAL"} < at_work
    none = mujoco.mjtDisableBit
    model.opt.disableflags |= int(
        none.mjDSBL_CONTACT | none.mjDSBL_LIMIT | none.mjDSBL_FRICTIONLOSS
    )
    np.testing.assert_array_equal(jacobians(model, data, "tool").J_C, full)
    assert len(full) == data.nefc == ROWS


def test_an_equality_counts_while_it_is_active():
    model, data = everything()
    rod = Body("rod1")  # which moves whatever is open
    closed = jacobians(model, data, rod).J_C
    data.eq_active[model.equality("brake").id] = True
    braked = jacobians(model, data, rod).J_C
    np.testing.assert_array_equal(braked[:ROWS], closed)
    np.testing.assert_array_equal(np.flatnonzero(braked[ROWS]), model.joint("drum").dofadr)
    data.eq_active[model.equality("grip").id] = False
    assert len(jacobians(model, data, rod).J_C) == ROWS + 1 - 6
    with pytest.raises(ModelError, match="no actuator moves 'tool'"):  # it has been let go
        jacobians(model, data, "tool")
    data.eq_active[:] = False
    assert jacobians(model, data, rod).J_C.shape == (0, model.nv)


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_a_reader_finds_at_every_pose_what_a_new_one_finds(storage):
    """Whatever has moved, locked or lost its torque since, and nothing it gave changes later."""
    model, data = everything(storage)
    tasks = [Body("rod1"), "tool"]
    reader = JacobianReader(model, tasks, "ground", closure_tolerance=np.inf)
    brake, loose = model.equality("brake").id, model.equality("reel").id
    given = []
    for seed, (braked, reeled, group) in enumerate([(0, 1, 0), (1, 1, 0), (0, 1, 2), (0, 0, 0)]):
        random_closed_pose(model, data, seed)
        data.eq_active[[brake, loose]] = braked, reeled
        model.actuator_group[1], model.opt.disableactuator = 1, group
        new = jacobians(model, data, tasks, "ground", closure_tolerance=np.inf)
        given.append((reader.at(data), new))
    for ours, theirs in given:
        for name in ("J_T", "J_C", "active", "gear", "closure_residual"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        assert ours.rows == theirs.rows
        assert ours.warnings == theirs.warnings
    assert len({jac.J_C.shape for jac, _ in given}) == 3
    assert len(given[2][0].active) == 1


def test_actuators_are_known_by_their_velocity_and_gear():
    model, data = everything()
    jac = jacobians(model, data, "tool")
    np.testing.assert_array_equal(
        jac.active, [model.joint(name).dofadr[0] for name in ("slide1", "hinge_y")]
    )
    np.testing.assert_array_equal(jac.gear, [-3.0, 0.5])


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_a_loop_with_redundant_rows_moves_as_finite_differences_on_the_manifold(storage):
    model = mujoco.MjModel.from_xml_string(FOUR_BAR.format(storage=storage))
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="tool", axes="ground")
    assert jac.J_C.shape == (3, 3)
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
    assert kin.internal_force.shape == (1, 3)
    assert kin.active_constraint.shape == (0, 1)
    np.testing.assert_array_equal(jac.gear, [50.0])

    def tool(h: float) -> np.ndarray:
        """Where the tool is after the crank has turned by h with the loop closed."""
        data.qpos[:] = [h, 0, 0]
        turned = assemble(model, data, held=["crank"])
        assert turned.qpos[0] == h
        return turned.site("ground").xmat.reshape(3, 3).T @ turned.site("tool").xpos

    errors = []
    for h in (1e-2, 5e-3):
        finite = (tool(h) - tool(-h)) / (2 * h)
        errors.append(np.linalg.norm(finite - kin.J[3:, 0]))
    assert errors[1] < 1e-5
    assert errors[1] < 0.3 * errors[0] + 1e-9  # central differences: the error falls as h^2


def test_the_inverse_jacobian_of_the_hexapod_is_the_slope_of_its_strut_lengths(model):
    machine = hexapod(model)
    rng = np.random.default_rng(0)
    pose = Pose(np.eye(3), np.zeros(3)).moved(1e-2 * rng.normal(size=6))
    h = 1e-5
    slope = [
        (machine.displacements(pose.moved(e)) - machine.displacements(pose.moved(-e))) / (2 * h)
        for e in h * np.eye(6)
    ]
    np.testing.assert_allclose(machine.inverse_jacobian(pose), np.array(slope).T, atol=1e-9)


def test_the_models_jacobian_agrees_with_the_closed_form_away_from_the_nominal_pose(model):
    """Follow one payload motion through the whole mechanism by Newton on its closures."""
    machine = hexapod(model)
    data = mujoco.MjData(model)
    target = Pose(np.eye(3), np.zeros(3)).moved(np.array([2e-3, -1e-3, 3e-3, 5e-4, 2e-4, -4e-4]))
    struts = [model.joint(f"strut{k}") for k in range(1, 7)]
    lengths = machine.displacements(target)
    for _ in range(8):
        mujoco.mj_fwdPosition(model, data)
        jac = jacobians(model, data, "payload", "base", closure_tolerance=np.inf)
        rows = np.zeros((6, model.nv))
        rows[range(6), [joint.dofadr[0] for joint in struts]] = 1.0
        gap = np.concatenate(
            [-data.efc_pos[: len(jac.J_C)], lengths - [data.joint(j.id).qpos[0] for j in struts]]
        )
        step = np.linalg.lstsq(np.vstack([jac.J_C, rows]), gap, rcond=None)[0]
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    jac = jacobians(model, data, "payload", "base")
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()
    np.testing.assert_allclose(machine.inverse_jacobian(target) @ kin.J, np.eye(6), atol=1e-7)


def test_only_active_equalities_count(model):
    data = mujoco.MjData(model)
    assert len(jacobians(model, data, "payload").J_C) == 36
    data.eq_active[model.equality("lock3").id] = True
    locked = jacobians(model, data, "payload").J_C
    assert len(locked) == 37
    free = scipy.linalg.null_space(locked)
    assert np.abs(free[model.joint("strut3").dofadr[0]]).max() < 1e-12


DRIVES = """
<mujoco>
  <worldbody>
    <site name="post" pos="0 2 0"/><site name="base"/>
    <body name="arm">
      <joint name="a"/><geom size="0.1"/><site name="tool"/><site name="crank" pos="0.3 0 0"/>
      <body pos="1 0 0">
        <joint name="ball" type="ball"/><geom size="0.1"/><site name="payload"/>
      </body>
    </body>
    <body pos="4 0 0"><joint name="float" type="free"/><geom size="0.1"/><site name="buoy"/></body>
  </worldbody>
  <tendon>
    <fixed name="cable"><joint joint="a" coef="1"/></fixed></tendon>
  <actuator><{drive}/></actuator>
</mujoco>
"""


@pytest.mark.parametrize(
    ("drive", "task"),
    [
        ('motor name="m" tendon="cable"', "payload"),
        ('motor name="m" site="payload" gear="0 1 0 0 0 0"', "payload"),
        ('motor name="m" site="payload" refsite="post" gear="0 1 0 0 0 0"', "payload"),
        ('motor name="m" joint="ball"', "payload"),
        ('motor name="m" jointinparent="float"', "buoy"),
        ('motor name="m" cranksite="crank" slidersite="post" cranklength="3"', "payload"),
    ],
)
def test_an_actuator_on_no_joint_has_a_velocity_of_its_own_which_a_linear_model_reads(drive, task):
    """As J_C ties it to the joints; a plant refuses a motor, which has no displacement."""
    model = mujoco.MjModel.from_xml_string(DRIVES.format(drive=drive))
    jac = jacobians(model, mujoco.MjData(model), task)
    assert jac.active.tolist() == [model.nv] and jac.J_C.shape == (1, model.nv + 1)
    linear = linearize(model, mujoco.MjData(model), task, "base")
    np.testing.assert_allclose(linear.C_active[:, : model.nv], jac.J_C[:, : model.nv], atol=1e-12)
    with pytest.raises(ModelError, match='actuator "m" is a torque motor'):
        Plant(model)


def test_adhesion_is_refused_by_name_whoever_asks():
    pad = 'adhesion name="m" body="arm" gain="1" ctrlrange="0 1"'
    model = mujoco.MjModel.from_xml_string(DRIVES.format(drive=pad))
    for refuses in (
        lambda: jacobians(model, mujoco.MjData(model), "tool"),
        lambda: linearize(model, mujoco.MjData(model), "tool", "base"),
        lambda: Plant(model),
    ):
        with pytest.raises(ModelError, match='actuator "m" adheres'):
            refuses()


def test_two_actuators_on_a_joint_share_its_velocity():
    model = mujoco.MjModel.from_xml_string(SERIAL.format(kind="hinge", second="a"))
    jac = jacobians(model, mujoco.MjData(model), "tool")
    assert jac.names is not None and jac.names.actuators == (("m1", "m2"),)
    assert jac.active.tolist() == [0] and jac.gear.tolist() == [1.0]
    linear = linearize(model, mujoco.MjData(model), "tool", None)
    assert linear.B.shape[1] == 2
    np.testing.assert_array_equal(linear.C_active, [[1.0] + [0.0] * (2 * model.nv - 1)])


def test_what_the_theory_has_no_word_for_is_refused_by_name():
    model = mujoco.MjModel.from_xml_string(SERIAL.format(kind="hinge", second="b"))
    with pytest.raises(ModelError, match='no site named "nose"; it has: tool'):
        jacobians(model, mujoco.MjData(model), "nose")
    model.actuator_gear[1, 0] = 0.0
    with pytest.raises(ModelError, match='actuator "m2" has gear 0'):
        jacobians(model, mujoco.MjData(model), "tool")


FLEX = """
<mujoco>
  <worldbody>
    <body pos="0 0 2">
      <joint name="a"/><geom size="0.1"/>
      <body name="hand" pos="0.3 0 0"><joint name="b"/><geom size="0.1"/><site name="tool"/>{held}
      </body>
    </body>
    {beside}
  </worldbody>
  <equality><joint joint1="b" joint2="a" polycoef="0 2 0 0 0"/>{ties}</equality>
  <actuator><motor joint="a"/></actuator>
</mujoco>
"""
CLOTH = """
<flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" dim="2" radius="0.01"
          mass="1" pos="0 0 1">{}<edge equality="true"/></flexcomp>
"""


def cloth(where: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A robot, and a cloth beside it, in its hand, or from its hand to the world."""
    parts = {"held": "", "beside": CLOTH.format(""), "ties": ""}
    if where == "in the hand":
        parts = {"held": CLOTH.format('<pin id="0 2"/>'), "beside": "", "ties": ""}
    elif where == "tied":
        parts["beside"] = CLOTH.format('<pin id="8"/>')
        parts["ties"] = '<weld body1="hand" body2="cloth_0"/>'
    model = mujoco.MjModel.from_xml_string(FLEX.format(**parts))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("where", ["beside", "in the hand"])
def test_the_equality_of_a_cloth_that_ties_nothing_of_the_task_is_left_out_with_a_warning(where):
    """Also by `assemble`; the robot's own loop, whose row comes after the cloth's, stays closed."""
    model, data = cloth(where)
    data.joint("a").qpos, data.joint("b").qpos = 0.3, 0.5
    with pytest.warns(RuntimeWarning, match="flex.* is left out"):
        closed = assemble(model, data)
    assert closed.joint("b").qpos == pytest.approx(2.0 * closed.joint("a").qpos, abs=1e-9)
    jac = jacobians(model, closed, "tool")
    assert any("flex" in sentence and "left out" in sentence for sentence in jac.warnings)
    row = np.zeros((1, model.nv))
    row[0, model.joint("b").dofadr], row[0, model.joint("a").dofadr] = 1.0, -2.0
    np.testing.assert_array_equal(jac.J_C, row)
    expected = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, closed, expected, None, model.site("tool").id)
    np.testing.assert_array_equal(jac.J_T[3:], expected)
    closed.eq_active[model.eq_type == mujoco.mjtEq.mjEQ_FLEX] = 0
    assert not any("flex" in sentence for sentence in jacobians(model, closed, "tool").warnings)


def test_a_cloth_tied_to_the_robot_is_refused_and_what_the_refusal_advises_helps():
    model, data = cloth("tied")
    for ask in (
        lambda: jacobians(model, data, "tool", closure_tolerance=np.inf),
        lambda: assemble(model),
    ):
        with pytest.raises(ModelError, match=r"ties a flex to the mechanism.*eq_active0 and data"):
            ask()
    of_flex = model.eq_type == mujoco.mjtEq.mjEQ_FLEX
    model.eq_active0[of_flex], data.eq_active[of_flex] = 0, 0
    jacobians(model, assemble(model), "tool")
    jacobians(model, data, "tool", closure_tolerance=np.inf)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_pose_that_is_not_finite_is_refused(bad):
    model, data = everything()
    data.qpos[3] = bad
    with pytest.raises(ValueError, match=r"data\.qpos must be finite"):
        jacobians(model, data, "tool")


SLEEPER = """
<mujoco>
  <option gravity="0 0 0"><flag sleep="enable"/></option>
  <worldbody>
    <body sleep="allowed"><joint name="a"/><geom size="0.1"/></body>
    <body sleep="allowed" pos="3 0 0">
      <joint name="b" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/>
      <site name="tool" pos="0.3 0 0"/>
    </body>
    <body sleep="allowed" pos="9 0 0"><freejoint/><geom size="0.1"/></body>
  </worldbody>
  <tendon>
    <fixed name="cable"><joint joint="a" coef="1"/><joint joint="b" coef="3"/></fixed>
  </tendon>
  <equality><joint joint1="a" joint2="b"/></equality>
  <actuator><motor {drive}/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("drive", ['joint="a"', 'tendon="cable"', 'site="tool" gear="0 0 1 0 0 0"'])
def test_what_sleeps_has_the_jacobians_that_it_has_awake(drive):
    """MuJoCo leaves rows of equalities and transmissions that sleep out; the frames are there."""
    model = mujoco.MjModel.from_xml_string(SLEEPER.format(drive=drive))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.2, 0.2, 9.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    mujoco.mj_step(model, data, 2000)
    assert data.ntree_awake == 0
    asleep = jacobians(model, data, ["tool", CenterOfMass()])
    closed = assemble(model, data)
    assert data.ntree_awake == 0  # as it was
    model.opt.enableflags = 0
    awake = jacobians(model, data, ["tool", CenterOfMass()])
    assert len(awake.J_C) == 1 + ("joint" not in drive)
    np.testing.assert_array_equal(asleep.J_T, awake.J_T)
    np.testing.assert_array_equal(asleep.J_C, awake.J_C)
    np.testing.assert_array_equal(asleep.accuracy.J_C_error, awake.accuracy.J_C_error)  # type: ignore[union-attr]
    np.testing.assert_allclose(closed.qpos, data.qpos, atol=1e-9)


def test_an_equality_that_is_switched_on_in_its_sleep_is_closed():
    model = mujoco.MjModel.from_xml_string(SLEEPER.format(drive='joint="a"'))
    data = mujoco.MjData(model)
    data.eq_active[0] = 0
    data.qpos[0] = 0.2
    mujoco.mj_step(model, data, 2000)
    assert data.ntree_awake == 0
    data.eq_active[0] = 1
    with pytest.raises(ClosureError, match=r"open by 0\.2"):
        jacobians(model, data, "tool")
    a, b = assemble(model, data).qpos[:2]
    assert a == pytest.approx(b, abs=1e-9)


SPRINGS = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body><joint name="ball" type="ball" stiffness="3"/><geom size="0.1"/>
      <body pos="1 0 0"><joint name="slide" type="slide" stiffness="2{poly}"/><geom size="0.1"/>
        <body pos="1 0 0"><joint name="hinge" stiffness="5"{plastic}/><geom size="0.1"/></body>
      </body>
    </body>
    <body pos="4 0 0"><joint name="float" type="free" stiffness="7"/><geom size="0.1"/></body>
  </worldbody>
</mujoco>
"""


def test_springs_push_back_with_their_stiffness_against_each_velocity():
    model = mujoco.MjModel.from_xml_string(SPRINGS.format(poly="", plastic=""))
    data, h = mujoco.MjData(model), 1e-4
    pushed = []
    for e in h * np.eye(model.nv):
        data.qpos[:] = model.qpos0
        move(model, data, e)
        mujoco.mj_forward(model, data)
        pushed.append(-data.qfrc_passive / h)
    np.testing.assert_allclose(pushed, np.diag(joint_stiffness(model)), atol=1e-9)


def test_a_spring_that_is_not_linear_is_refused_by_name():
    for poly, plastic, joint in ((" 5 7", "", "slide"), ("", ' springyield="0.1"', "hinge")):
        model = mujoco.MjModel.from_xml_string(SPRINGS.format(poly=poly, plastic=plastic))
        with pytest.raises(ModelError, match=f'the spring of joint "{joint}" is not linear'):
            joint_stiffness(model)


def test_the_mass_matrix_gives_the_kinetic_energy_of_any_velocity():
    model, data = everything()
    random_closed_pose(model, data, seed=0)
    mass = mass_matrix(model, data)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    for velocity in np.random.default_rng(0).normal(size=(3, model.nv)):
        data.qvel[:] = velocity
        mujoco.mj_forward(model, data)
        assert velocity @ mass @ velocity / 2 == pytest.approx(data.energy[1], rel=1e-12)
