"""Test invariances of the mappings: equal results by all methods, in batches, and in threads."""

import copy
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import prioritized
from prioritized import (
    ConstrainedSystem,
    ForceMapping,
    Task,
    VelocityMapping,
    failure_atlas,
    force_mapping,
    lexicographic_least_squares,
    velocity_mapping,
    viable_rates,
)
from prioritized._mechanism.names import Names
from tests.frozen import writable
from tests.profiles import examples
from tests.random_systems import SEEDS, failures, major_and_secondary, orthogonal, systems, weights

MADE = pytest.mark.parametrize("made", [velocity_mapping, force_mapping])


def by_gains(mapping, *goals):
    gains = mapping.major, mapping.joint, mapping.secondary
    pairs = zip(gains, goals, strict=True)
    return sum(np.einsum("...ij,...j->...i", gain, aim) for gain, aim in pairs)


@given(st.data(), systems(), st.sampled_from([0.3, 3.0, np.inf]))
@examples(200)
def test_all_methods_give_equal_rates(data, sample, size):
    """Check any ranks and failures, another pose, with limits and without."""
    here, rng = data.draw(failures(sample.system)), sample.rng
    N_all, first = len(sample.system.active), here.kinematics()
    there = here.at(orthogonal(rng, len(here.J_T)) @ here.J_T)
    kin = there.kinematics()
    m, n = kin.J.shape
    major, others = major_and_secondary(data, m)
    W = data.draw(weights(N_all, rng)), data.draw(weights(len(others), rng))
    lower, upper = (size * rng.uniform(0.5, 2.0, N_all) for _ in range(2))
    box, wide = (-lower, upper), (-20 * lower, 20 * upper)
    own = -lower[kin.actuators], upper[kin.actuators]
    goals = rng.normal(size=len(major)), rng.normal(size=n), rng.normal(size=len(others))

    made = kin.velocity_mapping(major, None, *W, rate_limits=box)
    result = made.solve(*goals)
    free, known = kin.velocity_mapping(major, None, *W), first.velocity_mapping(major, None, *W)
    known(*goals)  # it stores its arguments
    before = first.velocity_mapping(major, None, *W, rate_limits=wide)
    before(*goals)
    moved = known.at(kin, rate_limits=box)
    methods: dict[str, Any] = {
        "called": made,
        "called with lists": lambda *goals: made(*(aim.tolist() for aim in goals)),
        "within": free.with_limits(own),
        "from another pose": moved,
        "from other limits there": before.at(kin, rate_limits=box),
        "lists from another pose": lambda *goals: moved(*(aim.tolist() for aim in goals)),
        "targets from another pose": lambda *goals: moved(*(np.stack([a, -a]) for a in goals))[0],
        "solved from another pose": lambda *goals: moved.solve(*goals).rates,
        "one of a batch of postures": lambda *goals: (
            there.postures(there.J_T[None])
            .velocity_mapping(major, None, *W)
            .with_limits(own)(*goals)[0]
        ),
        "one of a batch of targets": lambda *goals: made(*(np.stack([a, -a]) for a in goals))[0],
    }
    scale = max(1.0, np.abs(result.rates).max(initial=0.0))
    for name, method in methods.items():
        loose = 1e-6 if "postures" in name else 1e-9 * scale
        np.testing.assert_allclose(method(*goals), result.rates, rtol=0, atol=loose, err_msg=name)
    assert moved.status is made.status
    assert ((own[0] <= result.rates) & (result.rates <= own[1])).all()
    nothing = goals[0], np.zeros(n), np.zeros(len(others))
    for mapping in (free, known.at(kin)):
        np.testing.assert_allclose(mapping(*goals), by_gains(mapping, *goals), atol=1e-7)
        np.testing.assert_allclose(mapping(goals[0]), by_gains(mapping, *nothing), atol=1e-7)
        np.testing.assert_allclose(mapping.solve(*goals).rates, mapping(*goals), atol=1e-7)


