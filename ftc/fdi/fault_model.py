"""Linear model of the plant with faulty actuators, derived from the fault-free model."""

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
"""Kinds of faults: stuck at its displacement; without force; with reduced force; without force and
spring."""

KINDS: tuple[FaultKind, ...] = ("locked", "free", "weak")
"""Kinds of faults among the hypotheses of the diagnosis; a loose actuator is classified as one."""

MOST_STEPS = 10_000
"""Largest number of integration steps in a control tick; more indicate a wrong unit."""

_SLOW_PER_S = 1e-2
"""Rate at which a static response is evaluated [1/s]: slower than the loops of any machine, and
fast enough that a motion without restoring force has a finite response."""


@dataclass(frozen=True)
class Fault:
    """Fault of one actuator 0..n-1; a weak one has the fraction `effectiveness` of its force."""

    actuator: int
    kind: FaultKind
    effectiveness: float = 0.0

    def __post_init__(self) -> None:
        check.choice("kind", self.kind, get_args(FaultKind))
        check.integer("actuator", self.actuator)
        check.number("effectiveness", self.effectiveness, 0.0, 1.0)

    @property
    def is_healthy(self) -> bool:
        """Return whether the actuator has full effectiveness, as after a recovery."""
        return self.kind == "weak" and self.effectiveness == 1.0

    @classmethod
    def of(cls, failure: Any) -> "Fault":
        """Return the fault of a failure event such as `sim.Failure`, without its time.

        The event has a `number` 0..n-1, a `kind` of :data:`FaultKind`, and `effectiveness` if weak.
        """
        remaining = failure.effectiveness if failure.kind == "weak" else 0.0
        return cls(failure.number, failure.kind, remaining)


def by_kind(faults: Sequence[Fault]) -> dict[str, list[int]]:
    """Return the locked and free actuators as arguments of `ConstrainedSystem.with_failures`.

    Loose actuators are free.
    """
    return {
        "locked": [fault.actuator for fault in faults if fault.kind == "locked"],
        "free": [fault.actuator for fault in faults if fault.kind in ("free", "loose")],
    }


def of_actuators(faults: Sequence[Fault], n: int) -> Sequence[Fault]:
    """Check that `faults` is a list of faults of n actuators, and return it."""
    if not isinstance(faults, list | tuple):
        raise TypeError(f"faults must be a list of faults, got {check.short_repr(faults)}")
    for item in faults:
        fault = check.instance("each fault in faults", item, Fault)
        check.integer("actuator of each fault in faults", fault.actuator, n)
    return faults


