"""How wrong a linear model may be, and what each error would do to its outputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc._records import Pointers
from ftc.fdi.fault_model import Fault, FaultModel, NominalModel
from ftc.fdi.friction import SampledFriction
from kernels import lib, pointer


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of the errors of a model, and of what may happen that is no failure.

    Before anything is measured; the errors of actuators are independent of one another.

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
            an output moves then, in standard deviations of its noise; zero: nothing is.
        supply: Of how much more or less all commands may do at once, relative; zero: it does not.
        scale: Likewise of how much all sensors may show.

    Raises:
        ValueError: One of them is negative or not finite, or a relative one above 1.
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
        for name, value in vars(self).items():
            check.number(name, value)
        for name in ("gain", "stiffness", "damping", "inertia", "friction", "supply", "scale"):
            check.at_most_one(name, getattr(self, name))

    @property
    def of_model(self) -> "Uncertainty":
        """The errors of the model alone: nothing happens but failures."""
        return replace(self, command=0.0, supply=0.0, scale=0.0)


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
to a fifth, inertias from drawings, the delay to a millisecond, dry friction to a half."""


@dataclass(frozen=True)
class UncertainModel:
    """A plant with given faults over a sample of several ticks, and J errors that it may have.

    States X (1 + J, s): that of the model in the first row, and in the others what each error, of
    one standard deviation, adds to it, to first order. Inputs v (r,): the mean commands of this
    sample and of the one before, then 1. Outputs Y (1 + J, p), in units of the sensors' noise, are
    means over the sample.

    Attributes:
        A: Of all rows of X, shape (s, s).
        M: X' = X A^T + M [x; v], shape (1 + J, s, s + r).
        C: Shape (p, s).
        N: Y = X C^T + N [x; v], shape (1 + J, p, s + r).
        onset: State after the onset of the faults per state before it, shape (s, s).
        friction: What dry friction changes of that; None: nothing rubs.
    """

    A: Array
    M: Array
    C: Array
    N: Array
    onset: Array
    friction: SampledFriction | None = None

    @property
    def limits(self) -> int:
        """How many limits of dry friction are among the errors: the last ones."""
        return 0 if self.friction is None else self.friction.limits

    def step(self, X: Array, v: Array) -> tuple[Array, Array]:
        """Outputs (1 + J, p) of a sample with inputs v that begins with X; and X after it."""
        after, Y = X.copy(), np.empty((len(X), len(self.C)))
        room = np.empty(2 * (after.size + Y.size))
        sizes = 1, 1, *after.shape, Y.shape[1], len(v)
        changing = pointer(room), pointer(after), pointer(Y)
        lib.advance_models(*sizes, _STEPS, *self._stacked, pointer(v), _AT_ONCE, *changing)
        if self.friction is not None:
            self.friction.apply(_ONE, X[None, None], after[None, None], Y[None, None], v)
        return Y, after

    @cached_property
    def _stacked(self) -> Pointers:
        return stacked(self.A[None], self.M[None], self.C[None], self.N[None])


_ONE = np.ones((1, 1), dtype=bool)
_STEPS, _AT_ONCE = pointer(_ONE), pointer(np.ones(1))


def stacked(A: Array, M: Array, C: Array, N: Array) -> Pointers:
    """Of H models, outputs before states and columns before rows, as `advance_models` takes them.

    That is [C; A]' (H, s, p + s), of each row of a state, and [N; M]' (H, s + r, rows (p + s)),
    of the first row and the inputs; and where that begins and ends not to be zero (H, s + r, 2).
    """
    alone = np.concatenate([C, A], axis=1).swapaxes(1, 2)
    driven = np.concatenate([N, M], axis=2).transpose(0, 3, 1, 2)
    flat = np.ascontiguousarray(driven.reshape(*driven.shape[:2], -1))
    acts, n = flat != 0.0, flat.shape[-1]
    ends = (acts * np.arange(1, n + 1)).max(axis=-1)
    starts = n - (acts * np.arange(n, 0, -1)).max(axis=-1)
    spans = np.stack([starts, ends], axis=-1).astype(np.int64)
    return Pointers(np.ascontiguousarray(alone), flat, spans)


