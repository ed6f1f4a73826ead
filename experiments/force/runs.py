"""Forces by the mapping's torques: pressing on a fixture, and holding a prescribed wrench."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import scipy.linalg

from experiments.force.aims import GOALS, LEVERED, PRESCRIBED, Aims, ForceGoal, draw_aims
from experiments.force.answers import (
    Answer,
    InternalForce,
    Tradeoff,
    answer,
    known_system,
    trade,
    use_internal_force,
)
from experiments.force.rig import Condition, Readings, conditions, hold, press, with_fixture
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.rig.hexapod.fault_tolerance import elastic_system, strut_and_payload_stiffness
from experiments.study.parallel import in_parallel
from experiments.study.study import OnProgress
from prioritized import Failures
from sim import HEXAPOD_MJCF, NOMINAL, Array, Failure, hexapod, load_model, weightless

DRAWS = 4


@dataclass(frozen=True)
class Held:
    """Prescribed wrenches against one set of torques, one a row.

    The "rigid" mapping knows no springs, and eq. (9) forbids what a free strut would have to bear;
    the "elastic" one leaves that to the strut's spring.
    """

    mapping: str
    torques: Array  # of the coils, (D, 6), [N]
    lacking: Array  # what neither they nor a lock exert, [moment; force], (D, 6)
    readings: Readings  # a load for each wrench
    predicted: Array  # displacement where all springs together balance what is lacking, (D, 6)
    unheld: Array  # displacement if they had to balance all of it, (D, 6)

    @property
    def simulated(self) -> Array:
        """Displacement [rotation; translation] of the payload at rest, shape (D, 6)."""
        return self.readings.displacement[:, -1]


@dataclass(frozen=True)
class Trial:
    """One condition under one goal, a load for each aim.

    Pressing on the fixture; held without it, against the wrench that the mapping exerts.
    """

    answer: Answer
    pressed: Readings
    held: Readings


@dataclass(frozen=True)
class Examination:
    """One condition of the hexapod.

    The prescribed wrenches are held by the rigid mapping's torques, and with a free strut by the
    elastic one's; none are tried on a strut that no spring holds.
    """

    condition: Condition
    trials: tuple[Trial, ...]
    prescribed: tuple[Held, ...]

    def trial(self, goal: ForceGoal) -> Trial:
        """The one under a goal."""
        return next(trial for trial in self.trials if trial.answer.goal == goal)


@dataclass(frozen=True)
class Force:
    """All of the experiment; every condition has the same aims."""

    seed: int
    aims: Aims
    examinations: list[Examination]
    tradeoff: Tradeoff
    internal: tuple[InternalForce, ...]


def run_force(*, seed: int, quick: bool, on_progress: OnProgress) -> Force:
    """Examine every condition, in parallel on the machine's cores; with `quick` of strut 1 only.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    rng = np.random.default_rng(seed)
    aims = draw_aims(rng, DRAWS)
    tradeoff = trade(aims, rng)
    internal = use_internal_force(rng, DRAWS)
    calls = [{"condition": each, "aims": aims} for each in conditions(1 if quick else 6)]
    return Force(seed, aims, in_parallel(examine, calls, on_progress), tradeoff, internal)


def examine(condition: Condition, aims: Aims) -> Examination:
    """The mapping's torques in one condition, pressing and holding.

    On the ground, where the preload carries the weight; a strut that loses its spring loses its
    preload too, and is looked at in orbit.
    """
    model, system = with_fixture(HEXAPOD_MJCF), known_system(condition)
    if condition.kind == "loose":
        model = weightless(model)

    def trial(goal: ForceGoal) -> Trial:
        found = answer(system, goal, aims)
        pressed = press(model, condition.failures, found.torques)
        held = hold(model, condition.failures, found.torques, found.wrench)
        return Trial(found, pressed, held)

    examined = Examination(condition, tuple(trial(goal) for goal in GOALS), prescribed=())
    if condition.kind == "loose":
        return examined
    torques = {"rigid": examined.trial(PRESCRIBED).answer.torques}
    if system.failures.free:
        torques["elastic"] = elastic_torques(system.failures, aims)
    given = (model, condition.failures, system.failures, aims)
    held = tuple(hold_prescribed(*given, *way) for way in torques.items())
    return replace(examined, prescribed=held)


def hold_prescribed(
    model: mujoco.MjModel,
    failures: Sequence[Failure],
    known: Failures,
    aims: Aims,
    mapping: str,
    torques: Array,
) -> Held:
    """Push the payload back with all of the aims against torques (D, 6), [N], of that mapping.

    No strut of the model, which is one of :func:`with_fixture`, may have lost its spring; `known`
    is what the prediction knows of the failures.
    """
    sound, locked = load_model(), sorted(known.locked)
    A, K = hexapod(sound).inverse_jacobian(NOMINAL), payload_stiffness(sound)
    # A lock leaves five directions to move in, and bears what comes across them.
    Z = scipy.linalg.null_space(A[locked]) if locked else np.eye(6)
    give = Z @ np.linalg.inv(Z.T @ K @ Z) @ Z.T
    missing = aims.wrench - torques @ A
    return Held(
        mapping=mapping,
        torques=torques,
        lacking=missing @ Z @ Z.T,
        readings=hold(model, failures, torques, aims.wrench),
        predicted=-missing @ give,
        unheld=-aims.wrench @ give,
    )


def elastic_torques(known: Failures, aims: Aims) -> Array:
    """Torques (D, 6) of a mapping that reckons with the springs, closest to the aims."""
    kin = elastic_system(load_model()).with_failures(known.locked, known.free).kinematics()
    mapping = kin.force_mapping(MAJOR, SECONDARY, secondary_weight=LEVERED)
    return kin.expand(mapping(aims.major, secondary_force=aims.secondary))


def payload_stiffness(model: mujoco.MjModel) -> Array:
    """K of all springs against the payload's displacement in base axes, shape (6, 6)."""
    of_struts_and_payload = strut_and_payload_stiffness(model)
    A = hexapod(model).inverse_jacobian(NOMINAL)
    return A.T @ of_struts_and_payload[:6, :6] @ A + of_struts_and_payload[6:, 6:]
