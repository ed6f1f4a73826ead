"""Linear models: textbook motions, failed servos, friction, springs, nonlinear effects."""

import mujoco
import numpy as np
import pytest
import scipy.linalg

from sim import MODELS, ModelError, Plant, assemble, jacobians, linearize, load_model
from sim.mjcf import joint_stiffness, located, mass_matrix
from sim.mjcf.part import task_part
from sim.plant import NonlinearityMonitor, beyond_linear, dry_friction
from sim.plant.linear import LinearPlant
from tests.models import model_of
from tests.motions import shifted
from tests.sim.machines import WORLD, closed_state, linkage, pendulum, state_at


def test_a_pendulum_swings_with_the_frequency_of_its_length():
    """omega^2 = g / l: all stiffness is geometric, from the loaded light rod that rotates."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><site name="base"/>
      <body name="rod"><joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.005" mass="1e-9" contype="0"/></body>
      <body name="bob" pos="0 0 -0.5"><joint type="slide" axis="1 0 0"/>
        <joint type="slide" axis="0 0 1"/><geom size="0.02" mass="2" contype="0"/>
        <site name="payload"/></body></worldbody>
      <equality><connect body1="rod" body2="bob" anchor="0 0 -0.5"/></equality></mujoco>""")
    linear = linearize(model, mujoco.MjData(model))
    assert linear.A.shape == (2, 2)
    # The rod's own mass and the finite differences contribute 1e-6.
    assert -linear.A[1, 0] == pytest.approx(9.81 / 0.5, rel=1e-5)


def test_a_constant_push_along_an_arm_softens_it():
    """A load of constant direction changes the stiffness from k to k - F l."""
    model = pendulum('<motor joint="a"/>', 'stiffness="10"')
    data = mujoco.MjData(model)
    alone = linearize(model, data, "tool", None)
    data.xfrc_applied[model.body("arm").id, 2] = 5.0  # at the centre of mass, which hangs
    pushed = linearize(model, data, "tool", None)
    assert pushed.A[1, 0] / alone.A[1, 0] == pytest.approx(1 - 5.0 * 0.7 / 10.0, rel=1e-6)


def test_an_actuator_with_an_internal_state_is_rejected():
    model = pendulum('<general joint="a" dyntype="filter" dynprm="0.1"/>')
    with pytest.raises(ModelError, match="has an internal state"):
        linearize(model, mujoco.MjData(model), "tool", None)


def test_a_rod_between_two_ball_joints_is_unobservable_about_its_axis_only():
    model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0"/><worldbody>
      <body><joint name="crank" axis="0 1 0" damping="0.1" armature="0.01"/>
        <geom size="0.02" mass="0.1"/>
        <body pos="0.1 0 0"><joint name="ball" type="ball" damping="0.001"/>
          <geom type="capsule" size="0.01" fromto="0 0 0 0 0 0.2" mass="0.1"/>
          <site name="end" pos="0 0 0.2"/></body></body>
      <body pos="0.1 0 0.2"><joint type="slide" axis="1 0 0" damping="0.1"/>
        <geom size="0.02" mass="0.1"/><site name="tool"/></body></worldbody>
      <equality><connect site1="end" site2="tool" solref="0.004 1"/>
        <joint name="lock1" joint1="crank" active="false"/></equality>
      <actuator><position joint="crank" kp="10" kv="1"/></actuator></mujoco>""")
    linear = Plant(model, **WORLD, start=mujoco.MjData(model)).linear()
    assert linear.unobservable_joints == ("ball",)


@pytest.mark.parametrize("length", [0.3, np.nextafter(0.3, 0), np.nextafter(0.3, 1), 0.3 + 1e-12])
def test_a_cable_that_just_begins_to_pull_has_its_stiffness(length):
    """The cable starts to act at its present length, 0.3 m, and acts on half of the joint."""
    model = pendulum('<motor joint="a"/>', cable='springlength="0 0.3" stiffness="50"')
    stiffness = jacobians(model, state_at(model, a=2 * length), site="tool").stiffness
    np.testing.assert_allclose(stiffness, [[50.0 / 4]])  # type: ignore[arg-type]


def without(linear: LinearPlant, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B and constant acceleration (2k,), predicted without drive k."""
    assert linear.feedback is not None and linear.holding is not None
    B, column = linear.B.copy(), linear.B[:, k]
    B[:, k] = 0.0
    return linear.A + np.outer(column, linear.feedback[k]), B, -column * linear.holding[k]


