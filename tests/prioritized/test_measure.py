"""Test norms of angles and lengths: results do not depend on the unit of length."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from prioritized import ConstrainedSystem, Status, Task, failure_atlas
from sim import Jacobians, jacobians
from tests.profiles import scaled

_ARM = """<mujoco><compiler boundmass="1" boundinertia="1"/><worldbody>
  <body><joint name="a" axis="0 0 1"/><geom size="{r}"/>
    <body pos="{l1} 0 0"><joint name="b" axis="0 1 0" type="slide"/><geom size="{r}"/>
      <body pos="{l2} {l3} 0"><joint name="c" axis="1 0 0"/><geom size="{r}"/>
        <body pos="0 {l3} {l1}"><joint name="d" axis="1 0 0" type="slide"/><geom size="{r}"/>
          <site name="tip" pos="{l2} 0 {l1}"/></body></body></body></body></worldbody>
  <actuator><motor joint="a"/><motor joint="b"/><motor joint="c"/><motor joint="d"/></actuator>
</mujoco>"""
_TWIST = np.array([0.1, 0.2, -0.1, 0.3, 0.1, 0.2])


def _read(unit: float) -> tuple[Jacobians, np.ndarray]:
    """Return the arm where one metre is `unit`, and the units of its rates."""
    lengths = {"r": 0.02, "l1": 0.41, "l2": 0.23, "l3": 0.17}
    model = mujoco.MjModel.from_xml_string(
        _ARM.format(**{name: unit * length for name, length in lengths.items()})
    )
    data = mujoco.MjData(model)
    rates = np.array([1.0, unit, 1.0, unit])
    data.qpos[:] = np.array([0.3, 0.1, 0.7, -0.05]) * rates
    return jacobians(model, data, "tip"), rates


def _answers(unit: float) -> dict[str, np.ndarray]:
    """Return rates, and scaled torques, that depend on a norm of angles and lengths."""
    jac, of_rate = _read(unit)
    kin, of_task = ConstrainedSystem.of(jac).kinematics(), np.repeat([1.0, unit], 3)
    twist, box = _TWIST * of_task, (-0.1 * of_rate, 0.1 * of_rate)
    rates = {
        "out of reach": kin.velocity_mapping(range(6))(twist),
        "limited and out of reach": kin.velocity_mapping(range(6), rate_limits=box)(twist),
        "least rates": kin.velocity_mapping([3])(twist[3:4]),
    }
    torques = kin.force_mapping([3, 4])(np.array([1.0, 0.4]) / of_task[3:5])
    return {name: each / of_rate for name, each in rates.items()} | {
        "least torques": torques * of_rate,
        "largest gain": kin.velocity_mapping(range(6)).largest_gain,
    }


@pytest.mark.parametrize("exponent", [-3, 2, 3, 6])
def test_no_norm_depends_on_the_unit_of_length(exponent):
    """Compare unreachable and undetermined directions in millimetres and in metres."""
    here, there = _answers(1.0), _answers(10.0**exponent)
    for name, answer in here.items():
        np.testing.assert_allclose(there[name], answer, rtol=1e-6, atol=1e-9, err_msg=name)


def test_the_characteristic_length_is_reported_unless_a_metric_is_stated():
    """Check that the text states the mechanism's length, and that a stated metric has priority."""
    jac, length = _read(1.0)[0], 1.2
    kin, accuracy = ConstrainedSystem.of(jac).kinematics(), jac.accuracy
    mapping = kin.velocity_mapping(range(6))
    assert accuracy is not None
    assert mapping.characteristic_length == accuracy.structure.length
    assert f"{mapping.characteristic_length:.3g}" in str(mapping)
    stated = np.repeat([1.0, 1.0 / length], 3)
    own = kin.velocity_mapping(range(6), major_metric=stated, tie_metric=np.ones(4))
    A = stated[:, None] * kin.J
    np.testing.assert_allclose(own(_TWIST), np.linalg.lstsq(A, stated * _TWIST, rcond=None)[0])
    angles = kin.velocity_mapping([0], joint_weight=np.ones(4))
    assert angles.characteristic_length is None
    force = kin.force_mapping([3, 4])
    assert force.characteristic_length == mapping.characteristic_length


