"""Drives of all actuators: velocity, dual force, ranges, names, simulation."""

import itertools

import mujoco
import numpy as np
import pytest

from prioritized import ConstrainedSystem
from sim import Jacobians, ModelError, assemble, jacobians, linearize, pose_error, pose_of
from sim.mjcf import drives, names_of, number_of
from tests.models import model_of
from tests.motions import check_slope, shifted
from tests.sim.machines import CASES, FREEDOMS, mechanism
from tests.spaces import motions

every_kind = pytest.mark.parametrize("kind", CASES)


def of_drives(model: mujoco.MjModel, jac: Jacobians, qvel: np.ndarray) -> np.ndarray:
    """Return the velocity of each drive under any qvel, from the rows of J_C."""
    extra = jac.J_C.shape[1] - model.nv
    own = jac.J_C[len(jac.J_C) - extra :]
    np.testing.assert_array_equal(own[:, model.nv :], -np.eye(extra))
    return np.append(qvel, own[:, : model.nv] @ qvel)[jac.active]


@every_kind
def test_each_velocity_is_known_by_name_actuators_and_gears(kind):
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


@pytest.mark.parametrize(
    ("unit", "kinds"),
    [
        ("rad", [["hinge"], ["ball"], ["orientation servo", "turn of a site"]]),
        ("m", [["site"], ["thrusters"], ["slider-crank"], ["free"]]),
    ],
)
def test_rotary_drives_move_by_an_angle_and_linear_ones_by_a_length(unit, kinds):
    for together in kinds:
        first, *others = (CASES[kind].mjcf for kind in together)
        mjcf = first + "".join(other.replace('name="m"', 'name="n"') for other in others)
        assert {drive.unit for drive in drives(mechanism(mjcf)[0])} == {unit}, together


@every_kind
def test_the_velocity_is_mujocos_by_the_gear_and_its_force_is_dual(kind):
    """The sum of gear force times velocity is qfrc_actuator . qvel, also for open loops."""
    model, data = mechanism(CASES[kind].mjcf)
    jac, rng = jacobians(model, data, "tool"), np.random.default_rng(2)
    for qvel in rng.normal(size=(3, model.nv)):
        data.qvel[:], data.ctrl[:] = qvel, rng.uniform(0.1, 1.0, size=model.nu)
        data.act[:] = rng.uniform(0.1, 1.0, size=model.na)
        mujoco.mj_forward(model, data)
        rates = of_drives(model, jac, qvel)
        for rate, drive in zip(rates, jac.drives, strict=True):
            seen = data.actuator_velocity[list(drive.outputs)] / drive.gear
            np.testing.assert_allclose(seen, rate, rtol=1e-9, atol=1e-12)
        assert np.abs(data.actuator_force).min() > 1e-3
        forces = [drive.gear @ data.actuator_force[list(drive.outputs)] for drive in jac.drives]
        assert forces @ rates == pytest.approx(data.qfrc_actuator @ qvel, rel=1e-9)


@pytest.mark.parametrize("at", ['site="tool"', 'site="tool" refsite="post"', 'joint="float"'])
@pytest.mark.parametrize("gear", ["-.6 .8 0 0 0 0", "0 0 -2 0 0 0", "0 0 0 0 -1 0", "0 -1 0 2 0 0"])
def test_along_a_direction_the_velocity_is_that_along_the_first_gear(at, gear):
    """The first component may have any sign; an opposite actuator has gear -3."""
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


@pytest.mark.parametrize("one, other", [(6e-17, 6e-17), (-6e-17, 6e-17), (0.0, -6e-17)])
def test_parallel_gears_are_one_velocity_despite_rounded_zeros(one, other):
    model, data = mechanism(
        f'<motor site="buoy" gear="{one} 1 0 0 0 0"/><motor site="buoy" gear="{other} -1 0 0 0 0"/>'
    )
    assert len(jacobians(model, data, site="buoy").active) == 1


@pytest.mark.parametrize("tendon", ["cable", "hoist", "wrap"])
def test_a_locked_tendon_keeps_its_length(tendon):
    model, data = mechanism(f'<motor tendon="{tendon}" gear="2"/><motor joint="crank"/>')
    locked = motions(ConstrainedSystem.of(jacobians(model, data, "tool")).with_failures(locked=[0]))
    assert locked.shape[1] == FREEDOMS - 1
    for velocity in locked.T:

        def length(h: float, step: np.ndarray = velocity[: model.nv]) -> np.ndarray:
            return assemble(model, shifted(model, data, h * step)).actuator_length[:1]

        check_slope(0.0, length, 1e-2, 4e-4, 1e-7)