@pytest.mark.parametrize("kind", ["i8", "f4", ">f8", "F"])
def test_arrays_of_any_type_and_memory_order_are_accepted(kind):
    """Compare arrays that need conversion with plain ones."""
    J, w = np.array([[1, 2, 0], [0, 1, 3]]), np.array([1, 2, 3])

    def other(A: np.ndarray) -> np.ndarray:
        strided = np.repeat(A, 2)[::2] if A.ndim == 1 else np.asfortranarray(A)
        return strided.astype(float) if kind == "F" else A.astype(kind)

    for limits in (None, (np.full(3, -1), np.ones(3))):
        arguments = {"joint_weight": w.astype(float), "rate_limits": limits}
        expected = velocity_mapping(J.astype(float), [0], **arguments)([1.0], np.ones(3))
        arguments |= {"joint_weight": other(w)}
        arguments |= {"rate_limits": limits and tuple(map(other, limits))}
        result = velocity_mapping(other(J), [0], **arguments)(other(np.ones(1)), other(np.ones(3)))
        np.testing.assert_allclose(result, expected, atol=1e-15)
        arguments |= {"joint_weight": np.diag(w)}
        np.testing.assert_allclose(
            velocity_mapping(J, [0], **arguments)([1], [1] * 3), expected, atol=1e-15
        )


def test_cached_selections_do_not_accept_invalid_rows():
    """Check that True, which equals 1, is refused as an index."""
    J, w = np.random.default_rng(0).normal(size=(3, 3)), np.ones(3)
    velocity_mapping(J, [1], [0], w)
    for major, secondary in (([True], [0]), ([1], [False]), ([1.0], [0])):
        with pytest.raises((TypeError, ValueError), match=r"major|secondary"):
            velocity_mapping(J, major, secondary, w)


@pytest.mark.parametrize("of", ["velocity", "force", "hierarchy", "levels"])
def test_the_previous_solution_is_a_warm_start(of):
    """Compare warm with cold start: equal results in fewer steps."""
    rng, steps, limits = np.random.default_rng(0), np.zeros(2), (np.full(6, -0.3), np.full(6, 0.3))
    for _ in range(20):
        J, v = rng.normal(size=(4, 6)), 3 * rng.normal(size=4)
        kin = ConstrainedSystem(J, None, range(6)).kinematics()

        def solve(v: np.ndarray, start: Any = None, J: Any = J, kin: Any = kin) -> Any:
            if of == "levels":
                levels = [(J[:2], v[:2]), (J[2:], v[2:])]
                return lexicographic_least_squares(levels, *limits, start=start)
            if of == "hierarchy":
                hierarchy = kin.hierarchy([Task([0, 1]), Task([2, 3])], rate_limits=limits)
                return hierarchy.solve([v[:2], v[2:]], start=start)
            mapping = kin.velocity_mapping if of == "velocity" else kin.force_mapping
            listed = {"rate_limits" if of == "velocity" else "torque_limits": limits}
            return mapping([0, 1], **listed).solve(v[:2], start=start)

        cold, warm = solve(1.01 * v), solve(1.01 * v, solve(v))
        points = [getattr(result, "optimum", result).point for result in (cold, warm)]
        np.testing.assert_allclose(points[1].x, points[0].x, rtol=0, atol=1e-9)
        steps += [point.steps[0] for point in points]
    assert steps[1] < steps[0]


def contradictions() -> Iterator[tuple[str, Callable[..., Any], dict[str, Any]]]:
    """Return messages, and calls whose arguments are valid each, but not together."""
    J = np.eye(2)
    system = ConstrainedSystem(J, None, [0, 1])
    kin, wide = system.kinematics(), ConstrainedSystem(np.eye(3), None, [0, 1, 2]).kinematics()
    mapping, hierarchy = kin.velocity_mapping([0]), kin.hierarchy([Task([0]), Task([1])])
    batch = {"J": np.stack([J, J]), "major": [0]}
    yield "leading axes must broadcast", velocity_mapping, batch | {"scale": np.ones(3)}
    interval = [Task([0], interval=True), Task([1])]
    yield "interval as its only task", kin.hierarchy, {"levels": [interval]}
    yield "rows of levels", kin.hierarchy, {"levels": [Task([7])]}
    yield "targets must be 2, one for each level", hierarchy.solve, {"targets": [[1.0]]}
    yield "kinematics must", hierarchy.at, {"kinematics": wide}
    yield "kinematics must have a J of shape", mapping.at, {"kinematics": wide}
    least = {"levels": [(J, np.zeros(2))]}
    yield "rows must be given with", lexicographic_least_squares, least | {"rows_lower": 0.0}
    yield "lower and upper", lexicographic_least_squares, least | {"lower": 1.0, "upper": 0.0}
    made = {"J_T": J, "J_C": None, "active": [0, 1]}
    tolerances = {"geometry_accuracy": 1e-6, "rank_tolerance": 1e-8}
    yield "with another rank_tolerance", ConstrainedSystem, made | tolerances
    yield "2 velocities and 2 actuators", ConstrainedSystem, made | {"names": Names(("a",), ())}
    atlas = {"system": system, "major": [0], "codes": [[0, 0]]}
    limits = -np.ones((3, 2)), np.ones((3, 2))
    yield "rate_limits must be two numbers", failure_atlas, atlas | {"rate_limits": limits}


