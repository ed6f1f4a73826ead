"""The study of limits in the loop: its oracle, its strategies and its checks."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from experiments.limits.allocation import Strategy, allocated, arm_strategies, loop_strategies
from experiments.limits.arm import RANGE_RAD, Motion, line_of_sight, move
from experiments.limits.conventional import Redistributed
from experiments.limits.measures import longest, room, tuned
from experiments.limits.out_of_reach import excesses
from experiments.limits.results import checks
from experiments.limits.runs import BENCH, HEAVE_M, Case, limits_of
from experiments.rig.hexapod.controller import StrutMapping
from experiments.rig.hexapod.fault_tolerance import strut_and_payload_stiffness
from experiments.rig.hexapod.rig import hexapod_rig, nominal_testbed
from experiments.rig.hexapod.testbed import Testbed
from ftc.controller import PrioritizedController
from ftc.goal import Goal
from prioritized import ConstrainedSystem, velocity_mapping
from sim import Failure, displacement_limits, hexapod
from tests.profiles import examples


def test_the_outline_is_what_bounded_least_squares_can_reach():
    """Inside, some displacements have the pointing; outside, the distance is the least error."""
    rng = np.random.default_rng(0)
    J_m, lower, upper = rng.normal(size=(2, 5)), -rng.uniform(0.1, 1, 5), rng.uniform(0.1, 1, 5)
    kinematics = ConstrainedSystem(J_m, None, range(5)).kinematics()
    corners = kinematics.attainable([0, 1], (lower, upper)).vertices
    points = 3 * rng.normal(size=(60, 2))
    least = [
        np.sqrt(2 * lsq_linear(J_m, point, (lower, upper), method="bvls").cost) for point in points
    ]
    found = room(corners, points)
    np.testing.assert_allclose(-np.minimum(found, 0), least, atol=1e-6)
    assert (found > 0).any()


def test_the_longest_run_of_truth():
    assert longest(np.array([0, 1, 1, 0, 1, 1, 1], dtype=bool)) == 3
    assert longest(np.zeros(4, dtype=bool)) == 0


@pytest.mark.parametrize("name", ["strict", "scaled", "clipping", "redistributed", "weighted"])
def test_every_strategy_is_the_mapping_where_nothing_is_at_a_limit(name):
    """And obeys the limits where they are narrow; the weighted problem within its weight."""
    rng = np.random.default_rng(1)
    system = ConstrainedSystem(rng.normal(size=(4, 6)), None, np.arange(6))
    kinematics, v = system.with_failures(locked=[2]).kinematics(), np.array([0.3, -0.2])
    strategy = Strategy(name, 1e4 if name == "weighted" else None)
    for half in (10.0, 0.05):
        limits = np.full(6, -half), np.full(6, half)
        found = allocated(kinematics, strategy, limits, [0, 1], [2, 3]).solve(v)
        assert np.abs(found.rates).max() <= half
        if half == 10.0:
            expected = kinematics.velocity_mapping([0, 1], joint_weight=np.ones(5))(v)
            np.testing.assert_allclose(found.rates, expected, atol=1e-6)


@examples(40)
@given(st.integers(0, 2**32 - 1))
def test_what_saturated_actuators_lack_the_others_make_up_for(seed):
    """At the result, the rates that move are the pseudo-inverse's for what the others leave.

    So that a task within reach is met where enough of them still move; and none is beyond a limit.
    """
    rng = np.random.default_rng(seed)
    J_m, v, desired = rng.normal(size=(2, 6)), rng.normal(size=2), rng.normal(size=6)
    half = rng.uniform(0.1, 1.0, 6)
    rates = Redistributed(J_m, (-half, half)).solve(v, desired).rates
    assert (np.abs(rates) <= half).all()
    moving = np.abs(rates) < half
    if moving.sum() >= len(v):
        left = v - J_m[:, ~moving] @ rates[~moving] - J_m[:, moving] @ desired[moving]
        expected = desired[moving] + np.linalg.pinv(J_m[:, moving]) @ left
        np.testing.assert_allclose(rates[moving], expected, atol=1e-9)


def test_the_redistributed_pseudo_inverse_is_not_the_least_error_that_limits_allow():
    """Rates (-1.5, 2) are both fixed at (-1, 1), error (0.5, 1); that of (-0.5, 1) is (0, 1)."""
    J_m, v = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([0.5, 2.0])
    limits = -np.ones(2), np.ones(2)
    np.testing.assert_allclose(Redistributed(J_m, limits).solve(v).rates, [-1, 1])
    strict = velocity_mapping(J_m, [0, 1], rate_limits=limits)
    np.testing.assert_allclose(strict(v), [-0.5, 1])


@pytest.mark.long
def test_out_of_reach_strict_priority_misses_by_the_least_and_the_others_by_more(model):
    """The oracle is the distance from the outline of what is attainable."""
    testbed = Testbed(model, BENCH, loops=())  # pyright: ignore[reportArgumentType]
    strategies = Strategy("strict"), Strategy("redistributed"), Strategy("clipping")
    cases = [Case(True, True, each, 0, 1.0, 1.0) for each in strategies]
    most = {one["strategy"]: one["excess_largest_percent"] for one in excesses(testbed, cases, 0)}
    assert most["strict"] < 1e-9
    assert most["redistributed"] > 1
    assert most["clipping"] > 10


def test_each_kind_is_tuned_by_its_least_error_and_compared_with_strict_priority():
    rms = {"strict": 2.0, "strict_winding_up": 1.0, "weighted_1": 5.0, "weighted_3": 3.0}
    runs = [{"strategy": k, "allocation": k.split("_")[0], "rms": v} for k, v in rms.items()]
    expected = {"weighted": {"strategy": "weighted_3", "rms_over_strict": 1.5}}
    assert tuned(runs, "rms") == expected


def test_hot_coils_are_limited_by_current_and_the_others_by_their_stroke(model):
    lower, upper = limits_of(Testbed(model, BENCH, loops=()))  # pyright: ignore[reportArgumentType]
    assert upper[[1, 4]] == pytest.approx(2.0 * 20.0 / 126e3)
    assert upper[[0, 2, 3, 5]] == pytest.approx(635e-6, rel=1e-4)
    assert -lower == pytest.approx(upper, rel=1e-4)
    assert upper.min() > HEAVE_M


def test_names_of_runs_differ():
    names = [
        Case(stuck, heave, strategy, 0, 1.0, 1.0).name
        for stuck in (False, True)
        for heave in (False, True)
        for strategy in loop_strategies(quick=False)
    ]
    assert len(set(names)) == len(names)
    assert set(arm_strategies(quick=True)) <= set(arm_strategies(quick=False))


def test_the_arms_path_begins_and_ends_where_it_looks_at_first():
    views = line_of_sight(np.linspace(0, 40, 401), 40.0)
    np.testing.assert_allclose(np.linalg.norm(views, axis=1), 1)
    np.testing.assert_allclose(views[[0, -1]], [[0, 0, 1]] * 2, atol=1e-12)
    assert np.arccos(views[:, 2]).max() == pytest.approx(0.9)


@pytest.mark.long
def test_the_arms_joints_stay_within_their_range_and_the_elbow_where_it_locks():
    run = move(Motion(Strategy("strict"), 16.0))
    assert np.abs(run.joint_rad).max() <= RANGE_RAD + 1e-12
    locked = run.joint_rad[len(run.time_s) // 2 + 1 :, 3]
    assert np.ptp(locked) == 0.0


@pytest.mark.long
def test_near_a_singularity_the_demand_stays_bounded_but_the_amplifiers_saturate(model):
    """One pointing direction is lost at the nominal pose, and back with a gain of 1e-5 beside it.

    An exact mapping spends all that limits allow on it: they do not replace damping.
    """
    stiffness = strut_and_payload_stiffness(model)
    testbed = replace(nominal_testbed(), stiffness=stiffness)
    goal = Goal(joint_weight=(1.0,) * 6, locked_at={2: 0.0, 5: 0.0}, free=(0, 3))
    strike = [Failure(2, "locked"), Failure(5, "locked"), Failure(0, "free"), Failure(3, "free")]
    box = displacement_limits(model, testbed.amplifier())
    demand_rad, saturated = {}, {}
    for name, limits in (("without", None), ("within", box)):
        mapping = StrutMapping(hexapod(model), goal, "analytic", stiffness, limits=limits)
        controller = PrioritizedController(
            testbed.loops, mapping, testbed.amplifier(), 0.0, anti_windup=True
        )
        path = testbed.bench.spiral_rad(2.0)
        run = hexapod_rig(testbed).fly(controller, path, failures=strike)
        demand_rad[name] = np.abs(run.state.asked.demand).max()
        saturated[name] = (np.abs(run.inputs) > 99.9).any(axis=1).mean()
    assert demand_rad["within"] < 0.3 * demand_rad["without"]
    assert min(saturated.values()) > 0.5


def failed(summary) -> list[str]:
    return [str(check) for check in checks(summary) if not check.passed]


def test_the_data_give_the_errors_of_the_json(limits, limits_folder):
    with np.load(limits_folder / "spirals.npz") as data:
        for spiral in limits["spirals"]:
            error = np.linalg.norm(data["desired_rad"] - data[f"{spiral['name']}_true_rad"], axis=1)
            assert spiral["rms_urad"] == pytest.approx(1e6 * np.sqrt((error**2).mean()))


def test_where_the_target_is_attainable_strict_priority_points_as_without_limits(limits):
    spirals = {spiral["name"]: spiral for spiral in limits["spirals"]}
    for condition in limits["conditions"]:
        strict, unlimited = (
            spirals[f"{condition['name']}_{name}"] for name in ("strict", "unlimited")
        )
        assert strict["attainable_rms_urad"] < 1.03 * unlimited["attainable_rms_urad"]
        assert strict["rms_urad"] > condition["least_rms_urad"]


@pytest.mark.parametrize(
    ("place", "key", "value", "said"),
    [
        (0, "rms_urad", 1e4, "RMS error of strict priority over that of clipping, tuned"),
        (1, "rms_urad", 1.0, "RMS error with anti-windup over that without"),
        (0, "recovery_s", 0.6, "time from an attainable target to recovered pointing"),
        (0, "beyond_limit_um", 0.03, "command beyond its limit [um]"),
        (0, "rest_peak_urad", 6.0, "pointing error at rest afterwards [urad]"),
        (0, "closure_residual_max_m", 2e-8, "closure residual [m]"),
    ],
)
def test_each_check_of_the_hexapod_fails_on_spoilt_numbers(limits, place, key, value, said):
    assert failed(limits) == []
    spoilt = copy.deepcopy(limits)
    spoilt["spirals"][place][key] = value
    assert any(said in sentence for sentence in failed(spoilt))


@pytest.mark.parametrize(
    ("strategy", "key", "value", "said"),
    [
        ("strict", "rms_mrad", 1e4, "RMS error of strict priority over that of clipping"),
        ("strict", "peak_mrad", 11.0, "peak error of strict priority [mrad]"),
        ("clipping", "beyond_limit_rad", 1e-6, "joint beyond its limit [rad]"),
    ],
)
def test_each_check_of_the_arm_fails_on_spoilt_numbers(limits, strategy, key, value, said):
    spoilt = copy.deepcopy(limits)
    for run in spoilt["arm"]["runs"]:
        if run["strategy"] == strategy:
            run[key] = value
    assert any(said in sentence for sentence in failed(spoilt))
    spoilt = copy.deepcopy(limits)
    spoilt["conditions"][0]["circle_margin"] = -0.1
    assert any("circle criterion" in sentence for sentence in failed(spoilt))
    spoilt = copy.deepcopy(limits)
    spoilt["out_of_reach"]["strategies"][0]["excess_largest_percent"] = 1e-3
    assert any("above the least possible" in sentence for sentence in failed(spoilt))
