"""Uncertainty of a linear model, and the effect of each error on its outputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import argument_checks as check
from argument_checks import Array, Indices, Mask
from ftc.fdi.fault_model import DryFriction, Fault, FaultModel, NominalModel
from kernels import lib, pointer


@dataclass(frozen=True)
class Uncertainty:
    """Prior standard deviations of model errors, and of disturbances that are not failures.

    The errors of actuators are independent; zero: no error.

    Attributes:
        gain: Relative error of each actuator's force.
        stiffness: Relative error of each actuator's own or its servo's spring, against which a
            command holds its displacement.
        damping: Relative error of the damping along each actuator's displacement.
        inertia: Relative error of the whole mass matrix.
        friction: Relative error of each limit of dry friction, linearized by a smaller limit.
        delay_s: Error of the delay from commands to forces [s].
        offset: Offset of each sensor, in standard deviations of its noise.
        offset_rate: Drift of the offsets, a random walk: its standard deviation after one second.
            It includes slow effects of loads, friction and the tilt of the floor.
        drift_rate: Drift of the other errors after one second, per standard deviation of each.
        friction_rate: Drift of the limits of dry friction after one second, which depend on loads
            and directions, nonlinearly.
        command: Disturbance of an actuator's command, at once or growing in a second: the output
            motion that it causes, in standard deviations of the noise.
        supply: Sudden relative change of the gain of all commands.
        scale: Sudden relative change of the scale of all sensors.
    """

    gain: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    inertia: float = 0.0
    friction: float = 0.0
    delay_s: float = 0.0
    offset: float = 0.0
    offset_rate: float = 0.0
    drift_rate: float = 0.0
    friction_rate: float = 0.0
    command: float = 0.0
    supply: float = 0.0
    scale: float = 0.0

    def __post_init__(self) -> None:
        relative = ("gain", "stiffness", "damping", "inertia", "friction", "supply", "scale")
        for name, value in vars(self).items():
            check.number(name, value, 0.0, 1.0 if name in relative else check.LARGEST)


CERTAIN = Uncertainty()
"""Uncertainty of an exact model."""

TYPICAL = Uncertainty(
    gain=0.02,
    stiffness=0.02,
    damping=0.12,
    inertia=0.02,
    friction=0.5,
    delay_s=1e-3,
    offset=3.0,
    offset_rate=1.0,
    drift_rate=0.03,
    friction_rate=1.0,
    command=1e3,
    supply=0.3,
    scale=0.3,
)
"""Uncertainty of a machine with parts from data sheets: gains and springs to a few percent, dampers
to an eighth, inertias from drawings, the delay to a millisecond, dry friction to a half. Sensors
are zeroed to a few times their noise and drift by it in a second; friction changes in that time by
its uncertainty, and everything else by a thirtieth of it. Disturbances have any visible size: a
thousand times the noise, and a third of the gain or scale."""


@dataclass(frozen=True)
class UncertainModel:
    """Model of a plant with given faults over samples of several ticks, and its J possible errors.

    States X (1 + J, s) are the state of the model in the first row, and its first-order change by
    one standard deviation of each error in the others. Inputs v (r,) are the mean commands of this
    sample and of the one before, then 1. Outputs Y (1 + J, p), in units of the sensors' noise, are
    means over the sample.

    Attributes:
        A: State matrix, shape (s, s): X' = X A^T + M [x; v] with M (1 + J, s, s + r).
        C: Output matrix, shape (p, s): Y = X C^T + N [x; v] with N (1 + J, p, s + r).
        onset: State after the onset of the faults per state before it, shape (s, s).
        ticks: Number of ticks of a sample.
        dry_friction: Dry friction, which A to N do not contain; None: none.
        friction: Relative standard deviation of its limits; zero: exact.
        first_limit: Row of the first error of a limit of dry friction.

    The arrays of H models combined by :func:`side_by_side` have a further first axis.
    """

    A: Array
    M: Array
    C: Array
    N: Array
    onset: Array
    ticks: int
    dry_friction: DryFriction | None
    friction: float
    first_limit: int

    def step(self, X: Array, v: Array) -> tuple[Array, Array]:
        """Return the outputs (1 + J, p) of a sample with inputs v from X, and X after it."""
        after = X.copy()
        return self.advance(after[None, None], v, _ONE, _AT_ONCE)[0, 0], after

    def advance(self, X: Array, v: Array, steps: Mask, age: Array) -> Array:
        """Advance states X (H, K, rows, s) in place; return the outputs (H, K, rows, p).

        Only models and onsets of the mask `steps` (H, K) advance; the last row's drive is
        multiplied by `age` (K,).
        """
        (H, K, rows, s), p = X.shape, self.C.shape[-2]
        outputs, workspace = np.zeros((H, K, rows, p)), np.empty(2 * rows * (p + s))
        before = None if self.dry_friction is None else X.copy()
        arguments = pointer(steps), *map(pointer, self._stacked), pointer(v), pointer(age)
        changing = pointer(X), pointer(outputs)
        lib.advance_models(H, K, rows, s, p, len(v), *arguments, pointer(workspace), *changing)
        if self.dry_friction is not None and before is not None:
            struct = self.dry_friction.struct()
            workspace = np.empty(lib.sliding_room(struct, self.ticks))
            arguments = pointer(steps), pointer(before), pointer(v), pointer(self.A), self.ticks
            limits = self.first_limit, self.friction, pointer(np.empty(struct.r, dtype=bool))
            lib.slide_samples(
                struct, H, K, rows, *arguments, *limits, pointer(workspace), *changing
            )
        return outputs

    @cached_property
    def _stacked(self) -> tuple[Array, Array, Indices]:
        """Arrays for the kernel `advance_models`.

        They are [C; A]' (H, s, p + s) for each row of a state, [N; M]' (H, s + r, rows (p + s)) for
        the first row and the inputs, and the nonzero range of each row of the latter, (.., 2).
        """
        alone = np.concatenate([self.C, self.A], axis=-2).swapaxes(-1, -2)
        driven = np.moveaxis(np.concatenate([self.N, self.M], axis=-2), -1, -3)
        flat = np.ascontiguousarray(driven.reshape(*driven.shape[:-2], -1))
        acts, n = flat != 0.0, flat.shape[-1]
        ends = (acts * np.arange(1, n + 1)).max(axis=-1)
        starts = n - (acts * np.arange(n, 0, -1)).max(axis=-1)
        spans = np.stack([starts, ends], axis=-1).astype(np.int64)
        return np.ascontiguousarray(alone), flat, spans


_ONE, _AT_ONCE = np.ones((1, 1), dtype=bool), np.ones(1)


def side_by_side(models: Sequence[UncertainModel]) -> UncertainModel:
    """Combine H models of one size into one with a further first axis."""
    parts: dict[str, Any] = _stacked(models, ("A", "M", "C", "N", "onset"))
    frictions = [model.dry_friction for model in models if model.dry_friction is not None]
    if frictions:
        stacked = _stacked(frictions, DryFriction._fields[:-1])
        parts["dry_friction"] = frictions[0]._replace(**stacked)
    return replace(models[0], **parts)


def _stacked(objects: Sequence[object], names: Sequence[str]) -> dict[str, Array]:
    return {name: np.array([getattr(part, name) for part in objects]) for name in names}


STEP = 1e-3
"""Finite-difference step in standard deviations of an error: truncation and rounding below 1e-4."""

FaultModels = Callable[[Sequence[Fault]], FaultModel]
"""Function that returns the model of a plant with given faults."""


def uncertain_model(
    plant: FaultModels,
    faults: Sequence[Fault],
    *,
    others: Sequence[FaultModels] = (),
    delay_ticks: float = 0.0,
    friction: float = 0.0,
    ticks: int = 1,
) -> UncertainModel:
    """Build the model of a plant with faults over samples of `ticks`, and of its possible errors.

    The errors are those of `others`, the plant with each error as large as :data:`STEP`; a delay of
    the commands with standard deviation `delay_ticks`; and relative errors `friction` of the limits
    of dry friction.
    """
    model = plant(faults)
    F, G = _lifted(model, ticks)
    (U, drift), s = np.split(G, [-1], axis=1), F.shape[1]
    zero_commands, zero_states = np.zeros_like(U), np.zeros_like(F)
    # Effect of states, commands of this and the previous sample, and 1, (s + p, s + r) each.
    drives = [np.hstack([zero_states, U, zero_commands, drift])]
    for other in others:
        dF, dG = _lifted(other(faults), ticks)
        dU, moved = np.split((dG - G) / STEP, [-1], axis=1)
        drives.append(np.hstack([(dF - F) / STEP, dU, zero_commands, moved]))
    if delay_ticks > 0:  # part of the sample still has the previous command
        delayed = delay_ticks / ticks * U
        drives.append(np.hstack([zero_states, -delayed, delayed, np.zeros_like(drift)]))
    first_limit = len(drives)
    if model.dry_friction is not None and friction > 0:
        drives += [np.zeros_like(drives[0])] * len(model.dry_friction.limit)
    M, N = np.split(np.array(drives), [s], axis=1)
    friction_arguments = ticks, model.dry_friction, friction, first_limit
    return UncertainModel(F[:s], M, F[s:], N, model.onset, *friction_arguments)


def _lifted(model: FaultModel, ticks: int) -> tuple[Array, Array]:
    """Return the final state stacked on the mean outputs of `ticks` ticks with constant command.

    The matrices are per initial state, shape (s + p, s), and per [command; 1], shape
    (s + p, n + 1).
    """
    A, B, C = model.A, np.column_stack([model.B, model.drift]), model.C
    power, total = np.eye(len(A)), np.zeros_like(B)
    mean_C, mean_D = np.zeros_like(C), np.zeros((len(C), B.shape[1]))
    for _ in range(ticks):
        mean_C, mean_D = mean_C + C @ power / ticks, mean_D + C @ total / ticks
        power, total = A @ power, A @ total + B
    return np.vstack([power, mean_C]), np.vstack([total, mean_D])


def perturbed(nominal: NominalModel, uncertainty: Uncertainty) -> list[NominalModel]:
    """Return the models with one error of size `STEP` each, without those of zero uncertainty.

    A separate spring remains when the actuator's force is lost; a servo's stiffness and damping are
    lost with it.
    """
    n, k = nominal.actuators, nominal.plant.nstates // 2
    lower, drive = nominal.plant.A[k:], nominal.plant.B[k:]
    rows, feedback = nominal.displacement, nominal.feedback
    along, models = np.linalg.pinv(rows[:, :k]), []
    gain, stiffness = STEP * uncertainty.gain, STEP * uncertainty.stiffness
    damping, inertia = STEP * uncertainty.damping, STEP * uncertainty.inertia
    for more in gain * np.eye(n) if gain > 0 else ():
        fed_back = lower if feedback is None else lower - (drive * more) @ feedback
        stronger = _changed(nominal, fed_back, drive * (1 + more), feedback)
        if nominal.holding is not None:  # the load is unchanged
            stronger = replace(stronger, holding=nominal.holding / (1 + more))
        models.append(stronger)
    for actuator in range(n if stiffness > 0 else 0):
        more = np.zeros_like(rows)
        more[actuator, :k] = stiffness * rows[actuator, :k]
        stiffer = None if feedback is None else feedback + more
        models.append(_changed(nominal, lower - drive @ more, drive, stiffer))
    for actuator in range(n if damping > 0 else 0):
        damped, damper = lower.copy(), None if feedback is None else feedback.copy()
        projector = np.outer(along[:, actuator], rows[actuator, :k])
        damped[:, k:] += damping * lower[:, k:] @ projector
        if damper is not None:
            damper[actuator, k:] *= 1 + damping
        models.append(_changed(nominal, damped, drive, damper))
    if inertia > 0:
        less = 1 / (1 + inertia)
        models.append(_changed(nominal, lower * less, drive * less, feedback))
    return models


def _changed(
    nominal: NominalModel, lower: Array, drive: Array, feedback: Array | None
) -> NominalModel:
    """Return the model with other accelerations per state and command, and other feedback."""
    import control  # late, as in ftc.compensator

    plant = nominal.plant
    k = plant.nstates // 2
    A, B = np.vstack([plant.A[:k], lower]), np.vstack([plant.B[:k], drive])
    return replace(nominal, plant=control.ss(A, B, plant.C, plant.D), feedback=feedback)
