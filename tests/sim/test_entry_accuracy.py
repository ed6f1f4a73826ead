"""How far each entry of the Jacobians may be off: plain MuJoCo with every number moved."""

import copy
import dataclasses

import mujoco
import numpy as np
import pytest

from fjh.ik import Ik
from prioritized import ConstrainedSystem
from sim import CenterOfMass, FrameTask, JacobianReader, Mechanism, jacobians, load_model, pose_of
from sim.mjcf.accuracy import roundings
from tests.three_rrr import EXACT, six_digits, taken, three_rrr


def chain(rng: np.random.Generator, unit: int = 0, loops: str = "") -> mujoco.MjModel:
    """Five links in space, lengths of six decimals in 10^-unit m, directions of four."""

    def text(numbers: np.ndarray, exponent: int = 0) -> str:
        return " ".join(f"{x}e{exponent}" for x in numbers)

    links = ""
    for k in range(5):
        offset, axis = rng.uniform(-0.2, 0.2, size=3).round(6), rng.normal(size=3)
        quat = rng.normal(size=4)
        unit_axis, unit_quat = (v / np.linalg.norm(v) for v in (axis, quat))
        kind = "slide" if k == 3 else "hinge"
        links += (
            f'<body name="b{k}" pos="{text(offset, unit)}" quat="{text(unit_quat.round(4))}">'
            f'<joint name="j{k}" type="{kind}" axis="{text(unit_axis.round(4))}"/>'
            '<geom size="0.01" mass="1"/>'
        )
    tip = f'<site name="tip" pos="{text(rng.uniform(-0.2, 0.2, size=3).round(6), unit)}"/>'
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(5))
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{links}{tip}{'</body>' * 5}</worldbody>{loops}"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def shaken(model: mujoco.MjModel, rng: np.random.Generator) -> mujoco.MjModel:
    """Another model, each rounded number anywhere within half a unit of its last digit."""
    other = copy.copy(model)
    for field, row, column, half, _ in roundings(model):
        getattr(other, field)[row, column] += rng.uniform(-half, half)
    for field in ("body_quat", "jnt_axis", "site_quat"):
        A = getattr(other, field)
        A[:] /= np.linalg.norm(A, axis=1, keepdims=True)
    return other


LOOPS = '<equality><weld body1="b4" body2="b1"/><joint joint1="j0" joint2="j1"/></equality>'


def read(model: mujoco.MjModel, qpos: np.ndarray):
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    return JacobianReader(model, ["tip", CenterOfMass()], closure_tolerance=np.inf).at(data)


@pytest.mark.parametrize("loops", ["", LOOPS])
@pytest.mark.parametrize("seed", range(5))
def test_no_number_within_its_rounding_moves_an_entry_farther(seed, loops):
    """And the worst of 40 draws comes within a factor of ten of the largest error."""
    rng = np.random.default_rng(seed)
    model = chain(rng, loops=loops)
    qpos = rng.uniform(-1.0, 1.0, size=model.nq)
    jac, others = read(model, qpos), [read(shaken(model, rng), qpos) for _ in range(40)]
    accuracy = dataclasses.replace(jac, closure_residual=0.0)
    errors = accuracy.J_T_error, accuracy.J_C_error
    natural = accuracy.task_units, accuracy.constraint_units
    for name, error, units in zip(("J_T", "J_C"), errors, natural, strict=True):
        here = getattr(jac, name)
        most = np.max([np.abs(getattr(one, name) - here) for one in others], axis=0)
        assert (most <= 1.01 * error + 1e-15).all()
        assert error.max(initial=0.0) <= 10.0 * most.max(initial=0.0)
        whole = error / units[:, None] * accuracy.velocity_units
        assert whole.max(initial=0.0) <= accuracy.error_bound
    assert accuracy.error_bound < 100.0 * (errors[0] / natural[0][:, None]).max()


