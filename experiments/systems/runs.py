"""The paper's other systems: each is classified in every condition, then simulated and compared."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from experiments.rig.conditions import FREE, LOCKED, codes_of, failed, failures_of, in_words
from experiments.rig.units import ROWS
from experiments.rig.verdicts import left_of
from experiments.study.parallel import in_parallel
from experiments.systems import probe
from experiments.systems.probe import PERIOD_S, Polygon, Probed
from prioritized import ConstrainedSystem, Kinematics, Manipulability, failure_atlas
from sim import HEXAPOD_MJCF, Array, jacobians, load_model, mass_matrix


@dataclass(frozen=True)
class Mechanism:
    """One MJCF file and its task."""

    path: Path
    title: str
    task: tuple[int, ...]  # rows of the payload twist [angular; linear]
    major: tuple[int, ...]  # rows of the task
    conditions: tuple[str, ...]  # a letter for each actuator: S sound, L locked, F free

    @property
    def name(self) -> str:
        """As in `systems.json`."""
        return self.path.stem

    @property
    def major_names(self) -> list[str]:
        """Major rows in words."""
        return [ROWS[self.task[row]] for row in self.major]

    @property
    def major_unit(self) -> str:
        """Of the major task: [rad] or [m]."""
        return "rad" if self.major_names[0].startswith("turn") else "m"


MECHANISMS = (
    Mechanism(
        path=HEXAPOD_MJCF.with_name("arm.xml"),
        title="7-joint serial arm, pointing",
        task=(0, 1, 2, 3, 4, 5),
        major=(0, 1),
        conditions=("SSSSSSS", "SLSSSSS", "SSSLSSS", "SSSFSSS", "SSSSSSF", "SLSSSSF"),
    ),
    Mechanism(
        path=HEXAPOD_MJCF.with_name("hand.xml"),
        title="planar two-finger hand, placing an object",
        task=(2, 3, 4),
        major=(1, 2),
        conditions=("SSSS", "LSSS", "FSSS", "FFSS", "LSFS", "LLSS"),
    ),
    Mechanism(
        path=HEXAPOD_MJCF.with_name("arms.xml"),
        title="two cooperating arms, carrying a load",
        task=(0, 1, 2, 3, 4, 5),
        major=(3, 4, 5),
        conditions=("SSSSSSSSSSSS", "SLSSSSSSSSSS", "SFSSSSSSSSSS", "SLSSSSSFSSSS", "FFFFFFSSSSSS"),
    ),
    Mechanism(
        path=HEXAPOD_MJCF.with_name("platform.xml"),
        title="planar platform on four legs, positioning",
        task=(2, 3, 4),
        major=(1, 2),
        conditions=("SSSS", "LSSS", "FSSS", "FFSS", "LFSS"),
    ),
)


@dataclass(frozen=True)
class Probing:
    """One mechanism in one condition, classified and simulated."""

    mechanism: Mechanism
    condition: str
    report: Manipulability
    verdict: str  # as in `experiments.rig.verdicts`
    simulated: dict[str, int]  # dimensions of motions and constraints
    predicted: dict[str, int]  # the same by the report
    errors: dict[str, float]  # of simulated motions, torques and forces; relative or in steps
    time_s: Array
    polygon: Polygon

    @property
    def in_words(self) -> str:
        """The condition for people, actuators 1..n."""
        return in_words(self.codes, [str(k + 1) for k in range(len(self.condition))])

    @property
    def codes(self) -> tuple[int, ...]:
        """The condition as codes."""
        return codes_of(self.condition)

    def failed(self, kind: int) -> list[int]:
        """Actuators 0..n-1 that failed so."""
        return failed(self.codes, range(len(self.condition)), kind)


@dataclass(frozen=True)
class Systems:
    """All probings, by mechanism."""

    seed: int
    examinations: dict[Mechanism, list[Probing]]


def run_systems(
    *,
    seed: int,
    quick: bool,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> Systems:
    """Examine every mechanism in every condition, in parallel on the machine's cores.

    The seed is of the directions in which they are driven and push.
    """
    calls = [
        {"mechanism": mechanism, "condition": condition, "seed": seed}
        for mechanism in MECHANISMS
        for condition in mechanism.conditions[: 3 if quick else None]
    ]
    examined = in_parallel(examine, calls, on_progress)
    ours = {each: [one for one in examined if one.mechanism == each] for each in MECHANISMS}
    return Systems(seed, ours)


def examine(mechanism: Mechanism, condition: str, seed: int) -> Probing:
    """Classify one condition, then simulate it and compare."""
    model = load_model(mechanism.path)
    rig = Probed(model, failures_of(condition), mechanism.task, mechanism.major)
    system, kin = classified(model, mechanism, condition)
    report, major = kin.manipulability(mechanism.major), list(mechanism.major)
    bases = report.bases

    active, moved = probe.respond(rig, kin.actuators)
    coasting = probe.coast(rig)
    rng = np.random.default_rng(seed)
    polygon = probe.drive_polygon(rig, kin, rng)
    errors = {
        "motion_error": probe.motion_error(kin, active, moved),
        "drift_error": probe.largest_angle(coasting, bases["unstable"]),
        "major_error": polygon.error,
        **probe.hold_force(rig, system, kin, rng),
    }
    simulated = {
        "major_directions": probe.dimension(moved[major]),
        "self_motion": probe.dimension(coasting),
        "self_motion_major": probe.dimension(coasting[major]),
        "constrained_active": len(kin.actuators) - probe.dimension(active),
    }
    predicted = {
        "major_directions": len(major) - bases["unmanipulable"].shape[1],
        "self_motion": bases["unstable"].shape[1],
        "self_motion_major": bases["unstable_major"].shape[1],
        "constrained_active": len(bases["constrained_active"]),
    }
    time_s = np.arange(1, len(polygon.desired) + 1) * PERIOD_S
    # The system's failures are part of every condition of its atlas.
    atlas = failure_atlas(system, mechanism.major, codes=np.zeros((1, model.nu)))
    [verdict] = left_of(atlas)
    return Probing(
        mechanism, condition, report, verdict, simulated, predicted, errors, time_s, polygon
    )


def classified(
    model: mujoco.MjModel, mechanism: Mechanism, condition: str
) -> tuple[ConstrainedSystem, Kinematics]:
    """The failed mechanism at its nominal pose, with the task rows it is about.

    Frictionless from rest: under self-motion the passive joints keep their momentum at zero, which
    is what the mass matrix as their metric says.
    """
    data = mujoco.MjData(model)
    jac = jacobians(model, data, site="payload", axes="base")
    system = ConstrainedSystem(jac.J_T[list(mechanism.task)], jac.J_C, jac.active)
    codes, numbers = codes_of(condition), range(len(condition))
    system = system.with_failures(*(failed(codes, numbers, kind) for kind in (LOCKED, FREE)))
    return system, system.kinematics(passive_metric=mass_matrix(model, data))
