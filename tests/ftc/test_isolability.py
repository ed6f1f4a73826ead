"""Which failures of the hexapod look alike, without simulated noise."""

from dataclasses import replace

import numpy as np
import pytest

from fjh.rig.hexapod.fault_tolerance import HEAVE, STILL, nominal_model
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.prediction import linear_loop
from ftc import LinearLoop, simulate
from ftc.fdi import (
    CERTAIN,
    KINDS,
    Cause,
    Dither,
    Fault,
    NominalModel,
    Uncertainty,
    fault_model,
    isolability,
)
from ftc.fdi.bank import hypothesis_bank
from ftc.fdi.separation import distances as from_causes
from ftc.fdi.uncertainty import TYPICAL
from tests.ftc.test_excitation import LOOSE, mechanism

BENCH, RIG = TestbedConfig(), hexapod_rig()
DITHER = Dither(0.5e-6, 20.0, HEAVE)
ANGLES, GAUGES = RIG.nominal, nominal_model(RIG.model, BENCH, strut_sensors=True)
ONSET = 1500
STRUT_1 = np.eye(6)[0]


def dithered(duration_s: float, dither: Dither = DITHER) -> LinearLoop:
    """The loop on a part of the spiral from 6 s on."""
    return linear_loop(RIG, BENCH.spiral_rad(duration_s, begin_s=6.0), dither)


def distances(
    dither: Dither,
    fault: Fault,
    ticks: int,
    seen: NominalModel = ANGLES,
    uncertainty: Uncertainty = CERTAIN,
) -> tuple[np.ndarray, float]:
    """Of a failure at 1.5 s of a spiral, after so many ticks."""
    until = ONSET + ticks
    loop = dithered((until + 1) * BENCH.control_period_s, dither)
    states, commanded = simulate(loop, [fault], ONSET)
    return isolability(seen, fault, ONSET, states[:until], commanded[:until], uncertainty)


@pytest.mark.parametrize("strut", [0, pytest.param(1, marks=pytest.mark.long)])
def test_without_dither_antipodal_struts_look_alike_and_with_it_they_do_not(strut):
    """J_m has opposite columns there, and W_a drives both alike; a heave drives them against it."""
    lock = Fault(strut, "locked")
    still, sure = distances(STILL, lock, 500)
    assert still[strut + 3, 0] < 4 < 40 < sure
    assert np.delete(still, [strut, strut + 3], axis=0).min() > 40
    shaken, _ = distances(DITHER, lock, 500)
    assert np.delete(shaken, strut, axis=0).min() > 25


def test_a_turn_about_the_line_of_sight_tells_no_antipodal_struts_apart_and_a_heave_does():
    """Of the null directions of J_m it matters which: gamma moves both struts of a pair as W_a."""

    def apart(direction: tuple[float, ...]) -> float:
        found, _ = distances(Dither(0.5e-6, 20.0, direction), Fault(0, "locked"), 500)
        return float(found[3].min())

    turn, heave = apart((1.0, -1.0, 1.0, -1.0, 1.0, -1.0)), apart(HEAVE)
    assert turn < 7 < 25 < heave


def test_gauges_on_the_struts_tell_all_apart_without_a_dither():
    found, _ = distances(STILL, Fault(2, "free"), 100, GAUGES)
    assert np.delete(found, 2, axis=0).min() > 100


def test_the_distance_from_no_failure_is_that_of_the_outputs():
    """Tick by tick, in standard deviations; means over four ticks lose a few percent."""
    fault = Fault(0, "free")
    states, commanded = simulate(dithered(1.7), [fault], ONSET)
    sound = fault_model(ANGLES)
    apart = (states - sound.states(commanded)[:-1]) @ sound.C.T
    _, found = isolability(ANGLES, fault, ONSET, states, commanded)
    assert 0.9 < found / np.linalg.norm(apart) < 1.0


def test_an_uncertain_model_tells_less_and_the_failure_itself_is_at_distance_zero():
    fault = Fault(2, "locked")
    sure, from_none = distances(DITHER, fault, 200)
    unsure, from_none_unsure = distances(DITHER, fault, 200, uncertainty=TYPICAL)
    assert sure[2, KINDS.index("locked")] == unsure[2, KINDS.index("locked")] == 0.0
    others = np.delete(np.arange(6), 2)
    assert (unsure[others] < sure[others] + 1e-6).all()
    assert 0 < from_none_unsure < from_none


@pytest.mark.parametrize("kind", KINDS)
def test_distances_are_the_same_at_twice_and_half_the_control_rate(kind):
    """Of the same evidence: as many onsets a second, and noise of the same density."""
    found = []
    for period_s in (5e-4, 1e-3, 2e-3):
        plant = mechanism(1)
        density = np.sqrt(2e-3 / period_s)
        seen = replace(plant, period_s=period_s, step_s=5e-4, noise=density * plant.noise)
        fault, times = Fault(1, kind, 0.5 * (kind == "weak")), np.arange(0.0, 0.6, period_s)
        commanded = 1e-3 * np.sin(np.outer(times, [10.0, 25.0, 40.0]))
        onset = round(0.3 / period_s)
        before = fault_model(seen).states(commanded[:onset])
        after = fault_model(seen, [fault])
        struck = after.states(commanded[onset:], after.onset @ before[-1])
        states = np.vstack([before[:-1], struck[:-1]])
        apart, from_none = isolability(seen, fault, onset, states, commanded, LOOSE)
        found.append([*np.delete(apart, 1, axis=0).ravel(), from_none])
    for other in (found[0], found[2]):
        np.testing.assert_allclose(other, found[1], rtol=0.05)


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


@pytest.mark.parametrize(
    ("cause", "commands", "scale"),
    [
        (Cause("offset", 0), lambda s, u: u + 1e-6 * (s >= 0) * STRUT_1, 1.0),
        (Cause("offset", 0), lambda s, u: u + 1e-5 * np.maximum(s, 0) * STRUT_1, 1.0),
        (Cause("supply"), lambda s, u: u * (1 - 0.2 * (s >= 0)), 1.0),
        (Cause("scale"), lambda s, u: u, 1.2),
    ],
    ids=["offset of 1 um", "drift of 10 um/s", "supply of 80 %", "scale of 1.2"],
)
def test_what_is_no_failure_is_far_from_every_failure(cause, commands, scale):
    """On the spiral, 0.2 s after it began, before the loops have answered: d is above 6.2."""
    until = ONSET + 200
    since_s = ((np.arange(until) - ONSET) * ANGLES.period_s)[:, None]
    commanded = simulate(dithered(1.71), [], ONSET)[1][:until]
    sound, bank = fault_model(ANGLES), hypothesis_bank(ANGLES, (), TYPICAL, 4)
    moved = sound.states(commands(since_s, commanded))[:-1] @ sound.C.T
    outputs = moved * np.where(since_s < 0, 1.0, scale)
    found, from_none = from_causes(
        bank, cause, ONSET, outputs, commanded, (ANGLES.period_s, 4), TYPICAL
    )
    assert 40 < found.min() < from_none