def test_contradictory_arguments_raise():
    for message, call, arguments in contradictions():
        with pytest.raises(ValueError, match=message) as error:
            call(**arguments)
        assert "\n" not in str(error.value)


def test_rates_satisfy_a_loop_that_ties_the_actuators_at_another_pose():
    """Check a loop whose passive joint cannot move any more, unlike at the first pose."""
    J_T, loop = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[1.0, -1.0, 1.0]])
    system = ConstrainedSystem(J_T, loop, [0, 1])
    mapping = system.kinematics().velocity_mapping([0], joint_weight=np.ones(2))
    np.testing.assert_allclose(mapping.at(system.kinematics())(np.ones(1)), [1, 0], atol=1e-14)
    tied = system.at(J_C=loop * [1.0, 1.0, 0.0]).kinematics()
    np.testing.assert_allclose(mapping.at(tied)(np.ones(1)), [1, 1], atol=1e-14)


LEAD = (2, 3)
AXES = st.sampled_from([None, (), (3,), LEAD])
"""Batch axes of an argument; None omits it."""
TALL = st.sampled_from([0, 1, 3])


@MADE
@given(st.data(), SEEDS, st.integers(1, 4), st.integers(1, 3))
def test_any_arguments_may_be_batches_with_or_without_secondary_rows(made, data, seed, n, m):
    """Check J, weights, metrics, constraint, self-motion, velocities and forces, some singular."""
    rng, m1 = np.random.default_rng(seed), data.draw(st.integers(1, m))
    m2 = m - m1 if data.draw(st.booleans()) else 0
    W = "joint_weight" if made is velocity_mapping else "torque_weight"
    shapes = {
        W: (data.draw(TALL), n),
        "secondary_weight": (data.draw(TALL), m2),
        "active_constraint": (1, n),
        "self_motion": (m, 1),
        "major_metric": (m1, m1),
        "tie_metric": (data.draw(TALL), n),
    }
    J = rng.normal(size=(*(data.draw(AXES) or ()), m, n))
    J[rng.random(J.shape[:-2]) < 0.2, 0] = 0.0  # unreachable
    axes = {name: data.draw(AXES) for name in shapes}
    given_ = {
        k: rng.normal(size=(*lead, *shapes[k])) for k, lead in axes.items() if lead is not None
    }
    if W in given_:
        given_[W][..., data.draw(st.integers(0, 3)) :, :] = 0.0
    inputs = [rng.normal(size=(*(data.draw(AXES) or ()), size)) for size in (m1, n, m2)]
    task: dict[str, Any] = {"major": range(m1), "secondary": range(m1, m1 + m2)}

    mapping = made(J, **task, **given_)
    own = np.broadcast_shapes(*(A.shape[:-2] for A in (J, *given_.values())))
    lead = np.broadcast_shapes(own, *(x.shape[:-1] for x in inputs))
    assert mapping(*inputs).shape == (*lead, n)
    assert mapping.rank.shape == mapping.gap.shape == own
    assert mapping.major.shape == (*own, n, m1)
    names = ["rank", "largest_gain", "achieved"]
    names += ["reaction"] * (made is force_mapping)
    kinds = ["__call__", *(["secondary_force", "internal_force"] * (made is force_mapping))]

    def part(A: np.ndarray, own: int, at: tuple[int, ...]) -> np.ndarray:
        """Return the last `own` axes of one element."""
        return np.broadcast_to(A, (*lead, *A.shape[A.ndim - own :]))[at]

    def answers(of: Any, *goals: np.ndarray) -> list[np.ndarray]:
        result = [getattr(of, kind)(*goals) for kind in kinds]
        return [*result, of.residual(goals[0]), *(np.asarray(getattr(of, name)) for name in names)]

    together = answers(mapping, *inputs)
    for at in np.ndindex(lead):
        weighed = {name: part(A, 2, at) for name, A in given_.items()}
        alone = made(part(J, 2, at), **task, **weighed)
        expected = answers(alone, *(part(x, 1, at) for x in inputs))
        for all_of, one in zip(together, expected, strict=True):
            size = 1 + np.abs(one).max(initial=0.0)
            np.testing.assert_allclose(part(all_of, one.ndim, at), one, atol=1e-6 * size)


