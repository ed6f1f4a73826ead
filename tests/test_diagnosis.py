"""Which actuator has failed: models, residual test, hypotheses and dither, one by one."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import binom

from experiments.hexapod.controller import nominal_loops
from experiments.hexapod.fault_tolerance import (
    HEAVE,
    STILL,
    excitation,
    fault_of,
    fault_text,
    nominal_model,
)
from experiments.hexapod.prediction import linear_loop
from experiments.hexapod.testbed import Testbed, TestbedConfig
from ftc.fdi.calibration import calibrated
from ftc.fdi.diagnosis import DEFAULT_CONFIG, MonitorState
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import KINDS, Fault, NominalModel, fault_model
from ftc.fdi.hypotheses import LOST, hypothesis_bank
from ftc.fdi.isolability import isolability
from ftc.fdi.monitor import Monitor, monitor
from ftc.fdi.residual_test import WINDOWS, residual_test
from ftc.goal import Goal
from ftc.linear_loop import LinearLoop, simulate
from sim import Failure, LinearPlant, Plant, failed_plant, linearize, load_model

MODEL, BENCH = load_model(), TestbedConfig()
LOOPS = nominal_loops(MODEL, BENCH)
GOAL = Goal(joint_weight=(1.0,) * 6)
DITHER = Dither(0.5e-6, 20.0, HEAVE)
ANGLES = nominal_model(MODEL, BENCH)
GAUGES = nominal_model(MODEL, BENCH, strut_sensors=True)
C_ANGLES = fault_model(ANGLES).C
ONSET = 1500

failures = pytest.mark.parametrize("kind", KINDS)
struts = pytest.mark.parametrize("strut", range(6))


def loop(dither: Dither = DITHER, begin_s: float = 6.0, duration_s: float = 2.2):
    return linear_loop(
        Testbed(MODEL, BENCH, LOOPS), GOAL, dither, begin_s=begin_s, duration_s=duration_s
    )


def stepped(plant: LinearPlant) -> tuple[np.ndarray, np.ndarray]:
    """A and B of a control tick, step by step of the physics, from its continuous model."""
    h, k = MODEL.opt.timestep, len(plant.A) // 2
    A, B = np.eye(2 * k), np.zeros((2 * k, 6))
    for _ in range(round(BENCH.control_period_s / h)):
        A[k:], B[k:] = A[k:] + h * plant.A[k:] @ A, B[k:] + h * (plant.A[k:] @ B + plant.B[k:])
        A[:k], B[:k] = A[:k] + h * A[k:], B[:k] + h * B[k:]
    return A, B


@failures
@struts
def test_the_failed_machine_is_that_of_the_failed_simulation(strut, kind):
    """Derived from the sound machine alone, it moves like MuJoCo's with the strut really failed."""
    plant = failed_plant(MODEL, [Failure(strut, kind, effectiveness=0.4)])
    real = linearize(plant.model, plant.data)
    A, B = stepped(real)
    sound = Plant(MODEL)
    machine = fault_model(ANGLES, [Fault(strut, kind, 0.4)])
    driven = [k for k in range(6) if kind != "locked" or k != strut]  # a lock bears its own coil
    for hz in (0.5, 5.0, 20.0, 35.0):
        z = np.exp(2j * np.pi * hz * ANGLES.period_s)
        expected = real.C_twist @ np.linalg.solve(z * np.eye(len(A)) - A, B)[:, driven]
        found = np.linalg.solve(z * np.eye(12) - machine.A, machine.B)[:, driven]
        found = linearize(sound.model, sound.data).C_twist @ found
        assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()


@struts
def test_a_strut_that_locks_stops_and_stays(strut):
    """The impact takes its speed, and never adds energy; afterwards it does not move by a hair."""
    machine = fault_model(ANGLES, [Fault(strut, "locked")])
    rng = np.random.default_rng(strut)
    x = rng.normal(size=12) * 1e-6
    c = ANGLES.displacement[strut]
    after = machine.onset @ x
    assert abs(c[:6] @ after[6:]) < 1e-18
    np.testing.assert_array_equal(after[:6], x[:6])
    # A coil pushes along M^-1 c^T, and so does the impact.
    along = ANGLES.plant.B[6:, strut]
    change = after[6:] - x[6:]
    np.testing.assert_allclose(change, along * (along @ change) / (along @ along), atol=1e-18)
    stands = c @ after
    for _ in range(2000):
        after = machine.A @ after + machine.B @ (rng.normal(size=6) * 1e-6)
    assert c @ after == pytest.approx(stands, abs=1e-15)


