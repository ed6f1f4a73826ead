"""A strut without its coil, and one without coil and spring: section 2.3.1 where springs decide.

Rigid kinematics calls a released strut an unstable singularity. The springs resolve it: the payload
goes where their energy is least.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from experiments.release.statics import STRUT, fall, released_statics
from experiments.rig.hexapod.columns import MAJOR, secondary
from experiments.rig.hexapod.fault_tolerance import elastic_system, strut_and_payload_stiffness
from experiments.rig.hexapod.rig import hexapod_rig, nominal_testbed
from experiments.rig.prediction import loop_peak
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.parallel import in_parallel
from ftc.fdi.fault_model import Fault, fault_model
from ftc.goal import Goal
from prioritized import FailureAtlas, failure_atlas
from sim import Array, Failure, FailureKind, Plant, load_model, weightless

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
    def after(self) -> Goal:
        """What the mapping goes over to."""
        if self.kind is None or self.told == "uncorrected":
            return _EQUAL
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
    run: Run
    predicted_rad: Array | None  # RMS (2,); not of those that fail later
    sensitivity: float  # its peak after the failure
    linear: Array  # payload twist (N, 6) from the linear model and the strut inputs
    quasi_static: Array  # the same from the elastic mapping alone

    @property
    def twist(self) -> Array:
        """True payload motion [alpha, beta, gamma, t_x, t_y, t_z], shape (N, 6)."""
        return np.hstack([self.run.true, secondary(self.run)])


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
    ground = load_model()
    orbit, testbed = weightless(ground), nominal_testbed()
    on_ground = hexapod_rig(replace(testbed, stiffness=strut_and_payload_stiffness(ground)))
    in_orbit = hexapod_rig(replace(on_ground.control.testbed, model=orbit))
    bench = testbed.bench
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    path, chosen = bench.spiral_rad(duration_s), cases(duration_s / 2)
    rigs = [in_orbit if case.kind == "loose" else on_ground for case in chosen]
    tracked = [
        {"rig": rig, "case": case, "path": path, "seed": seed}
        for rig, case in zip(rigs, chosen, strict=True)
    ]
    statics = [{"model": orbit, "ratio": ratio} for ratio in RATIOS[:: 3 if quick else 1]]
    total = len(tracked) + len(statics)
    runs = in_parallel(_simulated, tracked, lambda done, _: on_progress(done, total))
    sweep = in_parallel(
        released_statics, statics, lambda done, _: on_progress(len(tracked) + done, total)
    )
    spirals = {
        case.name: _compared(rig, case, run)
        for rig, case, run in zip(rigs, chosen, runs, strict=True)
    }
    return Release(seed, spirals, sweep, fall(ground), failure_atlas(elastic_system(ground), MAJOR))


def _simulated(rig: Rig, case: Case, path: Array, seed: int) -> Run:
    """One spiral; the mapping is reconfigured at the failure, unless it does not know of it."""
    controller = rig.controller()
    if case.after != _EQUAL:
        controller = rig.reconfigured(_EQUAL, case.after, case.time_s)
    return rig.fly(controller, path, failures=case.failures, seed=seed)


def _compared(rig: Rig, case: Case, run: Run) -> Spiral:
    """A spiral beside what the linear model and the elastic mapping expect of it."""
    command_m = rig.control.testbed.amplifier().displacements(run.inputs)
    faults, predicted = [Fault.of(failure) for failure in case.failures], None
    if case.time_s == 0.0:
        how = {"failures": case.failures, "told": False, "goal": case.after}
        predicted = rig.predict(run.desired, **how).rms
    return Spiral(
        case,
        run,
        predicted_rad=predicted,
        sensitivity=loop_peak(rig, case.after, faults),
        linear=_linear(rig, faults, int(np.searchsorted(run.time_s, case.time_s)), command_m),
        quasi_static=_quasi_static(case, rig.model, run.time_s, command_m),
    )


def _linear(rig: Rig, faults: Sequence[Fault], onset: int, command_m: Array) -> Array:
    """Payload twist (N, 6) that commands (N, 6) cause in the linear model with faults from a tick.

    Struts that lose their coil or spring keep the loops, and so the state goes on.
    """
    states = fault_model(rig.nominal).states(command_m[:onset])
    after = fault_model(rig.nominal, faults).states(command_m[onset:], states[-1])
    return np.concatenate([states[:-1], after[:-1]]) @ Plant(rig.model).linear().C_twist.T


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