@pytest.mark.parametrize(("n", "p", "m"), [(6, 2, 6), (9, 2, 4), (4, 3, 5), (3, 3, 3)])
def test_a_batch_has_the_rates_of_its_elements_near_a_singularity(n, p, m):
    """Check a first major row that decreases to below the rank threshold."""
    rng, count = np.random.default_rng(0), 53
    J = rng.normal(size=(count, m, n))
    J[:, 0] = J[:, p - 1] + np.logspace(0, -16, count)[:, None] * J[:, 0]
    v, joint, secondary = (rng.normal(size=(count, k)) for k in (p, n, m - p))
    weights = rng.uniform(0.5, 2.0, size=n), rng.uniform(0.5, 2.0, size=m - p)
    together = velocity_mapping(J, list(range(p)), None, *weights)(v, joint, secondary)
    for k in range(count):
        alone = velocity_mapping(J[k], list(range(p)), None, *weights)(v[k], joint[k], secondary[k])
        least = np.linalg.svd(J[k, :p], compute_uv=False)[-1]
        error = 1e-14 / least if least > 1e-11 else 1e-9
        np.testing.assert_allclose(together[k], alone, rtol=0, atol=error * (1 + abs(alone).max()))


@pytest.mark.parametrize("when", ["least_squares", "scaled"])
@pytest.mark.parametrize("constrained", [False, True])
def test_a_batch_within_limits_equals_its_elements(when, constrained):
    rng = np.random.default_rng(0)
    J, v = rng.normal(size=(4, 3, 5)), rng.normal(size=(2, 4, 2))
    C = rng.normal(size=(4, 1, 5)) if constrained else None
    task: Any = {"major": [0, 1], "joint_weight": np.ones(5)}
    task |= {"rate_limits": (-0.3, 0.4), "when_limited": when}
    result = velocity_mapping(J, active_constraint=C, **task).solve(v)
    for i, k in np.ndindex(2, 4):
        C_k = None if C is None else C[k]
        alone = velocity_mapping(J[k], active_constraint=C_k, **task).solve(v[i, k])
        np.testing.assert_allclose(result.rates[i, k], alone.rates, atol=1e-9)
        np.testing.assert_allclose(result.scale[i, k], alone.scale, atol=1e-9)
        assert result.limited[i, k] == alone.limited
        np.testing.assert_allclose(result.gains[i, k], alone.gains, atol=1e-7)


Method = Callable[[np.ndarray], np.ndarray]
UNKEPT = "least squares"
THREADED = [
    *(
        "velocity",
        "limited",
        "limited, solved",
        "scaled",
        "force",
        "hierarchy",
        "attainable",
        UNKEPT,
    )
]


def methods(J: Any, w: Any, low: Any, high: Any, v: Any) -> dict[str, Method]:
    """Return the results of records made from these arrays, for two numbers or for v."""
    box = low, high
    kin = ConstrainedSystem(J, None, range(6)).kinematics()
    limited = kin.velocity_mapping([0, 1], joint_weight=w, rate_limits=box)
    scaled = kin.velocity_mapping([0, 1], rate_limits=box, when_limited="scaled")
    force = kin.force_mapping([0, 1], torque_weight=np.diag(w), torque_limits=box)
    hierarchy = kin.hierarchy([Task([0, 1], w[:2]), Task.joints(w)], rate_limits=box)
    velocity, torques = limited.solve(v), force.solve(v)
    rates, x = hierarchy.solve([v, None]), lexicographic_least_squares([(J[:2], v)], *box)
    return {
        "velocity": kin.velocity_mapping([0, 1], joint_weight=w),
        "velocity of a matrix": velocity_mapping(J, [0, 1], None, w, w[:2], rate_limits=box),
        "force of a matrix": force_mapping(J, [0, 1], None, w, w[:2]),
        "limited": limited,
        "limited, solved": lambda v: limited.solve(v).rates,
        "scaled": scaled,
        "force": force,
        "hierarchy": lambda v: hierarchy([v, None]),
        "attainable": kin.attainable([0, 1], box).support,
        "kinematics": lambda v: v @ kin.J[:2],
        "residual of rates": lambda _: velocity.residual,
        "residual of torques": lambda _: torques.residual,
        "residuals of levels": lambda _: rates.residuals[0],
        "residuals": lambda _: x.residuals[0],
        UNKEPT: lambda v: lexicographic_least_squares([(J[:2], v)], *box).x,
    }