def test_limits_of_rows_of_two_kinds_use_the_metric():
    """Compare the compiled method with levels solved one by one, with a metric."""
    kin = ConstrainedSystem.of(_read(1.0)[0]).kinematics()
    rows, box = np.eye(6)[2:5], (np.full(4, -0.1), np.full(4, 0.1))
    quick = kin.velocity_mapping([2, 3, 4], joint_weight=np.ones(4), rate_limits=box)
    never = (np.eye(4)[:1], np.array([-1e3]), np.array([1e3]))
    slow = kin.velocity_mapping(rows, joint_weight=np.ones(4), rate_limits=box, rate_rows=never)
    a, b = (mapping.solve(_TWIST[2:5]) for mapping in (quick, slow))
    np.testing.assert_allclose(a.rates, b.rates, atol=1e-9)
    assert a.status == b.status
    plain = kin.velocity_mapping(
        rows, joint_weight=np.ones(4), rate_limits=box, major_metric=np.ones(3)
    )
    assert np.abs(plain(_TWIST[2:5]) - a.rates).max() > 1e-3


def _sample(seed: int, unit: float, error: float) -> tuple[ConstrainedSystem, dict[str, Any]]:
    """Sample hinges, slides and loops with natural length `unit`, a task, and units of both."""
    rng = np.random.default_rng(seed)
    n, p, m = (int(rng.integers(*ends)) for ends in ((2, 7), (0, 4), (2, 7)))
    c = int(rng.integers(0, p + 2)) if p else 0
    task, rate, loop = (np.where(rng.random(k) < 0.5, unit, 1.0) for k in (m, n + p, c))
    if rng.random() < 0.3:  # actuators of one kind
        rate[:n] = unit
    U, sigma, V = np.linalg.svd(rng.normal(size=(m, n + p)), full_matrices=False)
    J_T = U * np.where(rng.random(len(sigma)) < 0.5, sigma, 10.0 ** -rng.uniform(3, 7)) @ V
    J_C, one = rng.normal(size=(c, n + p)), np.ones((1, n + p))
    accuracy: Any = SimpleNamespace(
        J_T_error=error * task[:, None] * one / rate,
        J_C_error=error * loop[:, None] * one / rate,
        task_units=task,
        constraint_units=loop,
        velocity_units=rate,
        error_bound=error,
    )
    natural = task[:, None] * J_T / rate, loop[:, None] * J_C / rate
    system = ConstrainedSystem(*natural, range(n), accuracy=accuracy)
    major = sorted(rng.choice(m, rng.integers(1, m + 1), replace=False).tolist())
    left = np.delete(np.arange(m), major)
    v, limit = rng.normal(size=m), rng.uniform(0.3, 1.0)
    given = {"major": major, "left": left, "v": v * task, "task": task, "rate": rate[:n]}
    return system, given | {"limit": limit}