def test_only_what_is_looked_for_can_be_found():
    assert fault_of(Failure(2, "weak", effectiveness=0.3)) == Fault(2, "weak", 0.3)
    assert fault_text(Fault(2, "weak", 0.3)) == "strut 3 weak to 30 %"
    assert fault_text(Fault(0, "locked")) == "strut 1 locked" and fault_text(None) == "sound"
    with pytest.raises(ValueError, match="kind must be one of locked, free, weak, got loose"):
        fault_of(Failure(0, "loose"))


# --- the residual test


@pytest.mark.parametrize("outputs", [2, 8])
def test_the_residual_test_keeps_the_rate_of_false_alarms_that_it_was_given(outputs):
    """Ticks in alarm: not more than stated, nor so much less that another bound would do."""
    per_hour = 20000.0
    watch = residual_test(outputs, per_hour, 1e-3)
    rng = np.random.default_rng(0)
    alarms = np.stack([watch.alarms(rng.standard_normal((8000, outputs))) for _ in range(150)])
    rate = alarms.mean() * 3600 / 1e-3
    assert 0.5 * per_hour < rate < 1.1 * per_hour


def test_tick_by_tick_the_residual_test_alarms_where_it_does_on_the_whole_record():
    watch = residual_test(2, 1e5, 1e-3)
    residuals = np.random.default_rng(1).standard_normal((3000, 2))
    recent, online = watch.start(), []
    for residual in residuals:
        recent = watch.push(recent, residual)
        online.append(watch.alarm(recent) > 0)
    assert 0 < np.sum(online) < len(online)
    np.testing.assert_array_equal(online, watch.alarms(residuals))


@pytest.mark.parametrize("shift, longest", [(20.0, 1), (3.0, 8), (0.5, 256)])
def test_a_small_shift_is_seen_over_a_long_window_and_a_large_one_at_once(shift, longest):
    watch = residual_test(2, 0.01, 1e-3)
    recent = np.zeros((WINDOWS[-1], 2))
    ticks = 0
    while not (window := watch.alarm(recent)):
        recent = watch.push(recent, np.array([shift, 0.0]))
        ticks += 1
    assert window <= longest and ticks <= longest


# --- the hypotheses


def history(fault: Fault | None, seen: NominalModel, seed: int = 0, dither: Dither = DITHER):
    """Commands and outputs of a linear run, as the bank gets them."""
    states, sent = simulate(loop(dither), [] if fault is None else [fault], ONSET)
    rng = np.random.default_rng(seed)
    C = fault_model(seen).C
    y = states @ C.T + rng.standard_normal((len(states), len(C)))
    return np.vstack([np.zeros(6), sent[:-1]]), y


def gathered(hypotheses, onsets, sent, y):
    evidence, x = hypotheses.start(np.asarray(onsets)), np.zeros(12)
    for tick, (u, outputs) in enumerate(zip(sent, y, strict=True)):
        x = hypotheses.believed.A @ x + hypotheses.believed.B @ u
        evidence = hypotheses.step(evidence, tick, x, u, outputs)
    return evidence, x


def log_likelihood(fault: Fault | None, onset: int, seen, sent, y) -> float:
    """By simulating the hypothesis on its own: the independent oracle."""
    machine, x, total = fault_model(seen), np.zeros(12), 0.0
    for tick, (u, outputs) in enumerate(zip(sent, y, strict=True)):
        x = machine.A @ x + machine.B @ u
        if fault is not None and tick == onset:
            machine = fault_model(seen, [fault])
            x = machine.onset @ x
        total -= ((outputs - machine.C @ x) ** 2).sum() / 2
    return total