STEP = 1e-3
"""Of differences, in standard deviations: curvature and rounding are both below 1e-4 of them."""

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
    """The plant with these faults over samples of so many ticks.

    Args:
        plant: As it is believed to be.
        faults: That it has.
        others: The plant with each of its possible errors, as large as :data:`STEP`.
        delay_ticks: Standard deviation of the delay of the commands, in control ticks.
        friction: Of the limits of dry friction, relative.
        ticks: Of a sample.
    """
    model = plant(faults)
    plain = _lifted(model, ticks)
    A, B, C, D = plain
    n, (p, s) = B.shape[1] - 1, C.shape
    none = np.zeros_like
    M = [np.hstack([none(A), B[:, :n], np.zeros((s, n)), B[:, n:]])]
    N = [np.hstack([none(C), D[:, :n], np.zeros((p, n)), D[:, n:]])]
    for other in others:
        dA, dB, dC, dD = (
            (changed - part) / STEP
            for changed, part in zip(_lifted(other(faults), ticks), plain, strict=True)
        )
        M.append(np.hstack([dA, dB[:, :n], np.zeros((s, n)), dB[:, n:]]))
        N.append(np.hstack([dC, dD[:, :n], np.zeros((p, n)), dD[:, n:]]))
    if delay_ticks > 0:
        late = delay_ticks / ticks  # a part of the sample still has the command before
        M.append(np.hstack([none(A), -late * B[:, :n], late * B[:, :n], np.zeros((s, 1))]))
        N.append(np.hstack([none(C), -late * D[:, :n], late * D[:, :n], np.zeros((p, 1))]))
    rubbed = None
    if model.rubbing is not None:
        rubbed = SampledFriction((model.rubbing,), A[None], ticks, len(M), friction)
        M += [np.zeros_like(M[0])] * rubbed.limits
        N += [np.zeros_like(N[0])] * rubbed.limits
    return UncertainModel(A, np.array(M), C, np.array(N), model.onset, rubbed)


def _lifted(model: FaultModel, ticks: int) -> tuple[Array, Array, Array, Array]:
    """A, [B, drift], and C, D of the mean output, over ticks with a constant command."""
    A, B = model.A, np.column_stack([model.B, model.drift])
    C, D = model.C, np.zeros((len(model.C), B.shape[1]))
    power, total = np.eye(len(A)), np.zeros_like(B)
    mean_C, mean_D = np.zeros_like(C), D
    for _ in range(ticks):
        mean_C, mean_D = mean_C + C @ power / ticks, mean_D + C @ total / ticks
        power, total = A @ power, A @ total + B
    return power, total, mean_C, mean_D


def perturbed(nominal: NominalModel, uncertainty: Uncertainty) -> list[NominalModel]:
    """The model with each error in turn, `STEP` large; those of zero are left out.

    A spring beside an actuator stays when its force is lost; a servo's stiffness and damping go
    with it.
    """
    n, plant = nominal.actuators, nominal.plant
    k = plant.nstates // 2
    gain, stiffness, damping, inertia = (
        STEP * size
        for size in (
            uncertainty.gain,
            uncertainty.stiffness,
            uncertainty.damping,
            uncertainty.inertia,
        )
    )
    lower, drive, rows = plant.A[k:], plant.B[k:], nominal.displacement
    along, found = np.linalg.pinv(rows[:, :k]), []
    feedback = nominal.feedback
    for actuator in range(n if gain > 0 else 0):
        more = np.zeros(n)
        more[actuator] = gain
        fed_back = lower if feedback is None else lower - (drive * more) @ feedback
        stronger = _changed(nominal, fed_back, drive * (1 + more), feedback)
        if nominal.holding is not None:  # the load is what it is
            stronger = replace(stronger, holding=nominal.holding / (1 + more))
        found.append(stronger)
    for actuator in range(n if stiffness > 0 else 0):
        more = np.zeros_like(rows)
        more[actuator, :k] = stiffness * rows[actuator, :k]
        stiffer = None if feedback is None else feedback + more
        found.append(_changed(nominal, lower - drive @ more, drive, stiffer))
    for actuator in range(n if damping > 0 else 0):
        damped = lower.copy()
        own = np.outer(along[:, actuator], rows[actuator, :k])
        damped[:, k:] += damping * lower[:, k:] @ own
        damper = None if feedback is None else feedback.copy()
        if damper is not None:
            damper[actuator, k:] *= 1 + damping
        found.append(_changed(nominal, damped, drive, damper))
    if inertia > 0:
        less = 1 / (1 + inertia)
        found.append(_changed(nominal, lower * less, drive * less, feedback))
    return found


def _changed(
    nominal: NominalModel, lower: Array, drive: Array, feedback: Array | None
) -> NominalModel:
    """With other accelerations per state and per command, and other feedback of the actuators."""
    import control  # late, as in ftc.compensator

    plant = nominal.plant
    k = plant.nstates // 2
    A, B = np.vstack([plant.A[:k], lower]), np.vstack([plant.B[:k], drive])
    return replace(nominal, plant=control.ss(A, B, plant.C, plant.D), feedback=feedback)
