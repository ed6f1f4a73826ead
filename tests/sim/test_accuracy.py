"""Accuracy of the geometry estimated from a model, and classifications that depend on it."""

import copy
import dataclasses

import mujoco
import numpy as np
import pytest

from fjh.ik import Ik
from prioritized import ConstrainedSystem
from sim import MODELS, CenterOfMass, FrameTask, JacobianReader, Jacobians, jacobians, load_model
from sim.mjcf.accuracy import roundings
from tests.models import model_of
from tests.motions import kinematics
from tests.sim.machines import state_at, stretched


def three_rrr(
    digits: int = 17, axes: np.ndarray | None = None, base: str = "", driven: str = ""
) -> mujoco.MjModel:
    """Create a planar 3-RRR: seven hinges, axes (7, 3); two connects with a redundant row each."""
    axes = np.tile([0.0, 0.0, 1.0], (7, 1)) if axes is None else axes
    feet = np.array([[np.cos(a), np.sin(a)] for a in (0.5, 0.5 + 2.1, 0.5 + 4.1)]) * 0.87654321
    tips, knees = 0.3 * feet + 0.01234567, np.array([[0.8, 0.3], [-0.75, 0.25], [-0.1, -0.85]])

    def place(v: np.ndarray) -> str:
        return " ".join(f"{x:.{digits}g}" for x in (*v, 0.0))

    def link(name: str, at: np.ndarray, k: int, children: str = "") -> str:
        axis = " ".join(f"{x:.17g}" for x in axes[k])
        joint = f'<joint name="j{k}" axis="{axis}"/><geom size="0.05"/>'
        return f'<body name="{name}" pos="{place(at)}">{joint}{children}</body>'

    legs = [link("platform", tips[0] - knees[0], 6, '<site name="tool"/>'), "", ""]
    for k in range(3):
        shank = link(f"shank{k}", knees[k] - feet[k], 2 * k + 1, legs[k])
        legs[k] = link(f"thigh{k}", feet[k], 2 * k, shank)
    closures = "".join(
        f'<connect body1="shank{k}" body2="platform" anchor="{place(tips[k] - knees[k])}"/>'
        for k in (1, 2)
    )
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option><flag contact="disable"/></option>
      <worldbody><body name="base">{base}<geom size="0.1"/>{"".join(legs)}</body></worldbody>
      <equality>{closures}</equality>
      <actuator><motor joint="j0"/><motor joint="j2"/><motor joint="j4"/>{driven}</actuator>
    </mujoco>""")


def jacobians_of(model: mujoco.MjModel) -> Jacobians:
    return jacobians(model, mujoco.MjData(model), "tool")


def classification(jac: Jacobians, accuracy: float | None = None) -> tuple[int, int, int]:
    """Return the numbers of self-motions and constrained active rates, and the rank of J."""
    kin = ConstrainedSystem(jac.J_T, jac.J_C, jac.active, geometry_accuracy=accuracy).kinematics()
    rank = np.linalg.matrix_rank(kin.J, tol=1e-5 * float(np.linalg.norm(jac.J_T)))
    return kin.self_motion.shape[1], len(kin.active_constraint), int(rank)


def test_exact_numbers_show_no_rounding():
    """Check zeros, ones, numbers of few digits and numbers in full."""
    for name in ("arm", "hand", "platform", "arms", "fjh"):
        assert not roundings(load_model(MODELS / f"{name}.xml"))
    jac = jacobians_of(three_rrr())
    assert jac.geometry_accuracy < 1e-15
    assert not jac.accuracy.J_T_error.any()
    assert classification(jac) == (0, 0, 3)


def test_rounded_numbers_show_their_rounding():
    """Check half a unit of the last of six digits, and a rounded zero of a direction."""
    assert 4e-7 < jacobians_of(three_rrr(digits=6)).geometry_accuracy < 5.1e-6
    for component in range(7):
        axes = np.tile([0.0, 0.0, 1.0], (7, 1))
        axes[component, 0] = 1e-8
        assert 1e-8 <= jacobians_of(three_rrr(axes=axes)).geometry_accuracy < 1.001e-8


@pytest.mark.parametrize("seed", range(5))
def test_skew_axes_do_not_change_the_classification_at_the_models_accuracy(seed):
    """Axes off by 1e-8 would block the machine at an accuracy of zero."""
    skewed = np.tile([0.0, 0.0, 1.0], (7, 1))
    skewed[:, :2] = 1e-8 * np.random.default_rng(seed).uniform(-1.0, 1.0, size=(7, 2))
    for rounded in (three_rrr(digits=6), three_rrr(axes=skewed)):
        jac = jacobians_of(rounded)
        assert jac.geometry_accuracy > 1e-9
        assert classification(jac, jac.geometry_accuracy) == (0, 0, 3)
        kin = ConstrainedSystem.of(jac).kinematics()
        assert (kin.self_motion.shape[1], len(kin.active_constraint)) == (0, 0)
    assert classification(jac)[1] > 0
    exact = ConstrainedSystem.of(jac, geometry_accuracy=1e-14).kinematics()
    assert len(exact.active_constraint) > 0


BASE = '<joint name="base" axis="0.3 -0.5 0.8" pos="0.2 0.1 -0.3"/>'


def parallelogram(base: str, driven: str) -> mujoco.MjModel:
    joint, motor = '<joint name="base" axis="0 0 1"/>', '<motor name="turn" joint="base"/>'
    return model_of("parallelogram", (joint, base), (motor, driven))


@pytest.mark.parametrize("gap", [1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("driven", ["", '<motor joint="base"/>'], ids=["base free", "base driven"])
@pytest.mark.parametrize(
    ("make", "freedoms", "rate"), [(parallelogram, 1, 10), (three_rrr, 3, 150)]
)
def test_loop_gaps_do_not_change_the_classification(make, freedoms, rate, driven, gap):
    """Rates depend on a gap by no more than its size, as rows are taken at one point."""
    mechanism = make(base=BASE, driven=driven)
    expected = (0, 0, freedoms + 1) if driven else (1, 0, freedoms)
    exact = kinematics(jacobians_of(mechanism)).J
    for axis in range(3):
        model = copy.copy(mechanism)
        model.eq_data[-1, axis] += gap
        jac = jacobians(model, mujoco.MjData(model), "tool", closure_tolerance=2e-3)
        assert jac.closure_residual == pytest.approx(gap, rel=1e-3)
        assert classification(jac) == expected
        assert np.abs(kinematics(jac).J - exact).max() < rate * gap + 1e-12


def chain(rng: np.random.Generator, unit: int = 0, loops: str = "") -> mujoco.MjModel:
    """Create five links in space, lengths of six decimals in 10^-unit m, directions of four."""

    def place() -> str:
        return " ".join(f"{x}e{unit}" for x in rng.uniform(-0.2, 0.2, size=3).round(6))

    def direction(size: int) -> str:
        v = rng.normal(size=size)
        return " ".join(map(str, (v / np.linalg.norm(v)).round(4)))

    links = ""
    for k in range(5):
        links += (
            f'<body name="b{k}" pos="{place()}" quat="{direction(4)}"><geom size="0.01" mass="1"/>'
        )
        links += (
            f'<joint name="j{k}" type="{"slide" if k == 3 else "hinge"}" axis="{direction(3)}"/>'
        )
    tip = f'<site name="tip" pos="{place()}"/>'
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(5))
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{links}{tip}{'</body>' * 5}</worldbody>{loops}"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def perturbed(model: mujoco.MjModel, rng: np.random.Generator) -> mujoco.MjModel:
    """Change each rounded number at random within half a unit of its last digit."""
    other = copy.copy(model)
    for field, row, column, half, _ in roundings(model):
        getattr(other, field)[row, column] += rng.uniform(-half, half)
    for field in ("body_quat", "jnt_axis", "site_quat"):
        A = getattr(other, field)
        A[:] /= np.linalg.norm(A, axis=1, keepdims=True)
    return other


def read(model: mujoco.MjModel, qpos: np.ndarray):
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    return JacobianReader(model, ["tip", CenterOfMass()], closure_tolerance=np.inf).at(data)


@pytest.mark.parametrize("draws", [15, pytest.param(40, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "loops",
    ["", '<equality><weld body1="b4" body2="b1"/><joint joint1="j0" joint2="j1"/></equality>'],
)
@pytest.mark.parametrize("seed", range(5))
def test_error_bounds_hold_for_all_numbers_within_their_rounding(seed, loops, draws):
    """The worst of the samples is within a factor of ten of the largest error."""
    rng = np.random.default_rng(seed)
    model = chain(rng, loops=loops)
    qpos = rng.uniform(-1.0, 1.0, size=model.nq)
    jac, others = read(model, qpos), [read(perturbed(model, rng), qpos) for _ in range(draws)]
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


@pytest.mark.parametrize(
    "numbers",
    [
        "0.081 0.05 0.237 0.0616248:7 0.0616301:7 -0.704416:6 0.704416:6 "
        "0 0.216572:6 0.10541:5 0.00812345:8 0.999941:6 0.00213498:8 0.00701352:8",
        "0.0128347:7 -0.0405043:7 0.0203:7 0.0616248:7 0.06163:7 -0.704416:6 0.704416:6 "
        "0.31:6 0.0188531:7 0.0573:7 0.342813:6 -0.6184:6 0.6186:6 0.342628:6",
        "0.312346:6 -1.2:6 0.0323:6 0.061625:6 0.06163:6 -0.704416:6 0.704416:6 "
        "-1.032346:6 1.302:6 0.023432:6 0.999941:6 0.00213:6 0.008123:6 0.007014:6",
    ],
    ids=["six digits", "no zeros", "six decimals"],
)
def test_error_bounds_hold_for_all_decimals_within_the_rounding_of_a_file(numbers):
    """Append random decimals to each rounded number; exact numbers get none."""
    written = [text.partition(":")[::2] for text in numbers.split()]
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
    # A slide of 0.3 m differs from one of 0.3 of another unit in joint and place.
    turns = [0, 1, 2, 4]
    np.testing.assert_allclose(
        b.J_T_error[:3, turns], a.J_T_error[:3, turns], rtol=1e-5, atol=1e-12
    )


@pytest.mark.parametrize(("written", "rounded"), [("0.3 0.25 0", 1), ("0.70711 0.21038 0", 5)])
def test_short_numbers_are_exact_unless_most_of_a_file_was_rounded(written, rounded):
    """A hand-written file has one rounded number; a program rounds all of its numbers."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body pos="{written}"><joint/><geom size="0.1"/>'
        '<site pos="0.12345 0.12 -1.5"/></body></worldbody></mujoco>'
    )
    rounded_numbers = roundings(model)
    assert len(rounded_numbers) == rounded
    assert {number.half_unit for number in rounded_numbers} == {
        0.5e-5,
        *([0.5e-4] if rounded > 1 else []),
    }


