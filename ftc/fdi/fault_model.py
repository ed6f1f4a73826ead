"""The linear plant with faulty actuators, derived from the fault-free one that is known."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from kernels import ffi, lib, pointer

if TYPE_CHECKING:
    import control

FaultKind = Literal["locked", "free", "weak", "loose"]
"""Stuck where it is; without force; with a part of its force; without force and spring."""

KINDS: tuple[FaultKind, ...] = ("locked", "free", "weak")
"""Those that a diagnosis looks for. It takes an actuator that is loose for one of these."""

MOST_STEPS = 10_000
"""Physics steps of a control tick, at most: more are a mistake in a unit."""

_SLOW_PER_S = 1e-2
"""Growth [1/s] of what counts as at rest: slower than the loops of any machine, and fast enough
that a motion which nothing brings to rest has a response of its own, not a division by zero."""


@dataclass(frozen=True)
class Fault:
    """Fault of one actuator 0..n-1; of a weak one the part 0..1 of its force that is left."""

    actuator: int
    kind: FaultKind
    effectiveness: float = 0.0

    def __post_init__(self) -> None:
        check.choice("kind", self.kind, get_args(FaultKind))
        check.integer("actuator", self.actuator)
        check.number("effectiveness", self.effectiveness, 0.0, 1.0)

    @property
    def is_sound(self) -> bool:
        """Whether nothing is lost: an actuator that works again."""
        return self.kind == "weak" and self.effectiveness == 1.0

    @classmethod
    def of(cls, failure: Any) -> "Fault":
        """Translate what happens, such as a `sim.Failure`, into what is known of it, without time.

        It has a `number` 0..n-1, a `kind` as :data:`FaultKind`, and a weak one `effectiveness`.
        """
        left = failure.effectiveness if failure.kind == "weak" else 0.0
        return cls(failure.number, failure.kind, left)


def by_kind(faults: Sequence[Fault]) -> dict[str, list[int]]:
    """Actuators that are locked and without force, for `ConstrainedSystem.with_failures`.

    Those that are loose are without force.
    """
    return {
        "locked": [each.actuator for each in faults if each.kind == "locked"],
        "free": [each.actuator for each in faults if each.kind in ("free", "loose")],
    }


def of_actuators(faults: Sequence[Fault], n: int) -> Sequence[Fault]:
    """Check that these are faults of n actuators, and return them."""
    if not isinstance(faults, list | tuple):
        raise TypeError(f"faults must be a list of faults, got {check.short_repr(faults)}")
    for each in faults:
        fault = check.instance("each fault in faults", each, Fault)
        check.integer("actuator of each fault in faults", fault.actuator, n)
    return faults


@dataclass(frozen=True)
class NominalModel:
    """Model of the plant without faults.

    Attributes:
        plant: Continuous, from the n commanded displacements to the p measured outputs, without
            feedthrough; states [q; q_dot], the positions q relative to the equilibrium.
        displacement: Of each actuator, per state, shape (n, s).
        noise: Standard deviation of each output's white noise, shape (p,).
        period_s: Between control ticks.
        step_s: Of the semi-implicit Euler integration, velocities before positions. The positions
            of a simulated plant run half a step ahead of the exact motion, which may be several
            times a sensor's noise when an actuator jumps: the model is stepped in the same way.
        feedback: What each actuator's force feeds back, in units of its command, shape (n, s): the
            force is proportional to u + holding - feedback x, and the plant's A includes it. None
            is zero: forces that depend on the command alone, as of coils and motors.
        holding: The part of each force that holds the plant still at x = 0, in units of its
            command, shape (n,); None is zero.
        spring: What the own spring of each actuator takes, in units of its command, shape (n, s):
            part of A, and gone where it is loose. None: it is not known.
        preload: Force of that spring at x = 0, in units of its command, shape (n,); None is zero.
        implicit_damping: Whether a step of the integration takes the forces of dampers with the
            velocities at its end, as MuJoCo's `implicitfast` does; else with those at its start.
        friction: Dry friction at r places, beside the plant's A; None: nothing rubs. Five arrays:
            accelerations of the k positions per force (k, r); velocity of each place per velocity
            of these (r, k); its largest force (r,); its softness, as of a contact, in acceleration
            per force (r,); and the rate [1/s] with which it comes to rest where it sticks (r,).
            `sim.Plant.linear()` has them in this order.
        floor: Acceleration of the positions per acceleration of the floor, shape (s / 2, 3); None:
            it is not known.
        names: Of the actuators, for sentences; None: these have numbers.

    All arrays are copied, and read-only; a tick has at most 10,000 steps.
    """

    plant: "control.StateSpace"
    displacement: Array
    noise: Array
    period_s: float
    step_s: float
    feedback: Array | None = None
    holding: Array | None = None
    implicit_damping: bool = False
    spring: Array | None = None
    preload: Array | None = None
    friction: Sequence[Array] | None = None
    floor: Array | None = None
    names: Sequence[str] | None = None

    def __post_init__(self) -> None:
        import control  # late, as in ftc.compensator

        plant = copy(check.instance("plant", self.plant, control.StateSpace))
        k, n, s = plant.nstates // 2, plant.ninputs, plant.nstates
        for name in "ABCD":
            part = check.array(f"plant.{name}", getattr(plant, name), None, None)
            setattr(plant, name, check.frozen(part))
        mechanical = np.array_equal(plant.A[:k], np.eye(k, 2 * k, k)) and not plant.B[:k].any()
        if not (k and n and plant.noutputs and mechanical) or plant.D.any() or not plant.isctime():
            raise ValueError(
                "plant must be continuous with states [q; q_dot] and no feedthrough, got "
                f"{check.short_repr(plant)}"
            )
        shapes = {"displacement": (n, s), "feedback": (n, s), "spring": (n, s)}
        shapes |= {"holding": (n,), "preload": (n,), "noise": (plant.noutputs,), "floor": (k, 3)}
        damping = check.flag("implicit_damping", self.implicit_damping)
        kept: dict[str, Any] = {"plant": plant, "implicit_damping": damping}
        for name, shape in shapes.items():
            if name in ("displacement", "noise") or getattr(self, name) is not None:
                least = check.SMALLEST if name == "noise" else -check.LARGEST
                part = check.array(name, getattr(self, name), *shape, least=least)
                kept[name] = check.frozen(part)
        if self.friction is not None:
            kept["friction"] = _checked_friction(self.friction, k)
        if self.names is not None:
            kept["names"] = check.members("names", self.names, str)
            if len(kept["names"]) != n:
                raise ValueError(f"names must be {n}, got {len(kept['names'])}")
        for name in ("period_s", "step_s"):
            kept[name] = check.number(name, getattr(self, name), *check.SECONDS)
        if not kept["step_s"] <= kept["period_s"] <= MOST_STEPS * kept["step_s"]:
            raise ValueError(
                f"step_s must not exceed period_s, nor be less than 1 / {MOST_STEPS} of it, got "
                f"{self.step_s} and {self.period_s} s"
            )
        vars(self).update(kept)

    def __getstate__(self) -> dict[str, Any]:
        """With the plant as arrays: python-control's systems cannot be pickled."""
        return vars(self) | {"plant": [getattr(self.plant, name) for name in "ABCD"]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        import control  # late, as above

        vars(self).update(state, plant=control.ss(*state["plant"]))

    @property
    def actuators(self) -> int:
        """Number of actuators, n."""
        return self.plant.ninputs

    def measured(self, C: ArrayLike, noise: ArrayLike) -> "NominalModel":
        """The plant with other outputs: rows C per state (p, s), and their noise (p,)."""
        import control  # late, as in ftc.compensator

        rows = check.array("C", C, None, self.plant.nstates)
        return replace(self, plant=control.ss(self.plant.A, self.plant.B, rows, 0), noise=noise)


def _checked_friction(friction: Sequence[Array], positions: int) -> tuple[Array, ...]:
    """Copies of the arrays of `NominalModel.friction`, read-only."""
    names = ("push", "rows", "limit", "softness", "rate")
    given = check.instance("friction", friction, tuple, list)
    if len(given) != len(names):
        raise ValueError(f"friction must be {', '.join(names)}, got {len(given)} arrays")
    r = check.array("friction.limit", given[2], copy=True).size
    shapes = (positions, r), (r, positions), (r,), (r,), (r,)
    least = (-check.LARGEST,) * 2 + (0.0,) * 3
    return tuple(
        check.frozen(check.array(f"friction.{name}", part, *shape, least=low))
        for name, part, shape, low in zip(names, given, shapes, least, strict=True)
    )


class Rubbing(NamedTuple):
    """One physics step with dry friction: x' = A x + B [u; 1] + G f, each force within its limit.

    f (r,) minimizes f'K f / 2 + f'(E x + D [u; 1]), of states x (s,) and commands u (n,). Outputs
    in units of their noise are C x (p,); a control tick has `steps_a_tick` such steps. Of H models
    side by side each array has a further first axis.

    Coulomb's law as a convex problem, with the softness of the simulator or of the contact itself:
    E. Todorov, "Convex and analytically-invertible dynamics with contacts and constraints", ICRA
    2014; in the rigid limit the linear complementarity problem of D. Stewart and J. Trinkle, Int.
    J. Numerical Methods in Engineering 39, 1996.
    """

    A: Array
    B: Array
    G: Array
    E: Array
    D: Array
    K: Array
    limit: Array
    C: Array
    steps_a_tick: int

    def given(self) -> Any:
        """Struct of the kernels."""
        sizes = self.A.shape[-1], self.K.shape[-1], self.B.shape[-1] - 1, self.C.shape[-2]
        parts = (pointer(part) for part in self[:8])
        return ffi.new("rubbing *", [*sizes, self.steps_a_tick, *parts])

    def moved(self, x: Array, commanded: Array) -> Array:
        """States (..., s) a control tick later, with displacements (..., n) commanded."""
        X = np.array(x, dtype=float).reshape(-1, len(self.A))
        U = np.ones((len(X), self.B.shape[1]))
        U[:, :-1] = commanded.reshape(len(X), -1)
        room = np.empty(2 * len(self.A) + 3 * len(self.K))
        lib.slide(self.given(), len(X), pointer(U), pointer(room), pointer(X))
        return X.reshape(x.shape)


@dataclass(frozen=True)
class FaultModel:
    """Plant x' = A x + B u + drift from tick to tick: states (s,), commands (n,), outputs C x (p,).

    Attributes:
        C: Outputs in units of their noise ("whitened"), shape (p, s).
        onset: The state just after the onset of the faults, per state just before, shape (s, s):
            an actuator that locks stops, and the impact goes through the whole mechanism.
        drift: What loads do in a tick that an actuator no longer holds, shape (s,).
        floor: What an acceleration of the floor does in a tick, shape (s, 3); None: not known.
        rubbing: The physics steps of a tick where there is dry friction, which A and B leave out.
    """

    A: Array
    B: Array
    C: Array
    onset: Array
    drift: Array
    rubbing: Rubbing | None = None
    floor: Array | None = None

    def step(self, x: Array, commanded: Array) -> Array:
        """The state one tick later, with displacements (n,) commanded meanwhile."""
        if self.rubbing is not None:
            return self.rubbing.moved(x.T, commanded.T).T
        moved = self.A.dot(x) + self.B.dot(commanded)
        return (moved.T + self.drift).T  # of several sequences at once, too

    def states(self, commanded: Array, start: Array | None = None) -> Array:
        """The states before, between and after N commands (N, n) of a tick each, (N + 1, s).

        The first is `start`, or rest. Of c sequences (N, n, c) at once they are (N + 1, s, c).
        """
        x = np.zeros((len(self.A), *commanded.shape[2:])) if start is None else start
        return np.array(list(accumulate(commanded, self.step, initial=x)))


@np.errstate(all="ignore")  # the end says what overflows
def fault_model(nominal: NominalModel, faults: Sequence[Fault] = ()) -> FaultModel:
    """The plant with these faults from tick to tick, in the coordinates of the fault-free one.

    An actuator without force neither drives nor feeds back nor holds anything; a weak one has a
    part of all three left. A locked one is a constraint c q_dot = 0, c its row of `displacement`:
    the constraint force acts along M^-1 c^T, as the actuator's own does, so the accelerations are
    projected by P = I - b (c b)^-1 c. The frozen displacement stays in the state. A loose one has
    lost its own spring, preload included, besides.

    Raises:
        ValueError: An actuator is loose whose spring the model does not know, or locked and does
            not move itself; or the plant moves beyond all numbers in a tick.
    """
    P, lower, drive = _accelerations(nominal, faults)
    k, n = len(P), nominal.actuators
    # One step of the integration: velocities first, then positions with the new ones.
    h, eye = nominal.step_s, np.eye(k)
    floor = np.zeros((k, 3)) if nominal.floor is None else nominal.floor
    damping, late = (h * P).dot(lower[:, k:]), eye
    kept = eye + damping
    if nominal.implicit_damping:
        kept = late = np.linalg.inv(eye - damping)
    stiffness, gains = (late @ (h * P @ part) for part in (lower[:, :k], np.hstack([drive, floor])))
    A, B = _blocks(eye + h * stiffness, h * kept, stiffness, kept), np.vstack([h * gains, gains])
    steps = round(nominal.period_s / h)
    moved = sum(np.linalg.matrix_power(A, step) for step in range(steps)) @ B
    commanded, loaded, shaken = (part.copy() for part in np.split(moved, [n, n + 1], axis=1))
    none = np.zeros((k, k))
    found = FaultModel(
        A=np.linalg.matrix_power(A, steps),
        B=commanded,
        C=nominal.plant.C / nominal.noise[:, None],
        onset=_blocks(eye, none, none, P),
        drift=loaded[:, 0],
        floor=None if nominal.floor is None else shaken,
        rubbing=_rubbing(nominal, P, [P @ lower, P @ drive], A, B[:, : n + 1].copy(), h * late),
    )
    if not all(map(check.is_moderate, (found.A, found.B, found.C, found.onset, found.drift))):
        raise ValueError(
            "nominal must move by moderate numbers in a tick, got more by its plant, displacement, "
            "loads or noise"
        )
    return found


def _accelerations(nominal: NominalModel, faults: Sequence[Fault]) -> tuple[Array, Array, Array]:
    """Projector that locks leave (k, k), and accelerations per state, and per command and 1."""
    plant = check.instance("nominal", nominal, NominalModel).plant
    k = plant.nstates // 2
    locked = sorted({*by_kind(of_actuators(faults, nominal.actuators))["locked"]})
    b, c = plant.B[k:, locked], nominal.displacement[locked, :k]
    try:
        P = np.eye(k) - b @ np.linalg.solve(c @ b, c)
    except np.linalg.LinAlgError:
        raise ValueError(
            f"faults must not lock actuators whose displacement no command moves, got {locked}"
        ) from None
    left = np.ones(nominal.actuators)
    for fault in faults:
        if fault.kind != "locked":
            left[fault.actuator] *= fault.effectiveness if fault.kind == "weak" else 0.0
    drive, lower, push = plant.B[k:] * left, plant.A[k:], np.zeros(k)
    if nominal.feedback is not None:
        lower = lower + (plant.B[k:] * (1 - left)) @ nominal.feedback
    if nominal.holding is not None:
        push = plant.B[k:] @ ((left - 1) * nominal.holding)
    if loose := [fault.actuator for fault in faults if fault.kind == "loose"]:
        if nominal.spring is None:
            raise ValueError("a loose actuator needs a model with its spring, got spring=None")
        lower = lower + plant.B[k:, loose] @ nominal.spring[loose]
        if nominal.preload is not None:
            push = push - plant.B[k:, loose] @ nominal.preload[loose]
    return P, lower, np.column_stack([drive, push])


def _blocks(a: Array, b: Array, c: Array, d: Array) -> Array:
    """[a, b; c, d] of four matrices; `numpy.block` takes far longer, of hundreds of models."""
    return np.concatenate([np.concatenate([a, b], axis=1), np.concatenate([c, d], axis=1)])


def at_rest(A: Array, B: Array, period_s: float) -> Array:
    """States per constant input, long after it, of x' = A x + B u from one period to the next.

    What nothing brings to rest is taken after a hundred seconds.
    """
    return np.linalg.solve(np.exp(_SLOW_PER_S * period_s) * np.eye(len(A)) - A, B)


def static_gain(nominal: NominalModel, faults: Sequence[Fault] = ()) -> Array:
    """Displacements per constant command, long after it, of a plant with faults, shape (n, n)."""
    plant = fault_model(nominal, faults)
    return nominal.displacement @ at_rest(plant.A, plant.B, nominal.period_s)


def static_share(nominal: NominalModel, fault: Fault) -> float:
    """Displacement that a command of the actuator still causes, over that of a sound one, 0..1.

    Of a coil that works against a spring it is the part of the force that is left; a weak position
    servo still goes nearly where it is told.
    """
    of_actuators([fault], check.instance("nominal", nominal, NominalModel).actuators)
    if fault.kind != "weak":
        return 0.0
    k = fault.actuator
    sound, weak = (float(static_gain(nominal, each)[k, k]) for each in ((), (fault,)))
    return float(np.clip(weak / sound, 0.0, 1.0)) if sound > 0 else 0.0


def resting_displacements(
    nominal: NominalModel, faults: Sequence[Fault], commanded: Array
) -> Array | None:
    """Displacements (n,) at which constant commands (n,) and loads hold the plant, with faults.

    None: it does not come to rest, because a load is held by nothing.
    """
    plant = fault_model(nominal, faults)
    commanded = check.array("commanded", commanded, nominal.actuators)
    if np.abs(np.linalg.eigvals(plant.A)).max() > 1 - _SLOW_PER_S * nominal.period_s:
        return None
    at_rest = np.linalg.solve(np.eye(len(plant.A)) - plant.A, plant.B @ commanded + plant.drift)
    return nominal.displacement @ at_rest


def _rubbing(
    nominal: NominalModel, P: Array, unimpeded: list[Array], A: Array, B: Array, step: Array
) -> Rubbing | None:
    """Physics steps x' = A x + B [u; 1] with dry friction of a plant that is projected by P.

    `unimpeded` are the accelerations per state and per [u; 1] without it. MuJoCo finds the forces
    for these, before the integration makes the dampers implicit; `step` is velocity per that.
    """
    if nominal.friction is None:
        return None
    push, rows, limit, softness, rate = nominal.friction
    push = P @ push
    E, D = (rows @ part for part in unimpeded)
    E[:, len(P) :] += rate[:, None] * rows
    jolt = step @ push
    return Rubbing(
        A=A,
        B=B,
        G=np.vstack([nominal.step_s * jolt, jolt]),
        E=E,
        D=D,
        K=rows @ push + np.diag(softness),
        limit=limit,
        C=nominal.plant.C / nominal.noise[:, None],
        steps_a_tick=round(nominal.period_s / nominal.step_s),
    )