@pytest.mark.parametrize("locked", [None, "cable", "rope", "rail"])
def test_servos_on_tendons_move_a_simulated_tool_as_the_mapping_commands(locked):
    """Motion of 0.2 mm and mrad is within 1 %, also with one servo stuck."""
    model = model_of("gantry", ("1e-4", "5e-4"))
    data = assemble(model)
    jac = jacobians(model, data, "tool")
    system, rows = ConstrainedSystem.of(jac), [1, 3, 5]
    if locked:
        system = system.with_failures(locked=[["cable", "rope", "rail"].index(locked)])
        data.eq_active[model.equality(locked).id] = True
        rows = [3, 5]
    kin = system.kinematics()
    mapping = kin.velocity_mapping(major=rows)
    at_rest, start = data.actuator_length.copy(), pose_of(model, data, "tool")
    for step in np.random.default_rng(0).normal(size=(3, len(rows))):
        step *= 2e-4 / np.linalg.norm(step)
        data.ctrl[:] = at_rest + jac.gear * kin.expand(mapping(step))
        mujoco.mj_step(model, data, 4000)
        moved = -pose_error(model, data, "tool", start)[rows]
        assert np.linalg.norm(moved - step) < 0.01 * np.linalg.norm(step)


def arm_model(actuators: str, joint: str = "", tendon: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
      <body><joint name="a" axis="0 1 0" {joint}/><geom size="0.05"/>
        <body name="lower" pos="0.4 0 0"><joint name="b" axis="0 1 0"/><geom size="0.05"/>
          <site name="tool" pos="0.3 0 0"/></body></body>
      <body pos="0 0 3"><joint name="c" axis="0 1 0"/><geom size="0.05"/><site name="flag"/></body>
      </worldbody><tendon><fixed name="cable" {tendon}><joint joint="a" coef="1"/>
      <joint joint="b" coef="2"/></fixed></tendon><actuator>{actuators}</actuator></mujoco>""")


def arm(actuators: str, disabled: int = 0, joint: str = "", tendon: str = "") -> Jacobians:
    model = arm_model(actuators, joint, tendon)
    model.opt.disableactuator = disabled
    return jacobians(model, mujoco.MjData(model), "tool")


PAIR = '<motor name="m1" joint="a" group="1"/><motor name="m2" tendon="cable" group="2"/>'


def test_disabled_actuators_are_not_active_and_give_a_warning():
    both = arm(PAIR)
    assert both.active.tolist() == [0, 3] and both.warnings == ()
    first, second = arm(PAIR, disabled=1 << 2), arm(PAIR, disabled=1 << 1)
    assert first.active.tolist() == [0] and first.J_C.shape == (0, 3)
    assert first.warnings == ("switched off by opt.disableactuator, so not active: m2",)
    assert second.active.tolist() == [3] and second.names.actuators == (("m2",),)
    with pytest.raises(ModelError, match="no enabled actuator"):
        arm(PAIR, disabled=1 << 1 | 1 << 2)


MUSCLE = '<muscle name="{}" joint="a" gear="{}" lengthrange="-1 1"/>'


@pytest.mark.parametrize(
    ("actuators", "side"),
    [
        ('<motor joint="a"/>', 0),
        ('<motor joint="a" ctrlrange="0 1" gear="-3"/>', -1),
        ('<general joint="a" ctrlrange="0 1" gainprm="-2"/>', -1),
        ('<motor joint="a" forcerange="-4 0" gear="-1"/>', 1),
        ('<position joint="a" kp="9" ctrlrange="0 1"/>', 0),  # of the target, not of the force
        ('<position joint="a" kp="9" forcerange="0 5"/>', 1),
        (MUSCLE.format("m", 1), -1),
        (MUSCLE.format("m", -1), 1),
        (MUSCLE.format("m", 1) + MUSCLE.format("n", -2), 0),
        ('<motor tendon="cable" ctrlrange="-1 0"/><motor tendon="cable" ctrlrange="0 1"/>', 0),
        # The velocity is along the gear.
        ('<motor site="tool" gear="0 0 -1 0 0 0" ctrlrange="0 1"/>', 1),
    ],
)
def test_one_sided_actuators_are_marked_and_give_a_warning(actuators, side):
    """A negative gear reverses the side of a joint; an antagonistic pair pushes both ways."""
    jac = arm(actuators)
    assert jac.one_sided.tolist() == [side]
    name = jac.names.velocities[jac.active[0]]
    if 'muscle name="m" joint="a" gear="-1"' in actuators:
        np.testing.assert_array_equal(jac.force_range, [[0.0, np.inf]])
    warning = f"actuated in one direction only, which the mappings do not consider: {name}"
    assert jac.warnings == ((warning,) if side else ())


LIMITED = [
    ('<motor joint="a" ctrlrange="-1 2" gear="-3"/>', "", ""),
    ('<motor joint="a" ctrlrange="-1 2"/><motor joint="a" ctrlrange="0 3" gear="2"/>', "", ""),
    ('<motor joint="a" ctrlrange="-9 9" forcerange="-1 20"/>', "", ""),
    ('<position joint="a" kp="1" forcerange="-3 4"/>', "", ""),
    ('<motor joint="a" gear="3" ctrlrange="-1 9"/>', 'actuatorfrcrange="-5 7"', ""),
    ('<motor tendon="cable" gear="-3" ctrlrange="-1 9"/>', "", 'actuatorfrcrange="-5 7"'),
    ('<motor tendon="cable" gear="2"/><motor tendon="cable" gear="2" ctrlrange="0 1"/>',
     "", 'actuatorfrcrange="-5 7"'),
    ('<motor tendon="cable" gear="2" ctrlrange="0 9"/><motor tendon="cable" ctrlrange="0 1"/>',
     "", ""),
]  # fmt: skip


@pytest.mark.parametrize(("actuators", "joint", "tendon"), LIMITED)
def test_the_force_range_is_what_mujoco_lets_the_actuators_exert(actuators, joint, tendon):
    """Ranges of several actuators add up; limits of the joint's or tendon's total apply."""
    jac, model = arm(actuators, joint=joint, tendon=tendon), arm_model(actuators, joint, tendon)
    data, forces = mujoco.MjData(model), []
    for data.ctrl[:] in itertools.product([-1e3, 0.0, 1e3], repeat=model.nu):
        mujoco.mj_forward(model, data)
        total = [drive.gear @ data.actuator_force[list(drive.outputs)] for drive in jac.drives]
        forces.append(total if jac.drives[0].joint is None else [data.qfrc_actuator[0]])
    expected = np.transpose([np.min(forces, axis=0), np.max(forces, axis=0)])
    np.testing.assert_allclose(jac.force_range, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("actuators", "message"),
    [
        (
            '<adhesion name="pad" body="lower" gain="1" ctrlrange="0 1"/>',
            'actuator "pad" adheres to .*: remove it .* or disable its group and pin',
        ),
        ('<motor name="m" joint="a" gear="0"/>', 'actuator "m" has gear 0 .*: remove it'),
        ('<motor site="tool" gear="0 0 0 0 0 0"/>', 'actuator "number 0" has gear 0'),
        ("", "the model has no enabled actuator, .*: add one"),
        ('<motor name="m" joint="c"/>', "no actuator moves 'tool'"),
    ],
)
def test_actuators_that_move_nothing_are_rejected_with_the_remedy(actuators, message):
    with pytest.raises(ModelError, match=message) as caught:
        arm(actuators)
    assert "\n" not in str(caught.value)
    # The remedy in a message works.
    pad = '<adhesion name="pad" body="lower" gain="1" ctrlrange="0 1" group="3"/>'
    assert arm(PAIR + pad, disabled=1 << 3).active.tolist() == [0, 3]


@pytest.mark.parametrize(
    "drive",
    [
        '<motor tendon="cable"/>',
        '<motor site="tool" gear="0 0 1 0 0 0"/>',
        '<motor site="tool" refsite="flag" gear="0 0 1 0 0 0"/>',
        '<motor cranksite="tool" slidersite="flag" cranklength="6"/>',
    ],
)
def test_a_linear_model_has_the_velocity_of_actuators_without_a_joint(drive):
    """C_active is the relation to the joints in J_C."""
    model = arm_model(drive)
    jac = jacobians(model, mujoco.MjData(model), "tool")
    assert jac.active.tolist() == [model.nv] and jac.J_C.shape == (1, model.nv + 1)
    linear = linearize(model, mujoco.MjData(model), "tool", None)
    np.testing.assert_allclose(linear.C_active[:, : model.nv], jac.J_C[:, : model.nv], atol=1e-12)


def test_two_actuators_of_a_joint_are_one_velocity_and_two_inputs():
    model = arm_model('<motor joint="a"/><motor joint="a"/>')
    linear = linearize(model, mujoco.MjData(model), "tool", None)
    assert linear.B.shape[1] == 2
    np.testing.assert_array_equal(linear.C_active, [[1.0] + [0.0] * 5])


def test_an_actuator_has_one_name_and_answers_to_its_joints():
    """The name in the file has priority over an equal name of another joint."""
    joints = '<body><joint name="a"/>{0}<body><joint name="b"/>{0}<body><joint name="c"/>{0}'
    tendon = '<fixed name="{}"><joint joint="{}" coef="1"/><joint joint="b" coef="1"/></fixed>'
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
      {joints.format('<geom size="0.1"/>')}</body></body></body></worldbody><actuator>
      <motor name="b" joint="a"/><motor name="a" joint="b"/><motor name="push" joint="c"/>
      <motor name="pull" joint="c"/><general name="c" tendon="rope"/><motor tendon="wire"/>
      </actuator>
      <tendon>{tendon.format("rope", "a")}{tendon.format("wire", "c")}</tendon></mujoco>""")
    known = names_of(drives(model))
    assert [own for own, *_ in known] == ["b", "a", "push", "c", "wire"]
    for k, names in enumerate(known):
        assert number_of(names[0], known) == k
    assert [number_of(name, known) for name in ("pull", "rope", "number 5")] == [2, 3, 4]


def test_digits_are_a_name_first_and_then_a_number():
    """Hands may number their joints in another order than their actuators."""
    assert number_of("0", [("a", "2"), ("b", "0"), ("c", "1")]) == 1
    assert number_of("2", [("a",), ("b",), ("c",)]) == 2
    with pytest.raises(ValueError, match='no actuator or joint "3"'):
        number_of("3", [("a",), ("b",), ("c",)])