@failures
def test_the_bank_weighs_what_simulating_each_hypothesis_would(kind):
    fault = Fault(1, kind, 0.4)
    sent, y = history(fault, ANGLES)
    onsets = [ONSET - 20, ONSET, ONSET + 20]
    hypotheses = hypothesis_bank(ANGLES)
    evidence, _ = gathered(hypotheses, onsets, sent, y)
    none = log_likelihood(None, 0, ANGLES, sent, y)
    ratios = evidence.best_log_likelihood_ratios()
    for j, onset in enumerate(onsets):
        for other in (Fault(1, "locked"), Fault(4, "free")):
            expected = log_likelihood(other, onset, ANGLES, sent, y) - none
            found = ratios[other.actuator, KINDS.index(other.kind), j]
            assert found == pytest.approx(expected, rel=1e-6, abs=1e-5)
        part = evidence.likely_parts()[2, j]
        expected = log_likelihood(Fault(2, "weak", 1 - part), onset, ANGLES, sent, y) - none
        assert ratios[2, 2, j] == pytest.approx(expected, rel=1e-6, abs=1e-5)


def test_a_weak_coil_is_weighed_over_every_loss_it_may_have():
    """The mean likelihood over the loss, against numerical integration, wherever the peak lies."""
    evidence = hypothesis_bank(ANGLES).start(np.arange(4))
    slope = np.array([[0.0, 3.0, -40.0, 60.0]] * 6)
    curvature = np.array([[0.0, 5.0, 20.0, 50.0]] * 6)
    evidence = replace(evidence, lost_slope=slope[:, None], lost_curvature=curvature[:, None])
    for j in range(4):
        n, d = slope[0, j], curvature[0, j]
        mean = quad(lambda p, n=n, d=d: np.exp(p * n - p**2 * d / 2), *LOST)[0] / np.diff(LOST)[0]
        assert evidence.log_likelihood_ratios()[0, 2, j] == pytest.approx(np.log(mean), abs=1e-8)


@failures
@struts
def test_each_failure_is_found_in_the_linear_model(strut, kind):
    fault = Fault(strut, kind, 0.4)
    sent, y = history(fault, ANGLES, seed=strut)
    hypotheses = hypothesis_bank(ANGLES)
    evidence, x = gathered(hypotheses, range(ONSET - 40, ONSET + 40, 4), sent, y)
    verdict = hypotheses.verdict(evidence, len(y) - 1, x)
    assert (verdict.fault.actuator, verdict.fault.kind) == (strut, kind)
    assert verdict.actuator_confidence > 0.999 and verdict.p_value > 1e-4
    assert verdict.onset == ONSET
    if kind == "weak":
        assert verdict.fault.effectiveness == pytest.approx(0.4, abs=0.02)
    states, _ = simulate(loop(), [fault], ONSET)
    np.testing.assert_allclose(verdict.x @ C_ANGLES.T, states[-1] @ C_ANGLES.T, atol=0.3)


@pytest.mark.long
def test_confidence_is_what_it_says():
    """With little evidence, as many verdicts are right as they claim: any strut, kind, or none."""
    rng, noisy = np.random.default_rng(5), replace(ANGLES, noise=10 * ANGLES.noise)
    hypotheses, claimed, right = hypothesis_bank(noisy), [], 0
    onsets, until = (ONSET, ONSET + 4), ONSET + 14
    way = loop(duration_s=1.6)
    for _ in range(60):
        strut, kind = int(rng.integers(6)), KINDS[rng.integers(3)]
        fault = Fault(strut, kind, 1 - rng.uniform(*LOST)) if kind == "weak" else Fault(strut, kind)
        faults = [fault] if rng.random() < 0.5 else []
        states, sent = simulate(way, faults, int(rng.choice(onsets)))
        y = states[:until] @ hypotheses.believed.C.T + rng.standard_normal((until, 2))
        evidence, x = gathered(hypotheses, onsets, np.vstack([np.zeros(6), sent[: until - 1]]), y)
        verdict = hypotheses.verdict(evidence, until - 1, x)
        sound = verdict.fault_free_confidence > verdict.actuator_confidence
        claimed.append(max(verdict.fault_free_confidence, verdict.actuator_confidence))
        right += not faults if sound else bool(faults) and verdict.fault.actuator == strut
    assert 0.4 < np.mean(claimed) < 0.95  # it is not a foregone conclusion
    low, high = binom.interval(0.998, len(claimed), np.mean(claimed))
    assert low <= right <= high