def test_no_tick_copies_the_model(monkeypatch):
    """Copying the model of a robot with meshes takes longer than a tick."""
    model, copies = three_rrr(digits=6), []
    data, task = state_at(model), FrameTask("tool", rows=[3, 4], gain=0.1)
    task.target = data.site("tool").xpos + 0.02
    ik = Ik(model, [task])
    copied = mujoco.MjModel.__copy__
    monkeypatch.setattr(mujoco.MjModel, "__copy__", lambda m: copies.append(m) or copied(m))
    for _ in range(20):
        ik.advance(data, ik.step(data, 0.01), 0.01, into=data)
    assert len(copies) <= 1


def test_a_weak_direction_reports_the_uncertainty_of_its_gain():
    """The gain is uncertain by rounding near a stretched pose; nearer, the direction is lost."""
    arm, _ = stretched(1.0, 0.0)
    arm.body_pos[2, 0], arm.site_pos[0] = 0.312345, [0.254321, 0.000013, 0.0]
    arm.site_sameframe[0] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    results = []
    for bend in (1e-2, 2e-5, 1e-6):
        data = state_at(arm, b=bend - 0.000013 / 0.254321)
        kin = ConstrainedSystem.of(jacobians(arm, data, "tip")).kinematics()
        report = kin.manipulability([3, 4])
        results.append((report.unmanipulable, "+-" in str(report)))
        assert ("+-" in str(kin.velocity_mapping([3, 4]))) == results[-1][1]
    assert results == [(False, False), (False, True), (True, False)]


@pytest.mark.parametrize(("offset", "is_dropped"), [(2e-6, False), (9e-7, True), (0.0, False)])
def test_an_offset_that_mujoco_drops_gives_a_warning(offset, is_dropped):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><body>
      <joint axis="0 0 1"/><geom size="0.03" mass="1"/><site name="tip" pos="0 0 0.1"/>
      <site name="near" pos="{offset} 0 0"/></body></worldbody>
      <actuator><motor site="tip" gear="0 0 0 0 0 1"/></actuator></mujoco>""")
    data = state_at(model)
    assert (data.site("near").xpos[0] != offset) == is_dropped
    sentences = jacobians(model, data, "tip").warnings
    assert ["near" in sentence for sentence in sentences] == [True] * is_dropped