@pytest.mark.parametrize("name", ["arm", "platform", "hand", "arms"])
def test_a_released_servo_leaves_the_linear_model_without_its_feedback(name):
    """The prediction equals the linear model of the machine with this servo switched off."""
    model = load_model(MODELS / f"{name}.xml")
    linear = Plant(model).linear()
    for k in range(model.nu) if name != "arms" else (0, 7):
        A, B, push = without(linear, k)
        broken = Plant(model)
        broken.release(k)
        real = broken.linear()
        np.testing.assert_allclose(A, real.A, atol=1e-6 * np.abs(linear.A).max())
        np.testing.assert_allclose(B, real.B, atol=1e-6 * np.abs(B).max())
        np.testing.assert_allclose(push, 0.0, atol=1e-6)  # without gravity no force is required


@pytest.mark.parametrize("k", [0, 1])
def test_without_a_servo_a_machine_falls_as_in_its_linear_model(k):
    """The error is within 1 % of the motion for 30 ms, from rest under gravity."""
    model = model_of("lifted")
    plant = Plant(model, base=None, start=assemble(model))
    linear = plant.linear()
    A, _, push = without(linear, k)
    plant.release(k)
    plant.step(np.zeros(2), 0.03)
    both = np.zeros((len(A) + 1,) * 2)
    both[:-1, :-1], both[:-1, -1] = A, push
    expected = linear.C_active @ scipy.linalg.expm(both * 0.03)[:-1, -1]
    moved = plant.displacements()
    assert np.abs(moved).max() > 1e-3
    np.testing.assert_allclose(moved, expected, atol=0.01 * np.abs(moved).max())


def test_dry_friction_is_that_of_the_file():
    """A force at a joint or tendon accelerates by M^-1 times its row."""
    model = model_of("rubbing_arm", add_locks=True)
    plant = Plant(model, start=mujoco.MjData(model))
    friction = plant.linear().friction
    assert friction is not None
    assert dry_friction(plant.model) == ("shoulder", "elbow", "belt")
    np.testing.assert_allclose(friction.limit, [0.4, 0.2, 0.1])
    np.testing.assert_allclose(np.abs(friction.rows), [[1, 0], [0, 1], [1, 1]], atol=1e-12)
    mass = mass_matrix(plant.model, plant.data)
    np.testing.assert_allclose(mass @ friction.push, friction.rows.T, atol=1e-12)
    plant.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
    assert plant.linear().friction is None


def pair(
    option: str = "", joint: str = "", tendon: str = "", equality: str = ""
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Create two arms that a gear couples."""
    arm = '<geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0" mass="1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option {option}/><worldbody>
      <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 0.44"/>
      <body name="left" pos="0 0 0.5"><joint name="a" axis="0 1 0" {joint}/>{arm}
      <body name="right" pos="0 0.3 0.5"><joint name="b" axis="0 1 0"/>{arm}</worldbody>
      <tendon><fixed name="cord" {tendon}><joint joint="a" coef="1"/></fixed></tendon>
      <equality><joint name="gear" joint1="a" joint2="b" {equality}/></equality>
      <actuator><motor name="m" joint="a" forcerange="-1 1"/></actuator></mujoco>""")
    return model, mujoco.MjData(model)