def fresh() -> list[np.ndarray]:
    rng = np.random.default_rng(37)
    sides = np.full(6, -0.1), np.full(6, 0.1)
    return [rng.normal(size=(4, 6)), rng.uniform(0.5, 2.0, 6), *sides, np.array([2.0, -0.5])]


def test_arguments_are_copied():
    """Check that a mapping, a mechanism and a solution copy their arguments."""
    given_, retained, requested = fresh(), fresh(), np.array([0.3, -0.2])
    result, expected = methods(*given_), methods(*retained)
    for A in given_:
        A[:] = 9.0
    for name in result.keys() - {UNKEPT}:
        np.testing.assert_array_equal(
            result[name](requested), expected[name](requested), err_msg=name
        )


@pytest.mark.parametrize("how", [copy.copy, copy.deepcopy, lambda A: pickle.loads(pickle.dumps(A))])
def test_a_copy_of_a_mapping_gives_equal_rates(how: Callable[[Any], Any]):
    for name, method in methods(*fresh()).items():
        if isinstance(method, VelocityMapping | ForceMapping):
            method(np.ones(2))
            np.testing.assert_array_equal(how(method)(np.ones(2)), method(np.ones(2)), err_msg=name)


@pytest.mark.usefixtures("switching")
@pytest.mark.parametrize("name", THREADED)
def test_four_threads_give_the_results_of_one(name):
    """Check that no result depends on the order of calls."""
    call, count = methods(*fresh())[name], 200 if "limited" in name or name == "velocity" else 20
    targets = np.random.default_rng(0).uniform(-1.0, 1.0, size=(count, 2))
    alone = [call(v) for v in targets]
    with ThreadPoolExecutor(4) as pool:
        orders = [np.roll(np.arange(count), 17 * k) for k in range(4)]
        for order, answers in zip(
            orders, pool.map(lambda order: [call(targets[k]) for k in order], orders), strict=True
        ):
            np.testing.assert_array_equal(answers, [alone[k] for k in order])


def test_results_are_read_only():
    """Check read-only arrays: the next tick starts from them, and reports share them."""
    A, box = np.ones((3, 4)), (-0.1 * np.ones(3), np.ones(3))
    system = ConstrainedSystem(np.eye(3, 5) + 0.1, np.ones((1, 5)), [0, 1, 2], stiffness=np.ones(5))
    kin = system.kinematics()
    limited = kin.velocity_mapping([0], rate_limits=box)
    positions = {"position_limits": (-1, 1), "rate_limits": (-1, 1), "acceleration_limits": (-1, 1)}
    records = {
        "system": system,
        "kinematics": kin,
        "postures": system.postures(np.stack([system.J_T, 2 * system.J_T])),
        "manipulability": kin.manipulability([0]),
        "atlas": failure_atlas(system, [0]),
        "attainable": kin.attainable([0], box),
        "velocity mapping": limited,
        "force mapping": kin.force_mapping([0]),
        "velocity": limited.solve([1.0]),
        "scaled": kin.velocity_mapping([0], rate_limits=box, when_limited="scaled").solve([1.0]),
        "inside": limited.solve([1e-3]),
        "force": kin.force_mapping([0], torque_limits=box).solve([1.0]),
        "hierarchy": kin.hierarchy([Task([0]), Task([1])], rate_limits=box).solve([[1.0], [0.5]]),
        "lexicographic": lexicographic_least_squares(
            [(A, np.ones(3))], -np.ones(4), 0.1 * np.ones(4), rows=A[:1], rows_lower=[9.0]
        ),
        "viable": viable_rates([0.0], [0.0], **positions, period_s=0.1),
    }
    for name, record in records.items():
        assert list(writable(prioritized, name, record)) == []
    for name, of in (("velocity", "rates"), ("force", "torques"), ("lexicographic", "x")):
        with pytest.raises(ValueError, match="read-only"):
            getattr(records[name], of)[:] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        limited.major[...] = 0.0