def test_a_coil_that_weakens_again_is_weak_by_the_product():
    known = Fault(2, "weak", 0.5)
    twice = Fault(2, "weak", 0.25)
    way = loop()
    states, sent = simulate(way, [known], 0)
    machine, x = fault_model(ANGLES, [twice]), states[ONSET]
    for tick in range(ONSET, len(states)):
        states[tick] = x
        x = machine.A @ x + machine.B @ sent[tick]
    y = states @ C_ANGLES.T + np.random.default_rng(3).standard_normal((len(states), 2))
    hypotheses = hypothesis_bank(ANGLES, [known])
    evidence, x = gathered(
        hypotheses, range(ONSET - 20, ONSET + 20, 4), np.vstack([np.zeros(6), sent[:-1]]), y
    )
    verdict = hypotheses.verdict(evidence, len(y) - 1, x)
    assert (verdict.fault.actuator, verdict.fault.kind) == (2, "weak")
    assert verdict.fault.effectiveness == pytest.approx(0.25, abs=0.02)


def test_without_evidence_failure_is_as_likely_as_none_and_all_are_alike():
    hypotheses = hypothesis_bank(ANGLES)
    verdict = hypotheses.verdict(hypotheses.start(np.arange(4)), 3, np.zeros(12))
    assert verdict.fault_free_confidence == pytest.approx(1 / 2)
    assert verdict.actuator_confidence == pytest.approx(1 / 2 / 6, rel=1e-4)
    assert verdict.kind_confidence == pytest.approx(1 / 3, rel=1e-4)


def test_where_no_strut_is_left_there_is_nothing_to_look_for():
    with pytest.raises(ValueError, match="must leave a working actuator"):
        hypothesis_bank(ANGLES, [Fault(k, "locked") for k in range(6)])


# --- who looks like whom


def distances(way: LinearLoop, hypotheses, fault: Fault, until: int):
    states, commanded = simulate(way, [fault], ONSET)
    return isolability(hypotheses, fault, ONSET, states[:until], commanded[:until])


@pytest.mark.long
def test_without_dither_antipodal_struts_look_alike_and_with_it_they_do_not():
    """J_m has opposite columns there, and W_a drives both alike; a heave drives them against it."""
    hypotheses = hypothesis_bank(ANGLES)
    for strut in range(3):
        lock, until = Fault(strut, "locked"), ONSET + 500
        still, sure = distances(loop(STILL), hypotheses, lock, until)
        assert still[strut + 3, 0] < 3 < 50 < sure
        others = np.delete(still, [strut, strut + 3], axis=0)
        assert others.min() > 50
        shaken, _ = distances(loop(), hypotheses, lock, until)
        assert np.delete(shaken, strut, axis=0).min() > 30


def test_a_turn_about_the_line_of_sight_tells_no_antipodal_struts_apart_and_a_heave_does():
    """Of the null directions of J_m it matters which: gamma moves both struts of a pair as W_a."""
    hypotheses = hypothesis_bank(ANGLES)

    def apart(direction: tuple[float, ...]) -> float:
        way = loop(Dither(0.5e-6, 20.0, direction))
        found, _ = distances(way, hypotheses, Fault(0, "locked"), ONSET + 500)
        return float(found[3].min())

    assert apart((1.0, -1.0, 1.0, -1.0, 1.0, -1.0)) < 6
    assert apart(HEAVE) > 30


def test_gauges_on_the_struts_tell_all_apart_without_a_dither():
    hypotheses = hypothesis_bank(GAUGES)
    found, _ = distances(loop(STILL), hypotheses, Fault(2, "free"), ONSET + 100)
    assert np.delete(found, 2, axis=0).min() > 100