def _solved(seed: int, unit: float, error: float) -> dict[str, Any]:
    """Return classification, rates and torques in natural units, of every kind of mapping."""
    system, of = _sample(seed, unit, error)
    major, v, rate, task = of["major"], of["v"], of["rate"], of["task"]
    kin = system.kinematics()
    report, box = kin.manipulability(major), (-of["limit"] * rate, of["limit"] * rate)
    plain = kin.velocity_mapping(major, joint_weight=1.0 / rate)
    by_secondary = kin.velocity_mapping(major, secondary_weight=1.0 / task[of["left"]])
    limited = kin.velocity_mapping(major, joint_weight=1.0 / rate, rate_limits=box)
    metrics = {"major_metric": 2.0 / task[major], "tie_metric": 1.0 / rate}
    stated = kin.velocity_mapping(major, None, np.append(1.0 / rate[:-1], 0.0), **metrics)
    two = kin.hierarchy([Task(major), Task.joints()])
    three = kin.hierarchy([Task(major[:1]), Task(range(len(task)))])
    others = {
        "by the secondary task": by_secondary.solve(v[major]),
        "limited": limited.solve(v[major]),
        "by stated metrics": stated.solve(v[major]),
        "two levels": two.solve([v[major], None]),
        "three levels": three.solve([v[major[:1]], v]),
    }
    f = v[major] / task[major] ** 2
    force = kin.force_mapping(major, torque_weight=rate).solve(f)
    forces = {"major_metric": 2.0 * task[major], "tie_metric": rate}
    stated_force = kin.force_mapping(
        major, None, np.append(rate[:1], 0.0 * rate[1:]), **forces
    ).solve(f)
    equal = len({*task[major]}) == len({*rate}) == 1
    gain_unit = task[major[0]] / rate[0] if equal else 1.0
    assert (plain.status is Status.LEAST_SQUARES) == (
        report.unmanipulable and not report.unstable_major
    )
    assert plain.rank == kin.velocity_mapping(major).rank
    if not error:
        F, J_Cp = kin.internal_force, system.J_C[:, kin.passive]
        assert (np.abs(F @ J_Cp) <= 1e-12 * np.linalg.norm(J_Cp, axis=0)).all()
    return {
        "gap": float(min(plain.gap, by_secondary.gap, stated.gap)),
        "findings": tuple(finding.holds for finding in report.findings.values()),
        "possible": bool(failure_atlas(system, major, codes=[[0] * len(rate)]).possible[0]),
        "status": plain.status,
        "rank": int(plain.rank),
        "least rates": plain(v[major]) / rate,
        "gains": np.array([report.worst_gain, report.largest_gain]) / gain_unit,
        "torques": force.torques * rate,
        "torques by stated metrics": stated_force.torques * rate,
        "of torques": force.status,
        **{name: each.rates / rate for name, each in others.items()},
        **{f"status {name}": each.status for name, each in others.items()},
    }


@pytest.mark.parametrize("error", [0.0, 1e-6])
@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e4, 1e8])
def test_hinges_and_slides_have_equal_results_in_any_unit(unit, error):
    """Check ranks and statuses, least squares, limits, levels, torques; exact or rounded."""
    for seed in range(scaled(30)):
        here, there = _solved(seed, 1.0, error), _solved(seed, unit, error)
        if min(here.pop("gap"), there.pop("gap")) < 2.0:  # round-off of a unit may decide
            continue
        for name, answer in here.items():
            if isinstance(answer, np.ndarray):
                size = 1.0 + np.abs(answer).max(initial=0.0)
                np.testing.assert_allclose(there[name], answer, atol=1e-7 * size, err_msg=name)
            else:
                assert there[name] == answer, (seed, name)


@pytest.mark.parametrize("seed", range(scaled(10)))
def test_a_mapping_at_another_failure_and_pose_uses_their_units(seed):
    """Check a failed hinge instead of a slide: the remaining rates have other units."""
    system, of = _sample(seed, 0.3, 0.0)
    n, major, rng = len(system.active), of["major"], np.random.default_rng(seed)
    kinds = [int(np.flatnonzero(of["rate"] == unit)[0]) for unit in set(of["rate"].tolist())]
    first, *others = (system.with_failures(locked=[k]).kinematics() for k in kinds)
    W2, box = np.ones(len(of["left"])), (-0.2, 0.3)
    made = first.velocity_mapping(major, None, np.ones(n - 1), W2, rate_limits=box)
    for kin in (first, *others):
        moved = kin.velocity_mapping(major, None, np.ones(n - 1), W2, rate_limits=box)
        v, desired = rng.normal(size=len(major)), rng.normal(size=n - 1)
        there = made.at(kin)
        np.testing.assert_allclose(there(v, desired), moved(v, desired), atol=1e-9)
        a, b = there.solve(v, desired), moved.solve(v, desired)
        np.testing.assert_allclose(a.rates, b.rates, atol=1e-9)
        assert a.status is b.status
        np.testing.assert_allclose(there.joint, moved.joint, atol=1e-9)
