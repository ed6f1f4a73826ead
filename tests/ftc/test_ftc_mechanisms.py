"""The control stack on a mechanism that is no hexapod: two arms of twelve joints carry one load.

Its major task is the load's position, three channels. Compensators and prediction come from the
linear model as numbers, and the loop is closed in MuJoCo's physics.
"""

from dataclasses import dataclass, replace

import control
import mujoco
import numpy as np
import pytest

from ftc import (
    DirectDrive,
    Goal,
    LocalGeometry,
    LoopShape,
    Measurement,
    OracleController,
    PrioritizedController,
    PrioritizedMapping,
    Stage,
    compensator,
    margins,
    steps,
)
from ftc.control import NoResponse, UnstableLoop
from ftc.fdi.fault_model import FaultModel
from prioritized import ConstrainedSystem
from sim import HEXAPOD_MJCF, Failure, Plant, jacobians, linearize, load_model

MODEL = load_model(HEXAPOD_MJCF.with_name("arms.xml"))
MAJOR, SECONDARY = [3, 4, 5], [0, 1, 2]
PERIOD_S = 1e-3
SHAPE = LoopShape(crossover_hz=2.0, roll_off_hz=8.0, roll_off_damping=0.7)
EQUAL = Goal(joint_weight=(1.0,) * 12)
JOINT = 1
"""That locks: the shoulder of the first arm."""
LOCK_TICK, TICKS = 1000, 1800

_DATA = mujoco.MjData(MODEL)
JAC = jacobians(MODEL, _DATA, site="payload", axes="base")
LINEAR = linearize(MODEL, _DATA)
SYSTEM = ConstrainedSystem(JAC.J_T, JAC.J_C, JAC.active)

_TIME_S = PERIOD_S * np.arange(TICKS)
REFERENCE = 2e-3 * np.sin(np.pi * np.outer(_TIME_S, [1.0, 0.8, 0.6]))
"""Of the load's position, [m], shape (N, 3)."""


def mapping(goal: Goal = EQUAL, system: ConstrainedSystem = SYSTEM) -> PrioritizedMapping:
    return PrioritizedMapping(LocalGeometry(system), goal, MAJOR, SECONDARY)


def channel(row: int) -> control.StateSpace:
    drive = LINEAR.B @ mapping().major_gain()[:, [row]]
    return control.ss(LINEAR.A, drive, LINEAR.C_twist[[MAJOR[row]]], 0)


COMPENSATORS = [compensator(channel(row), SHAPE, PERIOD_S) for row in range(3)]


def controller(own: PrioritizedMapping) -> PrioritizedController:
    return PrioritizedController(COMPENSATORS, own, DirectDrive(), handover_s=0.3)


@dataclass(frozen=True)
class Run:
    """True position of the load (N, 3), joints and commands (N, 12)."""

    position_m: np.ndarray
    joint_rad: np.ndarray
    command_rad: np.ndarray

    def rms_error_m(self, ticks: slice) -> np.ndarray:
        """Of each channel, shape (3,)."""
        return np.sqrt(((REFERENCE - self.position_m)[ticks] ** 2).mean(axis=0))


def run(pilot: OracleController, ticks: int = TICKS, lock_tick: int | None = None) -> Run:
    """The closed loop in physics; the joint locks at a tick."""
    plant, state, kept = Plant(MODEL), pilot.start(), []
    for tick in range(ticks):
        if tick == lock_tick:
            Failure(JOINT, "locked").strike(plant)
        position_m, joints = plant.pose().translation_m, plant.displacements()
        state = pilot.step(state, REFERENCE[tick], Measurement(position_m, joints))
        kept.append((position_m, joints, state.inputs))
        plant.step(state.inputs, PERIOD_S)
    return Run(*(np.array(column) for column in zip(*kept, strict=True)))


def unaware(own: PrioritizedMapping) -> OracleController:
    return OracleController(controller(own), controller(own), None)


def predicted_m() -> np.ndarray:
    """The same loop with the linear plant, shape (N, 3)."""
    P = control.c2d(control.ss(LINEAR.A, LINEAR.B, LINEAR.C_twist[MAJOR], 0), PERIOD_S, "zoh")
    s = len(P.A)
    first = Stage(FaultModel(P.A, P.B, P.C, np.eye(s), np.zeros(s)), gain=mapping().major_gain())
    ticks = steps([first], P.C, COMPENSATORS, REFERENCE)
    return np.array([tick.output for tick in ticks])


@pytest.fixture(scope="module")
def sound() -> Run:
    return run(unaware(mapping()))


@pytest.fixture(scope="module")
def stuck_rad(sound) -> float:
    """Where the joint locks."""
    return float(sound.joint_rad[LOCK_TICK, JOINT])


@pytest.fixture(scope="module")
def reconfigured(stuck_rad) -> Run:
    known = replace(EQUAL, locked_at={JOINT: stuck_rad})
    oracle = OracleController(controller(mapping()), controller(mapping(known)), LOCK_TICK)
    return run(oracle, lock_tick=LOCK_TICK)


