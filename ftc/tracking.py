"""Tracking of a major task by any mechanism: loops from its linear model, controllers for any goal.

One compensator for each major row, as in Fig. 3 of the paper, and the mapping with the Jacobian of
the estimated posture at every tick.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from argument_checks.ties import greatest
from ftc.control.compensator import (
    Compensator,
    NoResponse,
    UnstableLoop,
    compensators,
    minimal,
)
from ftc.control.frequency_response import Margins, channels, margins
from ftc.control.geometry import MechanismGeometry, MechanismModel
from ftc.control.mapping import Goal, PrioritizedMapping
from ftc.controller import DirectDrive, Measurement, PrioritizedController
from ftc.fdi.diagnosis import DEFAULT_CONFIG, FdiConfig
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import (
    Fault,
    NominalModel,
    by_kind,
    fault_model,
    of_actuators,
    static_gain,
)
from ftc.fdi.monitor import monitor
from ftc.reconfiguration import Unused
from ftc.supervisor import Supervisor
from prioritized import ConstrainedSystem, Kinematics, Manipulability

_DECAYS = 1e-9
"""Part of its frequency below which the decay of a motion is round-off."""
_SINGULAR, _NEARLY_SINGULAR = 1e-6, 1e-3
"""Parts of the largest singular value of the major rows: demands would lose their digits, and a
hint where no loop can be closed."""
_HANDOVER_S = 0.5
"""In which the secondary motion of a former mapping fades."""
_GROWS = 1e-3
"""How much more than in continuous time a motion may grow in a control period of physics steps."""

Sense = Literal["task", "joints", "both"]
"""What the diagnosis looks at: a sensor of the major task, encoders of the actuators, or both. The
major task is measured, or with encoders alone computed from them."""


class TaskLost(ValueError):
    """The mechanism cannot do the major task, or its loops cannot be closed; says why.

    Attributes:
        elsewhere: Whether other rows or another pose help, which the message then does not say.
    """

    def __init__(self, why: str, *, elsewhere: bool = False) -> None:
        """With a reason, and what helps against it unless that is another task."""
        super().__init__(why)
        self.elsewhere = elsewhere


@dataclass(frozen=True)
class Tracking:
    """How a mechanism tracks its major task, made by :func:`tracking`; arrays are read-only.

    Attributes:
        model: The controller's own, of the mechanism.
        nominal: Linear model of the plant to the major rows, with the noise of their measurement.
        major: Rows of the task, each with a compensator, of `loops`.
        margins: Of each loop, the others open.
        goal: While all actuators work.
        limits: Lower and upper displacements of the actuators, (n,) each; None is none.
        springs: Whether springs hold what the loops of the mechanism leave free.
        sense: What the diagnosis looks at.
        encoder_noise: Standard deviations (n,) of one sample of the displacements, where the
            diagnosis looks at these; else None.
        feedforward: Whether the reference itself is demanded, and the compensators add to it.
        unused: What an actuator without force counts as, as in :func:`ftc.goal_after`.
    """

    model: MechanismModel[Any]
    nominal: NominalModel
    major: tuple[int, ...]
    loops: tuple[Compensator, ...]
    margins: tuple[Margins, ...]
    goal: Goal
    limits: tuple[Array, Array] | None = None
    springs: bool = False
    sense: Sense = "task"
    encoder_noise: Array | None = None
    unused: Unused = "free"
    feedforward: bool = True

    def __post_init__(self) -> None:
        kept: dict[str, Any] = {"loops": channels("loops", self.loops, len(self.major))}
        if self.limits is not None:
            kept["limits"] = check.limits("limits", self.limits, self.nominal.actuators)
        if self.encoder_noise is not None:
            kept["encoder_noise"] = check.frozen(self.encoder_noise)
        check.choice("unused", self.unused, get_args(Unused))
        check.flag("feedforward", self.feedforward)
        vars(self).update(kept)

    @cached_property
    def system(self) -> ConstrainedSystem:
        """The mechanism in the nominal posture, without failures."""
        return MechanismGeometry(self.model, springs=self.springs).system

    @cached_property
    def _kinematics(self) -> Kinematics:
        return self.system.kinematics()

    @cached_property
    def watched(self) -> NominalModel:
        """Linear model of the plant to what the diagnosis looks at: task rows, then encoders."""
        if self.encoder_noise is None:
            return self.nominal
        C, noise = self.nominal.displacement, self.encoder_noise
        if self.sense == "both":
            C = np.vstack([self.nominal.plant.C, C])
            noise = np.concatenate([self.nominal.noise, noise])
        return self.nominal.measured(C, noise)

    def mapping(self, goal: Goal) -> PrioritizedMapping[Any]:
        """The mapping for a goal, failures that it knows included."""
        return mapping_for(self.model, goal, self.major, self.limits, springs=self.springs)

    def controller(self, goal: Goal) -> PrioritizedController[Any]:
        """The controller for a goal, failures that it knows included."""
        return PrioritizedController(
            self.loops,
            self.mapping(goal),
            DirectDrive(),
            _HANDOVER_S,
            anti_windup=self.limits is not None,
            reference_feedforward=self.feedforward,
        )

    def supervisor(
        self, config: FdiConfig = DEFAULT_CONFIG, dither: Dither | None = None
    ) -> Supervisor:
        """A controller that diagnoses failures and reconfigures itself; None is no dither."""
        check.instance("config", config, FdiConfig)
        if dither is not None:
            hz = check.instance("dither", dither, Dither).frequency_hz
            config = replace(config, dither_hz=hz)
        return Supervisor(
            self.goal,
            self.controller,
            monitor(self.watched, config=config),
            self._can,
            self.nominal,
            self.unused,
            dither,
            watched=self._seen,
            estimate=None if self.sense == "task" else self._estimate,
        )

    def _can(self, faults: Sequence[Fault]) -> bool:
        """Whether the major task can be done in spite of these faults."""
        return is_possible(self.classified(faults))

    def _estimate(self, measurement: Measurement, near: Any) -> Array:
        """The major task by the forward kinematics of the encoders, from a posture near by."""
        posture = self._at(measurement.displacement, near)
        return self.model.task(posture)[list(self.major)]

    def _at(self, displacement: Array, near: Any) -> Any:
        """The posture near another at which the encoders read these displacements (n,)."""
        return self.model.moved(near, displacement, np.arange(len(displacement)))

    def _seen(self, measurement: Measurement, commanded: Any, faults: tuple[Fault, ...]) -> Array:
        """Readings of the sensors as if task and closed loops were linear in the displacements.

        What the curvature adds where the encoders say that the actuators are is taken off, so that
        larger motions are not mistaken for failures; the commanded posture is ahead of the one that
        servos have reached.
        """
        model, rows, displacement = self.model, self.major, measurement.displacement
        if self.sense == "joints" and not len(self._kinematics.active_constraint):
            return displacement
        posture = self._at(displacement, commanded)
        curved = model.displacements(posture)
        if faults not in self._linear:
            allowed = self._allowed(faults)
            self._linear[faults] = self._kinematics.J[list(rows)] @ allowed, allowed
        J_m, allowed = self._linear[faults]
        seen = []
        if self.sense != "joints":
            seen.append(measurement.output - (model.task(posture).take(rows) - J_m.dot(curved)))
        if self.sense != "task":
            seen.append(displacement - (curved - allowed.dot(curved)))
        return np.concatenate(seen)

    @cached_property
    def _linear(self) -> dict[tuple[Fault, ...], tuple[Array, Array]]:
        """Of faults the major rows per displacement, as the loops allow it, and what they allow.

        They change a few times in a run, and are asked for at every tick.
        """
        return {}

    def _allowed(self, faults: tuple[Fault, ...]) -> Array:
        """Projector (n, n) onto displacements that the closed loops allow, as the plant has it.

        Servos share out by their stiffness what strains the loops; locked actuators stand.
        """
        n, constraint = self.nominal.actuators, self._kinematics.active_constraint
        if not len(constraint):
            return np.eye(n)
        gain, locked = static_gain(self.nominal, faults), np.zeros((n, n))
        stuck = [fault.actuator for fault in faults if fault.kind == "locked"]
        locked[stuck, stuck] = 1.0
        N = scipy.linalg.null_space(constraint)
        standing = N @ np.linalg.pinv(locked @ N) @ locked
        moving = scipy.linalg.null_space(np.vstack([constraint, locked]))
        shared = np.linalg.lstsq(moving.T @ gain @ moving, moving.T @ gain, rcond=None)[0]
        return standing + moving @ shared @ (np.eye(n) - standing)

    def classified(self, faults: Sequence[Fault] = ()) -> Manipulability:
        """What the actuators that are left can do in the nominal posture, section 2.2."""
        failed = by_kind(of_actuators(faults, self.nominal.actuators))
        kinematics = self.system.with_failures(**failed).kinematics()
        return kinematics.manipulability(list(self.major))


def tracking(
    model: MechanismModel[Any],
    linear: Any,
    major: Sequence[int],
    *,
    noise: ArrayLike,
    period_s: float,
    step_s: float,
    goal: Goal,
    crossover_hz: float | None = None,
    sense: Sense = "task",
    **options: Any,
) -> Tracking:
    """Close the loops of a mechanism on its major task.

    Args:
        model: The controller's own, such as `sim.Mechanism`.
        linear: The sound plant about the same pose, with A, B, C_twist and C_active, such as
            `sim.Plant.linear()`.
        major: Rows of the twist.
        noise: Standard deviation of one sample of each major row, or with `sense="joints"` of each
            actuator's displacement, or with "both" of these one after the other: a number, or one
            each.
        period_s: Between control ticks.
        step_s: Integration step of the plant; the control period of a real one.
        goal: For which the loops are designed, all actuators sound.
        crossover_hz: Gain crossover of all rows, below half the control frequency; None: the
            highest that leaves them well damped.
        sense: What the diagnosis looks at.
        options: `limits`, `springs`, `unused` and `feedforward` of :class:`Tracking`, and
            `implicit_damping` and `names` of :class:`ftc.fdi.fault_model.NominalModel`.

    Raises:
        TaskLost: The actuators cannot do the major task, something drifts that they do not hold, or
            no crossover leaves the loops stable.
    """
    n, m = _checked_plant(linear)
    rows = tuple(check.indices("major", major, m).tolist())
    if not rows:
        raise ValueError("major must name at least one row, got none")
    check.instance("goal", goal, Goal).of(n)
    period_s = check.number("period_s", period_s, *check.SECONDS)
    check.number("step_s", step_s, check.SECONDS[0], period_s)
    import control  # late, as in ftc.compensator

    springs = check.flag("springs", options.get("springs", False))
    kinematics = MechanismGeometry(model, springs=springs).system.kinematics()
    report = kinematics.manipulability(list(rows))
    if not is_possible(report):
        raise TaskLost(
            f"the actuators cannot do the major task: {deciding_sentence(report)}", elsewhere=True
        )
    J_m = kinematics.J[list(rows)]
    if singular := _singular(J_m, rows, _SINGULAR):
        raise TaskLost(singular)
    C = linear.C_twist[list(rows)]
    sigma, encoders = _deviations(noise, sense, len(rows), n)
    if sense == "joints":  # by forward kinematics: loops average the noise out
        tied = kinematics.active_constraint
        sigma = np.linalg.norm((J_m - J_m @ np.linalg.pinv(tied) @ tied) * encoders, axis=1)
    gain = mapping_for(model, goal, rows, springs=springs).major_gain()
    plant = minimal(control.ss(linear.A, linear.B @ gain, C, 0))

    def hindrance() -> str:
        return _singular(J_m, rows, _NEARLY_SINGULAR) or _slowest_mode(linear)

    loops, each = _loops(plant, rows, period_s, crossover_hz, hindrance)
    loads = ("feedback", "holding", "spring", "preload", "friction")
    nominal = NominalModel(
        plant=control.ss(linear.A, linear.B, C, 0),
        displacement=linear.C_active,
        noise=sigma,
        period_s=period_s,
        step_s=step_s,
        implicit_damping=options.pop("implicit_damping", False),
        names=options.pop("names", None),
        **{name: getattr(linear, name, None) for name in loads},
    )
    if overshoots := _overshooting(nominal, linear):
        raise TaskLost(overshoots)
    known = {"goal": goal, "sense": sense, "encoder_noise": None if sense == "task" else encoders}
    return Tracking(model, nominal, rows, loops, each, **(known | options))


def _loops(
    plant: Any,
    rows: Sequence[int],
    period_s: float,
    crossover_hz: float | None,
    hindrance: Callable[[], str],
) -> tuple[tuple[Compensator, ...], tuple[Margins, ...]]:
    """Compensators of all rows, and margins of each row.

    `hindrance` says why the rows have no stable loops: a singular posture, or the slowest mode.
    """
    try:
        loops = compensators(plant, period_s, crossover_hz)
    except (UnstableLoop, NoResponse) as error:
        if crossover_hz is None:
            raise TaskLost(f"{error}: {hindrance()}") from None
        raise TaskLost(
            f"the loops would be unstable: {error}; without a crossover of yours the highest that "
            "is stable is taken"
        ) from None
    sampled = plant.sample(period_s, method="zoh")
    each = tuple(margins(sampled[k, k] * loop.discrete) for k, loop in enumerate(loops))
    for row, its in zip(rows, each, strict=True):
        if not np.isfinite(its.crossover_hz):
            raise TaskLost(f"the loop of row {row} has no crossover: {hindrance()}")
    return loops, each


def _checked_plant(linear: Any) -> tuple[int, int]:
    """Actuators n and task rows m of a plant that has its matrices, finite and of one size."""
    check.attributes("linear", linear, "A", "B", "C_twist", "C_active")
    s = len(check.array("linear.A", linear.A, None, None))
    check.array("linear.A", linear.A, None, s)
    n = check.array("linear.B", linear.B, s, None).shape[1]
    check.array("linear.C_active", linear.C_active, n, s)
    return n, len(check.array("linear.C_twist", linear.C_twist, None, s))


def _deviations(noise: ArrayLike, sense: Sense, rows: int, actuators: int) -> tuple[Array, Array]:
    """Standard deviations of what is measured of the major rows, and of the actuators."""
    check.choice("sense", sense, get_args(Sense))
    of_task, of_encoders = rows * (sense != "joints"), actuators * (sense != "task")
    sensors, given = of_task + of_encoders, check.array("noise", noise)
    if given.shape not in ((), (sensors,)) or (given <= 1 / check.LARGEST).any():
        raise ValueError(
            f"noise must be one positive number or {sensors}, got {check.short_repr(noise)}"
        )
    sigma = np.full(sensors, given)
    return sigma[:of_task], sigma[of_task:]


def mapping_for(
    model: MechanismModel[Any],
    goal: Goal,
    major: Sequence[int],
    limits: tuple[Array, Array] | None = None,
    *,
    springs: bool = False,
) -> PrioritizedMapping[Any]:
    """The mapping of a mechanism with the Jacobian of its present posture; other rows secondary."""
    free = (*check.instance("goal", goal, Goal).free, *goal.spring_lost)
    geometry = MechanismGeometry(model, free, springs=springs)
    secondary = [row for row in range(len(geometry.system.J_T)) if row not in major]
    form = "gauss_newton"
    return PrioritizedMapping(geometry, goal, major, secondary, form, model.task, limits=limits)


def is_possible(report: Manipulability) -> bool:
    """Whether the major task is fully reachable, and no self-motion disturbs it."""
    return not report.unmanipulable and not report.unstable_major


def _singular(J_m: Array, rows: tuple[int, ...], least: float) -> str:
    """The row (m1, n) that hardly moves, less than that part of others, and what helps; or none."""
    U, moved, _ = np.linalg.svd(J_m)
    if moved[-1] >= least * moved[0]:
        return ""
    worst = rows[greatest(np.abs(U[:, -1]))]
    return (
        f"the posture is nearly singular, as the actuators move row {worst} by "
        f"{moved[-1] / moved[0]:.1g} of what they move others; begin at another pose, or leave it "
        "out of the major rows"
    )


def _slowest_mode(linear: Any) -> str:
    """The motion of a plant that decays most slowly, or grows, and the joints that move in it."""
    pole, motion = _mode(linear, np.real)
    hz, decay_per_s = abs(pole) / (2 * np.pi), -pole.real
    if decay_per_s < -_DECAYS * abs(pole):
        return f"{motion} grows by {-decay_per_s:.2g} 1/s: stiffen what holds it (kp)"
    decays = f"decays by {decay_per_s:.2g} 1/s only"
    if decay_per_s < _DECAYS * abs(pole):
        decays = "does not decay"
    return f"{motion} at {hz:.2g} Hz {decays}: damp its joints, or their servos (kv)"


def _overshooting(nominal: NominalModel, linear: Any) -> str:
    """The motion that grows by the steps of the integration alone, and what helps; else empty."""
    grows = np.abs(np.linalg.eigvals(fault_model(nominal).A)).max()
    exact = np.exp(np.linalg.eigvals(linear.A).real.max() * nominal.period_s)
    if grows <= max(exact, 1.0) * (1 + _GROWS):
        return ""
    pole, motion = _mode(linear, np.abs)
    return (
        f"{motion} decays by {-pole.real:.2g} 1/s, and overshoots in physics steps of "
        f"{nominal.step_s:g} s: take steps of at most {1 / abs(pole):.1g} s, or an integrator that "
        "takes all dampers implicitly (implicitfast)"
    )


def _mode(linear: Any, size: Callable[[Array], Array]) -> tuple[complex, str]:
    """The pole of a plant with the greatest size, and its motion in words."""
    poles, modes = np.linalg.eig(linear.A)
    worst = greatest(size(poles))
    named = getattr(linear, "named", lambda y: ())(modes[: len(linear.A) // 2, worst])
    return complex(poles[worst]), "a motion" + (f" of {', '.join(named)}" if named else "")


def deciding_sentence(report: Manipulability) -> str:
    """Why the major task can be done, or what is in its way."""
    decide = ("unmanipulable", "unstable_major")
    against = [report.findings[name].sentence for name in decide if report.findings[name].holds]
    return " ".join(against) or report.findings["unmanipulable"].sentence