@pytest.mark.parametrize(
    ("parts", "start"),
    [
        ({"joint": 'frictionloss="0.1"'}, "dry friction of a:"),
        ({"tendon": 'frictionloss="0.1"'}, "dry friction of cord:"),
        ({"joint": 'damping="1 0.5"'}, "damping of a is not linear"),
        ({"tendon": 'damping="1 0.5"'}, "damping of cord is not linear"),
        ({"joint": 'stiffness="1 0.5"'}, "stiffness of a is not linear"),
        ({"equality": 'solref="0.2 1"'}, '"gear" is soft'),
        ({"equality": 'solref="-100 -10"'}, '"gear" is soft'),
        ({"equality": 'solimp="0 0.95 0.01"'}, '"gear" is soft'),
        ({"option": 'density="1.2"'}, "drag of a medium of density 1.2"),
    ],
)
def test_each_nonlinear_effect_is_listed_once(parts, start):
    (sentence,) = beyond_linear(*pair(**parts))
    assert start in sentence.replace("equality ", "")


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"joint": 'damping="1" stiffness="2"'},
        {"option": 'viscosity="0.1"'},
        {"equality": 'active="false" solref="0.2 1"'},
        {"equality": 'solref="-5000 -100"'},
    ],
)
def test_linear_effects_are_not_listed(parts):
    """Viscous damping and stiff equalities are part of the linear model, or nearly."""
    assert beyond_linear(*pair(**parts)) == ()


def test_contacts_and_limits_of_a_run_are_recorded():
    """The arm touches the floor beyond its limit with its motor at full force; not at the start."""
    model, data = pair(joint='range="-1 1" limited="true"')
    data.eq_active[:] = 0
    monitor = NonlinearityMonitor(model)
    mujoco.mj_step(model, data)
    monitor.plant(0, model, data)
    assert not monitor.sentences
    data.ctrl[:], data.qpos[0] = 2.0, 1.1
    mujoco.mj_step(model, data)
    monitor.plant(1, model, data)
    monitor.plant(2, model, data)
    assert set(monitor.sentences) == {
        '"left" touched "world"',
        'joint "a" reached its limit',
        'the force of "a" reached its limit',
    }


def test_contacts_outside_the_part_are_not_recorded():
    """A cup is always in contact with the floor, independent of the arm."""
    model = model_of("arm_and_cup")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    everything, of_task = (
        NonlinearityMonitor(model),
        NonlinearityMonitor(model, task_part(model, [located(model, "site", "tool")], ())),
    )
    for monitor in (everything, of_task):
        monitor.plant(0, model, data)
    assert list(everything.sentences) == ['"cup" touched "world"']
    assert not of_task.sentences


def test_the_mass_matrix_gives_the_kinetic_energy_of_any_velocity():
    model = linkage()
    data = closed_state(model)
    mass = mass_matrix(model, data)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    for velocity in np.random.default_rng(0).normal(size=(3, model.nv)):
        data.qvel[:] = velocity
        mujoco.mj_forward(model, data)
        assert velocity @ mass @ velocity / 2 == pytest.approx(data.energy[1], rel=1e-12)


def test_springs_push_back_with_their_stiffness_against_each_velocity():
    xml = """<mujoco><option gravity="0 0 0"/><worldbody>
      <body><joint type="ball" stiffness="3"/><geom size="0.1"/><body pos="1 0 0">
        <joint type="slide" stiffness="2"/><geom size="0.1"/><body pos="1 0 0">
          <joint name="hinge" stiffness="5"/><geom size="0.1"/></body></body></body>
      <body pos="4 0 0"><joint type="free" stiffness="7"/><geom size="0.1"/></body>
    </worldbody></mujoco>"""
    model, h = mujoco.MjModel.from_xml_string(xml), 1e-4
    pushed = []
    for e in h * np.eye(model.nv):
        data = shifted(model, mujoco.MjData(model), e)
        mujoco.mj_forward(model, data)
        pushed.append(-data.qfrc_passive / h)
    np.testing.assert_allclose(pushed, np.diag(joint_stiffness(model)), atol=1e-9)
    plastic = xml.replace('stiffness="5"', 'stiffness="5" springyield="0.1"')
    with pytest.raises(ModelError, match='the spring of joint "hinge" is not linear'):
        joint_stiffness(mujoco.MjModel.from_xml_string(plastic))