SIX_DIGITS = [
    "0.081 0.05 0.237 0.0616248:7 0.0616301:7 -0.704416:6 0.704416:6",
    "0 0.216572:6 0.10541:5 0.00812345:8 0.999941:6 0.00213498:8 0.00701352:8",
]
NO_ZEROS = [
    "0.0128347:7 -0.0405043:7 0.0203:7 0.0616248:7 0.06163:7 -0.704416:6 0.704416:6",
    "0.31:6 0.0188531:7 0.0573:7 0.342813:6 -0.6184:6 0.6186:6 0.342628:6",
]
SIX_DECIMALS = [
    "0.312346:6 -1.2:6 0.0323:6 0.061625:6 0.06163:6 -0.704416:6 0.704416:6",
    "-1.032346:6 1.302:6 0.023432:6 0.999941:6 0.00213:6 0.008123:6 0.007014:6",
]


@pytest.mark.parametrize("numbers", [SIX_DIGITS, NO_ZEROS, SIX_DECIMALS])
def test_no_text_within_its_rounding_moves_an_entry_farther(numbers):
    """Behind each number the decimals it had before its zeros were dropped; none if exact."""
    written = [text.partition(":")[::2] for text in " ".join(numbers).split()]
    exact = np.array([float(x) for x, _ in written])
    halves = np.array(
        [0.5 * 10.0 ** -int(decimals) if decimals else 0.0 for _, decimals in written]
    )
    link = '<body pos="{} {} {}" quat="{} {} {} {}"><joint name="j{}"/><geom size="0.1"/>'

    def moved(part: np.ndarray):
        rows = (exact + part * halves).reshape(2, 7).tolist()
        model = mujoco.MjModel.from_xml_string(
            f"<mujoco><worldbody>{link.format(*rows[0], 0)}{link.format(*rows[1], 1)}"
            f'<site name="tip" pos="{1 / 3} {1 / 7} {1 / 9}"/></body></body></worldbody>'
            '<actuator><motor joint="j0"/><motor joint="j1"/></actuator></mujoco>'
        )
        return read(model, np.array([0.3, -0.7]))

    here, rng = moved(np.zeros(14)), np.random.default_rng(0)
    assert here.accuracy is not None
    error = here.accuracy.J_T_error
    draws = [*rng.uniform(-1.0, 1.0, size=(20, 14)), *rng.choice([-1.0, 1.0], size=(20, 14))]
    for part in draws:
        assert (np.abs(moved(part).J_T - here.J_T) <= 1.01 * error + 1e-11).all()
    alone = sum(np.abs(moved(part).J_T - here.J_T) for part in np.eye(14))
    assert (error <= 3.0 * alone + 1e-11).all()


@pytest.mark.parametrize("unit", [-3, 0, 3])
def test_in_another_unit_of_length_the_natural_errors_are_the_same(unit):
    here, there = (read(chain(np.random.default_rng(1), k), np.full(5, 0.3)) for k in (0, unit))
    a, b = here.accuracy, there.accuracy
    assert a is not None
    assert b is not None
    assert b.structure.length == pytest.approx(a.structure.length * 10.0**unit, rel=1e-9)
    assert b.error_bound == pytest.approx(a.error_bound, rel=1e-6)
    # The slide of 0.3 m is not that of 0.3 of another unit: its joint, and its place, differ.
    turns = [0, 1, 2, 4]
    np.testing.assert_allclose(
        b.J_T_error[:3, turns], a.J_T_error[:3, turns], rtol=1e-5, atol=1e-12
    )


def test_what_is_written_exactly_is_exact():
    """Zeros, ones, numbers of few digits and numbers in full."""
    for name in ("arm", "hand", "platform", "arms", "fjh"):
        assert not roundings(load_model(f"models/{name}.xml"))
    jac = taken(three_rrr())
    assert not jac.accuracy.J_T_error.any()