SECOND_HALF = slice(LOCK_TICK + 300, TICKS)
"""When what the lock's impact has done is over."""


def check(one: Run) -> None:
    """The load tracks, as the linear model says."""
    predicted = predicted_m()[: len(one.position_m)]
    reference = REFERENCE[: len(one.position_m)]
    off = np.linalg.norm(one.position_m - predicted) / np.linalg.norm(reference - predicted)
    assert off < 0.03, off
    assert np.linalg.norm(reference - one.position_m) < 0.5 * np.linalg.norm(reference)


def test_the_load_follows_as_the_linear_model_predicts(sound):
    check(sound)


@pytest.mark.parametrize("mutation", ["swapped joints", "a sign", "another scale"])
def test_a_wrong_mapping_does_not(mutation):
    J_T, J_C = SYSTEM.J_T.copy(), SYSTEM.J_C.copy()
    if mutation == "swapped joints":
        swapped = JAC.active[[2, 0]]
        J_T[:, JAC.active[[0, 2]]], J_C[:, JAC.active[[0, 2]]] = J_T[:, swapped], J_C[:, swapped]
    else:
        J_T[3] *= -1.0 if mutation == "a sign" else 0.8
    own = mapping(system=ConstrainedSystem(J_T, J_C, SYSTEM.active))
    with pytest.raises(AssertionError):
        check(run(unaware(own), ticks=600))


def test_the_transfer_to_the_locked_mapping_makes_no_step(sound, reconfigured):
    """The commands change at the tick no faster than before it or long after it."""
    survivors = np.delete(np.arange(12), JOINT)
    change = np.abs(np.diff(reconfigured.command_rad[:, survivors], axis=0))
    others = [np.abs(np.diff(sound.command_rad[:, survivors], axis=0)), change[SECOND_HALF]]
    usual = np.concatenate(others).max(axis=0)
    around = change[LOCK_TICK - 1 : LOCK_TICK + 2].max(axis=0)
    assert (around < 1.5 * usual + 1e-9).all(), around / usual
    # Without the transfer they do.
    before, after = (
        controller(mapping()),
        controller(mapping(Goal((1.0,) * 12, locked_at={1: 0.0}))),
    )
    state = replace(before.start(), asked=before.mapping.nothing())
    for tick in range(400):
        state = before.step(state, REFERENCE[tick], Measurement(np.zeros(3), np.zeros(12)))
    bare, bumpless = (
        after.step(each, REFERENCE[400], Measurement(np.zeros(3), np.zeros(12)))
        for each in (state, after.transfer(state))
    )
    steps_rad = [np.abs((each.inputs - state.inputs)[survivors]).max() for each in (bare, bumpless)]
    assert steps_rad[0] > 10 * steps_rad[1]


def test_with_the_joint_locked_the_load_follows_as_before(sound, reconfigured, stuck_rad):
    """J_m M = I whatever has failed and is known; unknown, the lock costs the position."""
    before, after = (each.rms_error_m(SECOND_HALF) for each in (sound, reconfigured))
    np.testing.assert_allclose(after, before, rtol=0.1)
    assert abs(stuck_rad) > 1e-4
    assert np.abs(reconfigured.joint_rad[LOCK_TICK:, JOINT] - stuck_rad).max() < 1e-6
    lost = run(unaware(mapping()), lock_tick=LOCK_TICK).rms_error_m(SECOND_HALF)
    assert (np.abs(lost / before - 1)).max() > 0.3


def test_the_compensators_have_the_crossover_asked_for_and_margins_measured_apart():
    for row, one in enumerate(COMPENSATORS):
        L = control.c2d(channel(row), PERIOD_S, "zoh") * one.discrete
        found = margins(L)
        assert found.crossover_hz == pytest.approx(SHAPE.crossover_hz, rel=1e-3)
        assert found.phase_margin_deg > 45.0
        assert found.gain_margin_db > 6.0


def test_a_channel_that_cannot_be_closed_is_refused():
    with pytest.raises(UnstableLoop, match="crossover of 80"):
        compensator(channel(0), replace(SHAPE, crossover_hz=80.0, roll_off_hz=400.0), PERIOD_S)
    dead = control.ss(LINEAR.A, 0 * LINEAR.B[:, [0]], LINEAR.C_twist[[3]], 0)
    with pytest.raises(NoResponse, match=r"plant must respond at 2\.0 Hz, got a gain of 0"):
        compensator(dead, SHAPE, PERIOD_S)


def test_the_stepped_loop_is_the_linear_one_of_python_control():
    """Where nothing saturates and nothing fails."""
    B = LINEAR.B @ mapping().major_gain()
    P = control.c2d(control.ss(LINEAR.A, B, LINEAR.C_twist[MAJOR], 0), PERIOD_S, "zoh")
    L = P * control.append(*(each.discrete for each in COMPENSATORS))
    T = control.feedback(L, np.eye(L.noutputs))
    linear = np.asarray(control.forced_response(T, _TIME_S, REFERENCE.T).outputs).T
    np.testing.assert_allclose(predicted_m(), linear, rtol=1e-8, atol=1e-14)