@dataclass(frozen=True)
class NominalModel:
    """Linear model of the plant without faults.

    Attributes:
        plant: Continuous system from the n commanded displacements to the p measured outputs,
            without feedthrough; states [q; q_dot], the positions q relative to the equilibrium.
        displacement: Displacement of each actuator per state, shape (n, s).
        noise: Standard deviation of each output's white noise, shape (p,).
        period_s: Control period [s].
        step_s: Step of the semi-implicit Euler integration [s], velocities before positions. The
            positions of a simulated plant run half a step ahead of the exact motion, which may be
            several times a sensor's noise when an actuator jumps: the model does the same.
        feedback: State feedback within each actuator, in units of its command, shape (n, s): its
            force is proportional to u + holding - feedback x, and the plant's A includes it. None
            is zero: forces that depend on the command alone, such as those of coils and motors.
        holding: Part of each force that holds the plant still at x = 0, in units of its command,
            shape (n,); None is zero.
        spring: Force of each actuator's own spring, in units of its command, shape (n, s): part of
            A, and absent if the actuator is loose. None: unknown.
        preload: Force of that spring at x = 0, in units of its command, shape (n,); None is zero.
        implicit_damping: Whether an integration step evaluates dampers at its end, as MuJoCo's
            `implicitfast` does; else at its start.
        friction: Dry friction at r places, in addition to the plant's A; None: no friction. Five
            arrays: accelerations of the k positions per force (k, r); velocity of each place per
            velocity of the positions (r, k); its largest force (r,); its softness, as of a contact,
            in acceleration per force (r,); and the rate [1/s] with which it comes to rest when it
            sticks (r,). `sim.Plant.linear()` has them in this order.
        floor: Acceleration of the positions per acceleration of the floor, shape (s / 2, 3); None:
            unknown.
        names: Names of the actuators for messages; None: numbers.

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
        checked: dict[str, Any] = {"plant": plant, "implicit_damping": damping}
        for name, shape in shapes.items():
            if name in ("displacement", "noise") or getattr(self, name) is not None:
                least = check.SMALLEST if name == "noise" else -check.LARGEST
                part = check.array(name, getattr(self, name), *shape, least=least)
                checked[name] = check.frozen(part)
        if self.friction is not None:
            checked["friction"] = _checked_friction(self.friction, k)
        if self.names is not None:
            checked["names"] = check.members("names", self.names, str)
            if len(checked["names"]) != n:
                raise ValueError(f"names must be {n} strings, got {len(checked['names'])}")
        for name in ("period_s", "step_s"):
            checked[name] = check.number(name, getattr(self, name), *check.SECONDS)
        if not checked["step_s"] <= checked["period_s"] <= MOST_STEPS * checked["step_s"]:
            raise ValueError(
                f"step_s must not exceed period_s, nor be less than 1 / {MOST_STEPS} of it, got "
                f"{self.step_s} and {self.period_s} s"
            )
        vars(self).update(checked)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state with the plant as arrays, since a StateSpace cannot be pickled."""
        return vars(self) | {"plant": [getattr(self.plant, name) for name in "ABCD"]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        import control  # late, as above

        vars(self).update(state, plant=control.ss(*state["plant"]))

    @property
    def actuators(self) -> int:
        """Number n of actuators."""
        return self.plant.ninputs

    def measured(self, C: ArrayLike, noise: ArrayLike) -> "NominalModel":
        """Return the plant with other outputs: rows C per state (p, s) and their noise (p,)."""
        import control  # late, as in ftc.compensator

        rows = check.array("C", C, None, self.plant.nstates)
        return replace(self, plant=control.ss(self.plant.A, self.plant.B, rows, 0), noise=noise)


def actuator_name(names: Sequence[str] | None, actuator: int) -> str:
    """Return the name of actuator 0..n-1, or "actuator k" if there are no names."""
    return f"actuator {actuator}" if names is None else names[actuator]


def _checked_friction(friction: Sequence[Array], positions: int) -> tuple[Array, ...]:
    """Check the arrays of `NominalModel.friction`; return read-only copies."""
    names = ("push", "rows", "limit", "softness", "rate")
    arrays = check.instance("friction", friction, tuple, list)
    if len(arrays) != len(names):
        raise ValueError(f"friction must be {', '.join(names)}, got {len(arrays)} arrays")
    r = check.array("friction.limit", arrays[2], copy=True).size
    shapes = (positions, r), (r, positions), (r,), (r,), (r,)
    least = (-check.LARGEST,) * 2 + (0.0,) * 3
    return tuple(
        check.frozen(check.array(f"friction.{name}", part, *shape, least=low))
        for name, part, shape, low in zip(names, arrays, shapes, least, strict=True)
    )


class DryFriction(NamedTuple):
    """Physics step with dry friction: x' = A x + B [u; 1] + G f, each force within its limit.

    f (r,) minimizes f'K f / 2 + f'(E x + D [u; 1]) for states x (s,) and commands u (n,). Outputs
    in units of their noise are C x (p,); a control tick has `steps_a_tick` such steps. The arrays
    of H models have a further first axis.

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

    def struct(self) -> Any:
        """Return the struct that the kernels take."""
        sizes = self.A.shape[-1], self.K.shape[-1], self.B.shape[-1] - 1, self.C.shape[-2]
        parts = (pointer(part) for part in self[:8])
        return ffi.new("friction_model *", [*sizes, self.steps_a_tick, *parts])

    def moved(self, x: Array, commanded: Array) -> Array:
        """Return the states (..., s) one control tick later for commands (..., n)."""
        X = np.array(x, dtype=float).reshape(-1, len(self.A))
        U = np.ones((len(X), self.B.shape[1]))
        U[:, :-1] = commanded.reshape(len(X), -1)
        workspace = np.empty(2 * len(self.A) + 3 * len(self.K))
        lib.slide(self.struct(), len(X), pointer(U), pointer(workspace), pointer(X))
        return X.reshape(x.shape)


@dataclass(frozen=True)
class FaultModel:
    """Discrete plant x' = A x + B u + drift with states (s,), commands (n,) and outputs C x (p,).

    Attributes:
        C: Outputs in units of their noise ("whitened"), shape (p, s).
        onset: State just after the onset of the faults per state just before, shape (s, s): a
            locking actuator stops, with an impact on the whole mechanism.
        drift: Effect per tick of loads that an actuator no longer holds, shape (s,).
        dry_friction: Physics steps with dry friction, which A and B do not contain; None: none.
        floor: Effect per tick of an acceleration of the floor, shape (s, 3); None: unknown.
    """

    A: Array
    B: Array
    C: Array
    onset: Array
    drift: Array
    dry_friction: DryFriction | None = None
    floor: Array | None = None

    def step(self, x: Array, commanded: Array) -> Array:
        """Return the state one tick later for commanded displacements (n,)."""
        if self.dry_friction is not None:
            return self.dry_friction.moved(x.T, commanded.T).T
        moved = self.A.dot(x) + self.B.dot(commanded)
        return (moved.T + self.drift).T  # also for several sequences at once

    def states(self, commanded: Array, start: Array | None = None) -> Array:
        """Return the states before, between and after N commands (N, n), shape (N + 1, s).

        The first is `start`, or rest. c sequences (N, n, c) give states (N + 1, s, c).
        """
        x = np.zeros((len(self.A), *commanded.shape[2:])) if start is None else start
        return np.array(list(accumulate(commanded, self.step, initial=x)))


@np.errstate(all="ignore")  # overflow is reported at the end
def fault_model(nominal: NominalModel, faults: Sequence[Fault] = ()) -> FaultModel:
    """Return the discrete plant with these faults, in the coordinates of the fault-free one.

    An actuator without force has neither drive nor feedback nor holding force; a weak one has a
    fraction of all three. A locked one is a constraint c q_dot = 0, c its row of `displacement`:
    the constraint force acts along M^-1 c^T, as the actuator's own does, so the accelerations are
    projected by P = I - b (c b)^-1 c. The locked displacement stays in the state. A loose one is
    free and has lost its own spring, preload included.

    Raises:
        ValueError: An actuator is loose but the model has no `spring`, or is locked but not moved
            by its command; or the motion in a tick exceeds 1e120.
    """
    P, lower, drive = _accelerations(nominal, faults)
    k, n = len(P), nominal.actuators
    # One step of the integration: velocities first, then positions with the new ones.
    h, eye = nominal.step_s, np.eye(k)
    floor = np.zeros((k, 3)) if nominal.floor is None else nominal.floor
    damping, late = (h * P).dot(lower[:, k:]), eye
    decay = eye + damping
    if nominal.implicit_damping:
        decay = late = np.linalg.inv(eye - damping)
    stiffness, gains = (late @ (h * P @ part) for part in (lower[:, :k], np.hstack([drive, floor])))
    A, B = _blocks(eye + h * stiffness, h * decay, stiffness, decay), np.vstack([h * gains, gains])
    steps = round(nominal.period_s / h)
    moved = sum(np.linalg.matrix_power(A, step) for step in range(steps)) @ B
    commanded, loaded, shaken = (part.copy() for part in np.split(moved, [n, n + 1], axis=1))
    zero, accelerations = np.zeros((k, k)), [P @ lower, P @ drive]
    model = FaultModel(
        A=np.linalg.matrix_power(A, steps),
        B=commanded,
        C=nominal.plant.C / nominal.noise[:, None],
        onset=_blocks(eye, zero, zero, P),
        drift=loaded[:, 0],
        floor=None if nominal.floor is None else shaken,
        dry_friction=_dry_friction(nominal, P, accelerations, A, B[:, : n + 1].copy(), h * late),
    )
    if not all(map(check.is_moderate, (model.A, model.B, model.C, model.onset, model.drift))):
        raise ValueError(
            f"nominal must move by less than {check.LARGEST:g} in a tick, got more by its plant, "
            "displacement, loads or noise"
        )
    return model


def _accelerations(nominal: NominalModel, faults: Sequence[Fault]) -> tuple[Array, Array, Array]:
    """Return the projector of locks (k, k), accelerations per state and per [command; 1]."""
    plant = check.instance("nominal", nominal, NominalModel).plant
    k = plant.nstates // 2
    locked = sorted({*by_kind(of_actuators(faults, nominal.actuators))["locked"]})
    b, c = plant.B[k:, locked], nominal.displacement[locked, :k]
    try:
        P = np.eye(k) - b @ np.linalg.solve(c @ b, c)
    except np.linalg.LinAlgError:
        raise ValueError(
            "faults must not lock actuators whose displacement no command moves, got "
            + ", ".join(actuator_name(nominal.names, k) for k in locked)
        ) from None
    remaining = np.ones(nominal.actuators)
    for fault in faults:
        if fault.kind != "locked":
            remaining[fault.actuator] *= fault.effectiveness if fault.kind == "weak" else 0.0
    drive, lower, push = plant.B[k:] * remaining, plant.A[k:], np.zeros(k)
    if nominal.feedback is not None:
        lower = lower + (plant.B[k:] * (1 - remaining)) @ nominal.feedback
    if nominal.holding is not None:
        push = plant.B[k:] @ ((remaining - 1) * nominal.holding)
    if loose := [fault.actuator for fault in faults if fault.kind == "loose"]:
        if nominal.spring is None:
            name = actuator_name(nominal.names, loose[0])
            raise ValueError(f"nominal must have a spring for {name}, which is loose, got None")
        lower = lower + plant.B[k:, loose] @ nominal.spring[loose]
        if nominal.preload is not None:
            push = push - plant.B[k:, loose] @ nominal.preload[loose]
    return P, lower, np.column_stack([drive, push])


def _blocks(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return [a, b; c, d] of four matrices, much faster than `numpy.block`."""
    return np.concatenate([np.concatenate([a, b], axis=1), np.concatenate([c, d], axis=1)])


def at_rest(A: Array, B: Array, period_s: float) -> Array:
    """Return the steady states per constant input of a discrete system x' = A x + B u.

    Motions without restoring force are evaluated as after a hundred seconds.
    """
    return np.linalg.solve(np.exp(_SLOW_PER_S * period_s) * np.eye(len(A)) - A, B)


def static_gain(nominal: NominalModel, faults: Sequence[Fault] = ()) -> Array:
    """Return the steady displacements per constant command of a plant with faults, (n, n)."""
    plant = fault_model(nominal, faults)
    return nominal.displacement @ at_rest(plant.A, plant.B, nominal.period_s)


def static_share(nominal: NominalModel, fault: Fault) -> float:
    """Return the steady displacement per command of a faulty actuator over its healthy value, 0..1.

    For a coil that works against a spring it is the effectiveness; a weak position servo still
    nearly reaches its command.
    """
    of_actuators([fault], check.instance("nominal", nominal, NominalModel).actuators)
    if fault.kind != "weak":
        return 0.0
    k = fault.actuator
    healthy, weak = (float(static_gain(nominal, faults)[k, k]) for faults in ((), (fault,)))
    return float(np.clip(weak / healthy, 0.0, 1.0)) if healthy > 0 else 0.0


def resting_displacements(
    nominal: NominalModel, faults: Sequence[Fault], commanded: Array
) -> Array | None:
    """Return the displacements (n,) of a plant with faults at rest under constant commands (n,).

    None: the plant does not come to rest, because nothing holds a load.
    """
    plant = fault_model(nominal, faults)
    commanded = check.array("commanded", commanded, nominal.actuators)
    if np.abs(np.linalg.eigvals(plant.A)).max() > 1 - _SLOW_PER_S * nominal.period_s:
        return None
    resting = np.linalg.solve(np.eye(len(plant.A)) - plant.A, plant.B @ commanded + plant.drift)
    return nominal.displacement @ resting


def _dry_friction(
    nominal: NominalModel, P: Array, unimpeded: list[Array], A: Array, B: Array, step: Array
) -> DryFriction | None:
    """Return the physics steps x' = A x + B [u; 1] with dry friction of a plant projected by P.

    `unimpeded` are the accelerations per state and per [u; 1] without friction, for which MuJoCo
    computes the forces before implicit damping; `step` is the velocity per acceleration.
    """
    if nominal.friction is None:
        return None
    push, rows, limit, softness, rate = nominal.friction
    push = P @ push
    E, D = (rows @ part for part in unimpeded)
    E[:, len(P) :] += rate[:, None] * rows
    jolt = step @ push
    return DryFriction(
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