@pytest.mark.parametrize(("written", "rounded"), [("0.3 0.25 0", 1), ("0.70711 0.21038 0", 5)])
def test_short_numbers_are_exact_unless_most_of_a_file_was_rounded(written, rounded):
    """Of a hand-written file one number was rounded; a program rounded all of its own."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body pos="{written}"><joint/><geom size="0.1"/>'
        '<site pos="0.12345 0.12 -1.5"/></body></worldbody></mujoco>'
    )
    found = roundings(model)
    assert len(found) == rounded
    assert {each.half_unit for each in found} == {0.5e-5, *([0.5e-4] if rounded > 1 else [])}


@pytest.mark.parametrize("seed", range(3))
def test_loops_that_only_rounding_ties_move(seed):
    """A planar machine in space, its lengths of six digits, its axes off by what was rounded."""
    axes = np.tile([0.0, 0.0, 1.0], (7, 1))
    axes[:, :2] = 1e-8 * np.random.default_rng(seed).uniform(-1.0, 1.0, size=(7, 2))
    for model in (three_rrr(six_digits), three_rrr(axes=axes)):
        jac = taken(model)
        kin = ConstrainedSystem.of(jac).kinematics()
        rank = np.linalg.matrix_rank(kin.J, tol=1e-5 * float(np.linalg.norm(jac.J_T)))
        assert (kin.self_motion.shape[1], len(kin.active_constraint), int(rank)) == EXACT
    exact = ConstrainedSystem.of(jac, geometry_accuracy=1e-14).kinematics()
    assert len(exact.active_constraint) > 0


def test_what_the_file_fixes_is_computed_once_and_no_tick_copies_the_model(monkeypatch):
    """Of a robot with meshes a copy takes longer than a tick; each tick decides on the entries."""
    model, copies = three_rrr(six_digits), []
    mechanism, task = Mechanism(model, site="tool"), FrameTask("tool", rows=[3, 4], gain=0.1)
    data = mujoco.MjData(model)
    task.target = pose_of(model, data, "tool").translation_m + np.array([0.02, 0.02, 0.0])
    ik, posture, states = Ik(model, [task]), mechanism.nominal, set()

    def tick(k: int) -> None:
        nonlocal posture
        ik.advance(data, ik.step(data, 0.01), 0.01, into=data)
        posture = mechanism.moved(posture, 1e-3 * k * np.ones(3), np.arange(3))
        jac = mechanism.jacobians(posture)
        ConstrainedSystem.of(jac).kinematics().velocity_mapping([3, 4])
        states.add(jac.accuracy.J_C_error.tobytes())

    copied = mujoco.MjModel.__copy__
    monkeypatch.setattr(mujoco.MjModel, "__copy__", lambda m: copies.append(m) or copied(m))
    for k in range(20):
        tick(k)
    assert len(copies) <= 2  # one of each reader
    assert len(states) == 20  # the errors are those of each pose all the same


def test_a_weak_direction_says_how_well_its_gain_is_known():
    """Next to a stretched pose rounding leaves the gain open, and farther it is lost."""
    model = mujoco.MjModel.from_xml_string("""
    <mujoco><worldbody><body><joint name="a" axis="0 0 1"/><geom size="0.03" mass="1"/>
      <body pos="0.312345 0 0"><joint name="b" axis="0 0 1"/><geom size="0.03" mass="1"/>
        <site name="tip" pos="0.254321 0.000013 0"/></body></body></worldbody>
      <actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>""")
    said = []
    for bend in (1e-2, 2e-5, 1e-6):
        data = mujoco.MjData(model)
        data.qpos[:] = 0.0, bend - 0.000013 / 0.254321
        kin = ConstrainedSystem.of(jacobians(model, data, "tip")).kinematics()
        report = kin.manipulability([3, 4])
        said.append((report.unmanipulable, "+-" in str(report)))
        assert ("+-" in str(kin.velocity_mapping([3, 4]))) == said[-1][1]
    assert said == [(False, False), (False, True), (True, False)]