@pytest.mark.parametrize("hz", [1.0, 8.0, 20.0, 35.0])
def test_pointing_does_not_see_the_heave_and_sees_each_strut_that_leaves_it(hz):
    """By the threefold symmetry, at any frequency; the six signatures are 60 degrees apart."""
    machine, C = fault_model(ANGLES), ANGLES.plant.C
    z = np.exp(2j * np.pi * hz * ANGLES.period_s)
    by_strut = C @ np.linalg.solve(z * np.eye(12) - machine.A, machine.B)
    heave = by_strut @ np.array(HEAVE)
    assert np.abs(heave).max() < 1e-6 * np.abs(by_strut).max()
    if hz < 10:
        angles = np.sort(np.degrees(np.arctan2(by_strut[1].real, by_strut[0].real)))
        np.testing.assert_allclose(np.diff(angles), 60, atol=1.0)


# --- the monitor


def watched(seen, sent, y, faults=()) -> tuple[Monitor, MonitorState]:
    watch = monitor(seen, faults)
    state = watch.start()
    for u, outputs in zip(sent, y, strict=True):
        state = watch.step(state, outputs * seen.noise, u)
        if state.diagnosis is not None and state.diagnosis.confirmed:
            watch, state = watch.believing(state)
    return watch, state


@pytest.mark.parametrize("seen", [ANGLES, GAUGES], ids=["angles", "gauges"])
def test_a_sound_machine_raises_no_alarm(seen):
    _, state = watched(seen, *history(None, seen))
    assert state.evidence is None and state.diagnosis is None


@pytest.mark.parametrize("seen", [ANGLES, GAUGES], ids=["angles", "gauges"])
@failures
def test_a_failure_is_named_in_time_and_its_strut_located(seen, kind):
    sent, y = history(Fault(4, kind, 0.4), seen)
    _, state = watched(seen, sent, y)
    found = state.diagnosis
    assert found is not None and found.fault.actuator == 4
    assert found.onset_tick - ONSET + 3 >= 0 and found.tick - ONSET < 60
    assert found.actuator_confidence >= DEFAULT_CONFIG.confidence


@pytest.mark.long
def test_after_its_confirmation_the_failed_machine_is_the_believed_one():
    """Its residuals are noise again: no further alarm, and no strut is suspected twice."""
    fault = Fault(3, "locked")
    states, sent = simulate(loop(duration_s=3.5), [fault], ONSET)
    y = states @ C_ANGLES.T + np.random.default_rng(2).standard_normal((len(states), 2))
    watch, state = watched(ANGLES, np.vstack([np.zeros(6), sent[:-1]]), y)
    assert watch.faults == (fault,) and 3 not in watch.bank.actuators
    assert state.evidence is None and not state.unexplained


@pytest.mark.long
def test_a_shock_that_is_no_struts_is_named_by_nobody_and_the_watch_goes_on():
    """The pointing jumps by itself for a tenth of a second; a strut that locks later is found."""
    states, sent = simulate(loop(duration_s=5.2), [Fault(4, "locked")], ONSET + 3000)
    rng = np.random.default_rng(4)
    y = states @ C_ANGLES.T + rng.standard_normal((len(states), 2))
    y[ONSET : ONSET + 100] += 30 * rng.standard_normal((100, 2))
    before = np.vstack([np.zeros(6), sent[:-1]])
    _, early = watched(ANGLES, before[: ONSET + 2500], y[: ONSET + 2500])
    assert early.diagnosis is None and early.evidence is None
    assert len(early.alarm_ticks) >= 1
    _, state = watched(ANGLES, before, y)
    assert state.diagnosis is not None and state.diagnosis.fault == Fault(4, "locked")


@pytest.mark.long
def test_what_goes_on_unexplained_is_given_up_and_said():
    """A sway of the line of sight at 3 Hz is no strut's failure."""
    sent, y = history(None, ANGLES)
    y[:, 0] += 20 * np.sin(2 * np.pi * 3 * BENCH.time_s(2.2))
    longer = np.vstack([sent, sent]), np.vstack([y, y])
    _, state = watched(ANGLES, *longer)
    assert state.diagnosis is None and state.unexplained


