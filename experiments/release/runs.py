"""A strut without its coil, and one without coil and spring: section 2.3.1 where springs decide.

Rigid kinematics calls a released strut an unstable singularity. The springs resolve it: the payload
goes where their energy is least.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from experiments.release.statics import STRUT, fall, released_statics
from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import nominal_loops
from experiments.rig.hexapod.fault_tolerance import elastic_system, strut_and_payload_stiffness
from experiments.rig.hexapod.prediction import predicted_motion, predicted_rms_rad, sensitivity_peak
from experiments.rig.hexapod.simulation import SpiralRun, Trajectory, track_spiral
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.study.parallel import in_parallel
from ftc.goal import Goal
from prioritized import FailureAtlas, failure_atlas
from sim import Array, Failure, FailureKind, load_model, weightless

RATIOS = tuple(10.0**k for k in range(3, -4, -1))
"""Suspension of the failed strut over what its own flexures put up against its swing."""

Told = Literal["uncorrected", "corrected", "as_locked"]

_EQUAL = Goal(joint_weight=(1.0,) * 6)


@dataclass(frozen=True)
class Case:
    """One spiral with a strut that fails, or not, at a time; the mapping is told then or never.

    It is told the truth, and the springs say where the strut goes ("corrected"); or that the
    strut's damper holds it at the centre ("as_locked").
    """

    name: str
    kind: FailureKind | None = None
    time_s: float = 0.0
    told: Told = "uncorrected"

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What happens to the plant."""
        return () if self.kind is None else (Failure(STRUT, self.kind, self.time_s),)

    @property
    def reconfigured(self) -> Goal | None:
        """What the mapping goes over to."""
        if self.kind is None or self.told == "uncorrected":
            return None
        if self.told == "as_locked":
            return replace(_EQUAL, locked_at={STRUT: 0.0})
        known = (STRUT,)
        return (
            replace(_EQUAL, free=known)
            if self.kind == "free"
            else replace(_EQUAL, spring_lost=known)
        )


def cases(half_s: float) -> tuple[Case, ...]:
    """All spirals: sound; strut 1 without coil, or coil and spring, from the start or `half_s`."""
    telling: dict[FailureKind, tuple[Told, ...]] = {
        "free": ("uncorrected", "corrected"),
        "loose": ("uncorrected", "corrected", "as_locked"),
    }
    failing = [
        Case(f"{kind}_{when}_{told}", kind, time_s, told)
        for kind in telling
        for when, time_s in (("from_start", 0.0), ("in_flight", half_s))
        for told in telling[kind]
    ]
    return (Case("sound"), *failing)


@dataclass(frozen=True)
class Spiral:
    """One spiral, and what is expected of it."""

    case: Case
    run: Trajectory
    predicted_rad: Array | None  # RMS (2,); not of those that fail later
    sensitivity: float  # its peak after the failure
    linear: Array  # payload twist (N, 6) from the linear model and the strut inputs
    quasi_static: Array  # the same from the elastic mapping alone

    @property
    def twist(self) -> Array:
        """True payload motion [alpha, beta, gamma, t_x, t_y, t_z], shape (N, 6)."""
        return np.hstack([self.run.true_rad, self.run.secondary])


@dataclass(frozen=True)
class Release:
    """All spirals by their names, and statics."""

    seed: int
    spirals: dict[str, Spiral]
    sweep: list[dict[str, float]]  # by suspension over flexure stiffness
    fall: dict[str, float]  # on the ground, without its spring
    atlas: FailureAtlas  # rigid and elastic, all 3^6 conditions


def run_release(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Release:
    """Run the spirals and the sweep, side by side on the machine's cores.

    A strut that loses its spring loses the preload that carries the weight: those runs, and the
    sweep, are in orbit. On the ground it falls to its stop, and is a locked strut from then on.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    ground, bench = load_model(), TestbedConfig()
    orbit, stiffness = weightless(ground), strut_and_payload_stiffness(ground)
    on_ground = Testbed(ground, bench, nominal_loops(ground, bench), stiffness)
    in_orbit = replace(on_ground, model=orbit)
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    chosen = cases(duration_s / 2)

    testbeds = [in_orbit if case.kind == "loose" else on_ground for case in chosen]
    asked = [
        SpiralRun(
            _EQUAL,
            case.failures,
            case.reconfigured,
            jacobian="constant",
            seed=seed,
            duration_s=duration_s,
        )
        for case in chosen
    ]
    tracked = [{"testbed": t, "run": run} for t, run in zip(testbeds, asked, strict=True)]
    statics = [{"model": orbit, "ratio": ratio} for ratio in RATIOS[:: 3 if quick else 1]]
    total = len(tracked) + len(statics)
    runs = in_parallel(track_spiral, tracked, lambda done, _: on_progress(done, total))
    sweep = in_parallel(
        released_statics, statics, lambda done, _: on_progress(len(tracked) + done, total)
    )
    spirals = {}
    for case, testbed, run, flown in zip(chosen, testbeds, asked, runs, strict=True):
        command_m = on_ground.amplifier().displacements(flown.strut_input_percent)
        after = replace(run, goal=case.reconfigured or _EQUAL)
        spirals[case.name] = Spiral(
            case,
            flown,
            predicted_rad=predicted_rms_rad(testbed, after) if case.time_s == 0.0 else None,
            sensitivity=sensitivity_peak(testbed, after),
            linear=predicted_motion(testbed.model, case.failures, flown.time_s, command_m),
            quasi_static=_quasi_static(case, ground, flown.time_s, command_m),
        )
    return Release(seed, spirals, sweep, fall(ground), failure_atlas(elastic_system(ground), MAJOR))


def _quasi_static(case: Case, model: mujoco.MjModel, time_s: Array, command_m: Array) -> Array:
    """Payload twist that the elastic mapping expects of the commands, shape (N, 6)."""
    twist = command_m @ elastic_system(model).kinematics().J.T
    if case.kind is None:
        return twist
    soft = {STRUT: 0.0} if case.kind == "loose" else {}
    failed = elastic_system(model, soft).with_failures(free=[STRUT]).kinematics()
    after = time_s >= case.time_s
    twist[after] = command_m[after][:, failed.actuators] @ failed.J.T
    return twist
