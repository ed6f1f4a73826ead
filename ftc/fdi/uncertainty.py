"""How wrong a linear model may be, and what each error would do to its outputs."""

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
    """Standard deviations of the errors of a model, and of what may happen that is no failure.

    Before anything is measured; the errors of actuators are independent of one another; zero: there
    is none.

    Attributes:
        gain: Of each actuator's force, relative.
        stiffness: Of each actuator's own spring, or its servo's, relative: the one against which a
            command holds the displacement that it asks for.
        damping: Of the damping along each actuator's displacement, relative.
        inertia: Of the whole mass matrix, relative.
        friction: Of each limit of dry friction, relative: what a limit so much smaller would do is
            one more error.
        delay_s: Of the delay from commands to forces.
        offset: Of each sensor's zero, in standard deviations of its noise.
        offset_rate: How fast that drifts, a random walk: its standard deviation after one second.
            What moves the outputs as slowly counts as drift: loads, friction, the floor's tilt.
        drift_rate: Likewise of the other errors, per standard deviation of each.
        friction_rate: Likewise of the limits of dry friction: loads and directions change them, and
            they are not linear.
        command: Of what may be added to an actuator's command, at once and in a second: by how much
            an output moves then, in standard deviations of its noise.
        supply: Of how much more or less all commands may do at once, relative.
        scale: Likewise of how much all sensors may show.
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
"""The model is the plant."""

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
"""Of a machine whose parts are known from data sheets: gains and springs to a few percent, dampers
to an eighth, inertias from drawings, the delay to a millisecond, dry friction to a half. Sensors
are zeroed to a few times their noise, and drift by it in a second; friction changes as far in that
time as it may be off, with loads and directions, and all else by a thirtieth. What is no failure
may be of any size that is seen: a thousand times the noise, and a third of all."""


@dataclass(frozen=True)
class UncertainModel:
    """A plant with given faults over a sample of several ticks, and J errors that it may have.

    States X (1 + J, s): that of the model in the first row, and in the others what each error, of
    one standard deviation, adds to it, to first order. Inputs v (r,): the mean commands of this
    sample and of the one before, then 1. Outputs Y (1 + J, p), in units of the sensors' noise, are
    means over the sample.

    Attributes:
        A: With M (1 + J, s, s + r): X' = X A^T + M [x; v], shape (s, s).
        C: With N (1 + J, p, s + r): Y = X C^T + N [x; v], shape (p, s).
        onset: State after the onset of the faults per state before it, shape (s, s).
        ticks: Of a sample.
        rubbing: Dry friction, which A to N leave out; None: nothing rubs.
        friction: Standard deviation of its limits, relative; zero: they are certain.
        first_limit: Row of the first error that is a limit so much smaller.

    Of H models :func:`side_by_side` each array has a further first axis.
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
        """Outputs (1 + J, p) of a sample with inputs v that begins with X; and X after it."""
        after = X.copy()
        return self.advance(after[None, None], v, _ONE, _AT_ONCE)[0, 0], after

    def advance(self, X: Array, v: Array, steps: Mask, age: Array) -> Array:
        """Outputs (H, K, rows, p) of a sample with inputs v; states X (H, K, rows, s) go on.

        Of the models and onsets that `steps` (H, K); the last row's drive is times `age` (K,).
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
        """Outputs before states and columns before rows, for `advance_models`.

        That is [C; A]' (H, s, p + s), of each row of a state, and [N; M]' (H, s + r, rows (p + s)),
        of the first row and the inputs; and where that begins and ends not to be zero, (.., 2).
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
    """H models of one size as one."""
    parts: dict[str, Any] = _stacked(models, ("A", "M", "C", "N", "onset"))
    frictions = [model.dry_friction for model in models if model.dry_friction is not None]
    if frictions:
        stacked = _stacked(frictions, DryFriction._fields[:-1])
        parts["dry_friction"] = frictions[0]._replace(**stacked)
    return replace(models[0], **parts)


def _stacked(objects: Sequence[object], names: Sequence[str]) -> dict[str, Array]:
    return {name: np.array([getattr(part, name) for part in objects]) for name in names}


STEP = 1e-3
"""Standard deviations of an error in a difference: curvature and rounding are both below 1e-4."""

FaultModels = Callable[[Sequence[Fault]], FaultModel]
"""A plant with any faults."""


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

    These are `others`, the plant with each error as large as :data:`STEP`; a delay of the commands,
    of this standard deviation in control ticks; and the limits of dry friction, relative.
    """
    model = plant(faults)
    F, G = _lifted(model, ticks)
    (U, drift), s = np.split(G, [-1], axis=1), F.shape[1]
    zero_commands, zero_states = np.zeros_like(U), np.zeros_like(F)
    # What states, commands of this sample and the one before, and 1 add, (s + p, s + r) each.
    drives = [np.hstack([zero_states, U, zero_commands, drift])]
    for other in others:
        dF, dG = _lifted(other(faults), ticks)
        dU, moved = np.split((dG - G) / STEP, [-1], axis=1)
        drives.append(np.hstack([(dF - F) / STEP, dU, zero_commands, moved]))
    if delay_ticks > 0:  # a part of the sample still has the command before
        delayed = delay_ticks / ticks * U
        drives.append(np.hstack([zero_states, -delayed, delayed, np.zeros_like(drift)]))
    first_limit = len(drives)
    if model.dry_friction is not None and friction > 0:
        drives += [np.zeros_like(drives[0])] * len(model.dry_friction.limit)
    M, N = np.split(np.array(drives), [s], axis=1)
    friction_arguments = ticks, model.dry_friction, friction, first_limit
    return UncertainModel(F[:s], M, F[s:], N, model.onset, *friction_arguments)


def _lifted(model: FaultModel, ticks: int) -> tuple[Array, Array]:
    """The state after ticks with a constant command, below it the mean outputs.

    Per state before, shape (s + p, s), and per command and 1, shape (s + p, n + 1).
    """
    A, B, C = model.A, np.column_stack([model.B, model.drift]), model.C
    power, total = np.eye(len(A)), np.zeros_like(B)
    mean_C, mean_D = np.zeros_like(C), np.zeros((len(C), B.shape[1]))
    for _ in range(ticks):
        mean_C, mean_D = mean_C + C @ power / ticks, mean_D + C @ total / ticks
        power, total = A @ power, A @ total + B
    return np.vstack([power, mean_C]), np.vstack([total, mean_D])


def perturbed(nominal: NominalModel, uncertainty: Uncertainty) -> list[NominalModel]:
    """The model with each error in turn, `STEP` large; those of zero are left out.

    A spring beside an actuator stays when its force is lost; a servo's stiffness and damping go
    with it.
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
        if nominal.holding is not None:  # the load is what it is
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
    """The model with other accelerations per state and command, and another feedback."""
    import control  # late, as in ftc.compensator

    plant = nominal.plant
    k = plant.nstates // 2
    A, B = np.vstack([plant.A[:k], lower]), np.vstack([plant.B[:k], drive])
    return replace(nominal, plant=control.ss(A, B, plant.C, plant.D), feedback=feedback)
