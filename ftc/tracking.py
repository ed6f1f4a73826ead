"""Tracking of a major task by any mechanism: loops from its linear model, controllers for any goal.

The loop has one compensator for each major row, as in Fig. 3 of the paper, and the mapping uses the
Jacobian of the estimated posture at every tick.
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
from ftc.control.compensator import Compensator, NoResponse, UnstableLoop, compensators, minimal
from ftc.control.frequency_response import Margins, channels, margins
from ftc.control.geometry import MechanismGeometry, MechanismModel
from ftc.control.mapping import Goal, PrioritizedMapping
from ftc.controller import DirectDrive, Measurement, PrioritizedController
from ftc.fdi.diagnosis import DEFAULT_CONFIG, FdiConfig
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel, by_kind, fault_model, of_actuators, static_gain
from ftc.fdi.monitor import monitor
from ftc.reconfiguration import Unused
from ftc.supervisor import Supervisor
from prioritized import ConstrainedSystem, Kinematics, Manipulability

_DECAYS = 1e-9
"""Decay rate of a mode, relative to its frequency, below which it is round-off."""
_SINGULAR, _NEARLY_SINGULAR = 1e-6, 1e-3
"""Relative singular values of the major rows: below the first the task is rejected; below the
second the posture is the explanation if no loop can be closed."""
_HANDOVER_S = 0.5
"""Time in which the secondary motion of a previous mapping fades out [s]."""
_GROWS = 1e-3
"""Largest relative growth per control period that the integration steps may add."""

Sense = Literal["task", "joints", "both"]
"""Sensors of the diagnosis: a sensor of the major task, encoders of the actuators, or both. With
encoders alone the major task is computed from them."""


class TaskLost(ValueError):
    """Error raised if a mechanism cannot do the major task or its loops cannot be stabilized.

    Attributes:
        needs_other_task: Whether only other major rows or another pose help; the message does not
            mention this remedy.
    """

    def __init__(self, why: str, *, needs_other_task: bool = False) -> None:
        """Set the message: the reason, and the remedy unless it is another task."""
        super().__init__(why)
        self.needs_other_task = needs_other_task


@dataclass(frozen=True)
class Tracking:
    """Control design of a mechanism for its major task, made by :func:`tracking`.

    Attributes:
        model: Controller's model of the mechanism.
        nominal: Linear model of the plant to the major rows, with the noise of their measurement.
        major: Rows of the major task.
        loops: Compensator of each major row.
        margins: Stability margins of each loop with the others open.
        goal: Goal while all actuators work.
        limits: Lower and upper displacements of the actuators, (n,) each; None is no limit.
        springs: Whether springs determine the motions that closed loops leave free.
        sense: Sensors of the diagnosis.
        encoder_noise: Standard deviations (n,) of one sample of the displacements if the diagnosis
            uses encoders, else None.
        unused: Model of an actuator without force, as in :func:`ftc.goal_after`.
        feedforward: Whether the reference is added to the demands of the compensators.

    Arrays are read-only.
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
        checked: dict[str, Any] = {"loops": channels("loops", self.loops, len(self.major))}
        if self.limits is not None:
            checked["limits"] = check.limits("limits", self.limits, self.nominal.actuators)
        if self.encoder_noise is not None:
            checked["encoder_noise"] = check.frozen(self.encoder_noise)
        check.choice("unused", self.unused, get_args(Unused))
        check.flag("feedforward", self.feedforward)
        vars(self).update(checked)

    @cached_property
    def system(self) -> ConstrainedSystem:
        """Mechanism in the nominal posture, without failures."""
        return MechanismGeometry(self.model, springs=self.springs).system

    @cached_property
    def _kinematics(self) -> Kinematics:
        return self.system.kinematics()

    @cached_property
    def diagnosis_model(self) -> NominalModel:
        """Linear model of the plant to the sensors of the diagnosis: task rows, then encoders."""
        if self.encoder_noise is None:
            return self.nominal
        C, noise = self.nominal.displacement, self.encoder_noise
        if self.sense == "both":
            C = np.vstack([self.nominal.plant.C, C])
            noise = np.concatenate([self.nominal.noise, noise])
        return self.nominal.measured(C, noise)

    def mapping(self, goal: Goal) -> PrioritizedMapping[Any]:
        """Return the mapping for a goal with its known failures."""
        return mapping_for(self.model, goal, self.major, self.limits, springs=self.springs)

    def controller(self, goal: Goal) -> PrioritizedController[Any]:
        """Return the controller for a goal with its known failures."""
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
        """Return a controller that diagnoses failures and reconfigures itself."""
        check.instance("config", config, FdiConfig)
        if dither is not None:
            hz = check.instance("dither", dither, Dither).frequency_hz
            config = replace(config, dither_hz=hz)
        return Supervisor(
            self.goal,
            self.controller,
            monitor(self.diagnosis_model, config=config),
            self._is_possible,
            self.nominal,
            self.unused,
            dither,
            diagnosis_outputs=self._linearized,
            estimate=None if self.sense == "task" else self._estimate,
        )

    def _is_possible(self, faults: Sequence[Fault]) -> bool:
        """Return whether the major task can be done with these faults."""
        return is_possible(self.classified(faults))

    def _estimate(self, measurement: Measurement, near: Any) -> Array:
        """Return the major task (m1,) by forward kinematics of the encoders near a posture."""
        return self.model.task(self._at(measurement.displacement, near))[list(self.major)]

    def _at(self, displacement: Array, near: Any) -> Any:
        """Return the posture near another one at which the encoders read displacements (n,)."""
        return self.model.moved(near, displacement, np.arange(len(displacement)))

    def _linearized(
        self, measurement: Measurement, commanded: Any, faults: tuple[Fault, ...]
    ) -> Array:
        """Return the sensor readings minus the nonlinearity of the task and of closed loops.

        It is computed at the encoder readings, so that large motions are not mistaken for failures;
        the commanded posture would be ahead of the one that servos have reached.
        """
        model, rows, displacement = self.model, self.major, measurement.displacement
        if self.sense == "joints" and not len(self._kinematics.active_constraint):
            return displacement
        posture = self._at(displacement, commanded)
        displaced = model.displacements(posture)
        if faults not in self._linear:
            allowed = self._allowed(faults)
            self._linear[faults] = self._kinematics.J[list(rows)] @ allowed, allowed
        J_m, allowed = self._linear[faults]
        outputs = []
        if self.sense != "joints":
            curvature = model.task(posture).take(rows) - J_m.dot(displaced)
            outputs.append(measurement.output - curvature)
        if self.sense != "task":
            outputs.append(displacement - (displaced - allowed.dot(displaced)))
        return np.concatenate(outputs)

    @cached_property
    def _linear(self) -> dict[tuple[Fault, ...], tuple[Array, Array]]:
        """Cache by faults: major task per displacement, and projector onto the admissible motions.

        The faults change a few times in a run; the entries are used at every tick.
        """
        return {}

    def _allowed(self, faults: tuple[Fault, ...]) -> Array:
        """Return the projector (n, n) onto the displacements that closed loops admit.

        The servos deform according to their stiffness; locked actuators do not move.
        """
        n, constraint = self.nominal.actuators, self._kinematics.active_constraint
        if not len(constraint):
            return np.eye(n)
        gain, locked = static_gain(self.nominal, faults), np.zeros((n, n))
        stuck = [fault.actuator for fault in faults if fault.kind == "locked"]
        locked[stuck, stuck] = 1.0
        N = scipy.linalg.null_space(constraint)
        from_locked = N @ np.linalg.pinv(locked @ N) @ locked
        moving = scipy.linalg.null_space(np.vstack([constraint, locked]))
        shared = np.linalg.lstsq(moving.T @ gain @ moving, moving.T @ gain, rcond=None)[0]
        return from_locked + moving @ shared @ (np.eye(n) - from_locked)

    def classified(self, faults: Sequence[Fault] = ()) -> Manipulability:
        """Classify the mechanism with these faults in the nominal posture, section 2.2."""
        failed = by_kind(of_actuators(faults, self.nominal.actuators))
        return self.system.with_failures(**failed).kinematics().manipulability(list(self.major))


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
    """Design the control loops of a mechanism for its major task.

    Args:
        model: Controller's model of the mechanism, such as `sim.Mechanism`.
        linear: Healthy plant about the same pose, with A, B, C_twist and C_active, such as
            `sim.Plant.linear()`.
        major: Rows of the twist.
        noise: Standard deviation of one sample of each major row, or with `sense="joints"` of each
            actuator's displacement, or with "both" of both in this order: one number or an array.
        period_s: Control period [s].
        step_s: Integration step of the plant [s]; the control period of a real one.
        goal: Goal of the loop design, with all actuators healthy.
        crossover_hz: Gain crossover of all rows, below half the control frequency; None: the
            highest one with well-damped loops.
        sense: Sensors of the diagnosis.
        options: `limits`, `springs`, `unused` and `feedforward` of :class:`Tracking`, and
            `implicit_damping` and `names` of :class:`ftc.fdi.fault_model.NominalModel`.

    Raises:
        TaskLost: The actuators cannot do the major task, an uncontrolled motion drifts, or no
            crossover gives stable loops.
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
            f"the actuators cannot do the major task: {deciding_sentence(report)}",
            needs_other_task=True,
        )
    J_m = kinematics.J[list(rows)]
    if singular := _singular(J_m, rows, _SINGULAR):
        raise TaskLost(singular)
    C = linear.C_twist[list(rows)]
    sigma, encoders = _deviations(noise, sense, len(rows), n)
    if sense == "joints":  # by forward kinematics: closed loops average the noise
        tied = kinematics.active_constraint
        sigma = np.linalg.norm((J_m - J_m @ np.linalg.pinv(tied) @ tied) * encoders, axis=1)
    gain = mapping_for(model, goal, rows, springs=springs).major_gain()
    plant = minimal(control.ss(linear.A, linear.B @ gain, C, 0))

    def hindrance() -> str:
        return _singular(J_m, rows, _NEARLY_SINGULAR) or _slowest_mode(linear)

    loops, row_margins = _loops(plant, rows, period_s, crossover_hz, hindrance)
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
    encoder_noise = None if sense == "task" else encoders
    settings = {"goal": goal, "sense": sense, "encoder_noise": encoder_noise}
    return Tracking(model, nominal, rows, loops, row_margins, **(settings | options))


def _loops(
    plant: Any,
    rows: Sequence[int],
    period_s: float,
    crossover_hz: float | None,
    hindrance: Callable[[], str],
) -> tuple[tuple[Compensator, ...], tuple[Margins, ...]]:
    """Design the compensators of all rows; return them and the margins of each row.

    `hindrance` returns the reason of a failure: a singular posture, or the slowest mode.
    """
    try:
        loops = compensators(plant, period_s, crossover_hz)
    except (UnstableLoop, NoResponse) as error:
        if crossover_hz is None:
            raise TaskLost(f"{error}: {hindrance()}") from None
        raise TaskLost(
            f"the loops would be unstable: {error}; without crossover_hz the highest stable "
            "crossover is chosen"
        ) from None
    sampled = plant.sample(period_s, method="zoh")
    row_margins = tuple(margins(sampled[k, k] * loop.discrete) for k, loop in enumerate(loops))
    for row, margin in zip(rows, row_margins, strict=True):
        if not np.isfinite(margin.crossover_hz):
            raise TaskLost(f"the loop of row {row} has no crossover: {hindrance()}")
    return loops, row_margins


def _checked_plant(linear: Any) -> tuple[int, int]:
    """Check the matrices of a plant; return its numbers of actuators n and task rows m."""
    check.attributes("linear", linear, "A", "B", "C_twist", "C_active")
    s = len(check.array("linear.A", linear.A, None, None))
    check.array("linear.A", linear.A, None, s)
    n = check.array("linear.B", linear.B, s, None).shape[1]
    check.array("linear.C_active", linear.C_active, n, s)
    return n, len(check.array("linear.C_twist", linear.C_twist, None, s))


def _deviations(noise: ArrayLike, sense: Sense, rows: int, actuators: int) -> tuple[Array, Array]:
    """Check `noise`; return the standard deviations of the task rows and of the encoders."""
    check.choice("sense", sense, get_args(Sense))
    of_task, of_encoders = rows * (sense != "joints"), actuators * (sense != "task")
    sensors, values = of_task + of_encoders, check.array("noise", noise)
    if values.shape not in ((), (sensors,)) or (values <= 1 / check.LARGEST).any():
        raise ValueError(
            f"noise must be one positive number or {sensors} of them, got {check.short_repr(noise)}"
        )
    sigma = np.full(sensors, values)
    return sigma[:of_task], sigma[of_task:]


def mapping_for(
    model: MechanismModel[Any],
    goal: Goal,
    major: Sequence[int],
    limits: tuple[Array, Array] | None = None,
    *,
    springs: bool = False,
) -> PrioritizedMapping[Any]:
    """Return the mapping with the Jacobian of the present posture; other rows are secondary."""
    free = (*check.instance("goal", goal, Goal).free, *goal.spring_lost)
    geometry = MechanismGeometry(model, free, springs=springs)
    secondary = [row for row in range(len(geometry.system.J_T)) if row not in major]
    form = "gauss_newton"
    return PrioritizedMapping(geometry, goal, major, secondary, form, model.task, limits=limits)


def is_possible(report: Manipulability) -> bool:
    """Return whether the major task is fully reachable and not disturbed by self-motion."""
    return not report.unmanipulable and not report.unstable_major


def _singular(J_m: Array, rows: tuple[int, ...], least: float) -> str:
    """Describe the row of J_m that the actuators hardly move and the remedy; "" without one."""
    U, moved, _ = np.linalg.svd(J_m)
    if moved[-1] >= least * moved[0]:
        return ""
    worst = rows[greatest(np.abs(U[:, -1]))]
    return (
        f"the posture is nearly singular: the actuators move row {worst} only "
        f"{moved[-1] / moved[0]:.1g} times as far as others; start at another pose, or leave it "
        "out of the major rows"
    )


def _slowest_mode(linear: Any) -> str:
    """Describe the mode of a plant that decays most slowly or grows, and its joints."""
    pole, motion = _mode(linear, np.real)
    hz, decay_per_s = abs(pole) / (2 * np.pi), -pole.real
    if decay_per_s < -_DECAYS * abs(pole):
        return f"{motion} grows at a rate of {-decay_per_s:.2g} 1/s: increase its stiffness (kp)"
    decays = f"decays at a rate of only {decay_per_s:.2g} 1/s"
    if decay_per_s < _DECAYS * abs(pole):
        decays = "does not decay"
    return f"{motion} at {hz:.2g} Hz {decays}: damp its joints, or their servos (kv)"


def _overshooting(nominal: NominalModel, linear: Any) -> str:
    """Describe the mode that the integration steps destabilize and the remedy; "" if none does."""
    grows = np.abs(np.linalg.eigvals(fault_model(nominal).A)).max()
    exact = np.exp(np.linalg.eigvals(linear.A).real.max() * nominal.period_s)
    if grows <= max(exact, 1.0) * (1 + _GROWS):
        return ""
    pole, motion = _mode(linear, np.abs)
    return (
        f"{motion} decays at a rate of {-pole.real:.2g} 1/s, and overshoots in physics steps of "
        f"{nominal.step_s:g} s: take steps of at most {1 / abs(pole):.1g} s, or an integrator that "
        "takes all dampers implicitly (implicitfast)"
    )


def _mode(linear: Any, size: Callable[[Array], Array]) -> tuple[complex, str]:
    """Return the pole of a plant with the greatest `size` and a description of its mode."""
    poles, modes = np.linalg.eig(linear.A)
    worst = greatest(size(poles))
    labels = getattr(linear, "moving_joints", lambda y: ())(modes[: len(linear.A) // 2, worst])
    return complex(poles[worst]), "a motion" + (f" of {', '.join(labels)}" if labels else "")


def deciding_sentence(report: Manipulability) -> str:
    """Return the sentences of the report that decide whether the major task can be done."""
    decide = ("unmanipulable", "unstable_major")
    against = [report.findings[name].sentence for name in decide if report.findings[name].holds]
    return " ".join(against) or report.findings["unmanipulable"].sentence