def test_calibration_finds_the_gains_of_the_coils():
    """From a run that moves every direction; the pattern that pointing never sees, too."""
    true = 1 + 0.01 * np.random.default_rng(0).standard_normal(6)
    wrong = ANGLES.with_gains(true)
    base = loop(STILL, begin_s=0.0, duration_s=4.0)
    time_s = BENCH.time_s(4.0)
    way = replace(base, nominal=wrong, secondary=np.array([excitation(t) for t in time_s]))
    states, sent = simulate(way, [], 10**9)
    y = states @ C_ANGLES.T + np.random.default_rng(1).standard_normal((len(states), 2))
    found = calibrated(ANGLES, sent, y).plant.B
    np.testing.assert_allclose(found, wrong.plant.B, rtol=3e-3, atol=1e-9)


# --- any mechanism


def bench_of_springs(n: int = 3) -> NominalModel:
    """Three carts on springs, pushed by an actuator each; all are measured, in millimetres."""
    rng = np.random.default_rng(0)
    mass, coupling = np.diag(rng.uniform(1, 2, n)), rng.normal(size=(n, n))
    stiffness = 400 * np.eye(n) + 20 * coupling @ coupling.T
    lower = -np.linalg.solve(mass, np.hstack([stiffness, 0.1 * stiffness]))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [lower]])
    B = np.vstack([np.zeros((n, n)), 400 * np.linalg.inv(mass)])
    displacement = np.eye(n, 2 * n)
    plant = control.ss(A, B, 1e3 * displacement, 0)
    return NominalModel(plant, displacement, np.full(n, 0.01), period_s=2e-3, step_s=1e-3)


@failures
@pytest.mark.parametrize("actuator", range(3))
def test_three_actuators_of_another_mechanism_are_told_apart(actuator, kind):
    """From random commands; an effectiveness is found, too."""
    nominal, fault = bench_of_springs(), Fault(actuator, kind, 0.4 * (kind == "weak"))
    rng = np.random.default_rng(actuator)
    sent = np.cumsum(1e-3 * rng.standard_normal((1000, 3)), axis=0)
    before, after = fault_model(nominal), fault_model(nominal, [fault])
    states = before.states(sent[:300])
    states = np.vstack([states[:-1], after.states(sent[300:], after.onset @ states[-1])])
    y = states[:-1] @ nominal.plant.C.T + nominal.noise * rng.standard_normal((1000, 3))
    watch, state = monitor(nominal), monitor(nominal).start()
    for measured, u in zip(y, np.vstack([np.zeros(3), sent[:-1]]), strict=True):
        state = watch.step(state, measured, u)
        if state.diagnosis is not None and state.diagnosis.confirmed:
            watch, state = watch.believing(state)
    (found,) = watch.faults
    assert (found.actuator, found.kind) == (actuator, kind)
    assert found.effectiveness == pytest.approx(fault.effectiveness, abs=0.02)
    assert state.diagnosis is None and not state.unexplained and len(state.alarm_ticks) == 1


def test_several_sequences_of_commands_at_once_give_what_each_gives():
    commanded = np.random.default_rng(0).standard_normal((20, 6, 2))
    model = fault_model(GAUGES, [Fault(2, "locked")])
    together = model.outputs(commanded)
    for c in range(2):
        np.testing.assert_allclose(together[..., c], model.outputs(commanded[..., c]), atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"plant": np.eye(2)}, "plant must be"),
        ({"plant": control.ss(np.eye(6), np.ones((6, 3)), np.ones((3, 6)), 0)}, r"\[q; q_dot\]"),
        ({"displacement": np.zeros((2, 6))}, "displacement must be"),
        ({"noise": np.array([1.0, 0.0, 1.0])}, "noise must be"),
        ({"period_s": 0.0}, "period_s must be"),
        ({"step_s": 1.0}, "step_s must not exceed period_s"),
    ],
)
def test_a_model_of_another_shape_is_refused_by_the_name_of_its_part(change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        replace(bench_of_springs(), **change)


@pytest.mark.parametrize("wrong", [(-1, "locked"), (0, "loose"), (0, "weak", 1.5)])
def test_a_fault_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match=r"^(actuator|kind|effectiveness) must"):
        Fault(*wrong)
