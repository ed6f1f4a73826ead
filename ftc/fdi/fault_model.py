"""The linear plant with faulty actuators, derived from the fault-free one that is known."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array
from ftc.fdi.friction import DryFriction, Rubbing

if TYPE_CHECKING:
    import control

FaultKind = Literal["locked", "free", "weak", "loose"]
"""Stuck where it is; without force; with a part of its force; without force and spring."""

KINDS: tuple[FaultKind, ...] = ("locked", "free", "weak")
"""Those that a diagnosis looks for. It takes an actuator that is loose for one of these."""


_SLOW = 1e-5
"""Growth in a tick, or a sample, of what counts as at rest."""


class Failure(Protocol):
    """What :meth:`Fault.of` needs of a :class:`sim.Failure`."""

    @property
    def number(self) -> int:
        """Of the actuator, 0..n-1."""
        ...

    @property
    def kind(self) -> FaultKind:
        """See :data:`FaultKind`."""
        ...

    @property
    def effectiveness(self) -> float:
        """Part of its force that a weak one has left."""
        ...


@dataclass(frozen=True)
class Fault:
    """Fault of one actuator.

    Attributes:
        actuator: 0..n-1.
        kind: See :data:`FaultKind`.
        effectiveness: Part of its force that a weak actuator has left, in 0..1.

    Raises:
        ValueError: No such kind, a negative actuator, or no such part.
    """

    actuator: int
    kind: FaultKind
    effectiveness: float = 0.0

    def __post_init__(self) -> None:
        check.choice("kind", self.kind, get_args(FaultKind))
        check.index("actuator", self.actuator)
        check.at_most_one("effectiveness", self.effectiveness)

    @property
    def is_sound(self) -> bool:
        """Whether nothing is lost: an actuator that works again."""
        return self.kind == "weak" and self.effectiveness == 1.0

    @classmethod
    def of(cls, failure: Failure) -> "Fault":
        """What a failure leaves behind: the one translation from what happens to what is known."""
        left = failure.effectiveness if failure.kind == "weak" else 0.0
        return cls(failure.number, failure.kind, left)


def by_kind(faults: Sequence[Fault]) -> dict[str, list[int]]:
    """Actuators that are locked and without force, for `ConstrainedSystem.with_failures`.

    Those that are loose are without force; that their springs are gone is said elsewhere.
    """
    kinds = {"locked": ("locked",), "free": ("free", "loose")}
    return {
        name: [each.actuator for each in faults if each.kind in of] for name, of in kinds.items()
    }


def of_actuators(faults: Sequence[Fault], n: int) -> Sequence[Fault]:
    """The faults themselves, which are of these actuators."""
    if not isinstance(faults, list | tuple):
        raise TypeError(f"faults must be a list of faults, got {check.shown(faults)}")
    for each in faults:
        check.index(
            "actuator of each fault in faults",
            check.instance("each fault in faults", each, Fault).actuator,
            n,
        )
    return faults


MOST_STEPS = 10_000
"""Physics steps of a control tick."""


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
        friction: Dry friction of the plant's positions, beside its A; None: nothing rubs.
        floor: Acceleration of the positions per acceleration of the floor, shape (s / 2, 3); None:
            it is not known.
        names: Of the actuators, for sentences; None: these have numbers.

    All arrays are copied, and read-only.

    Raises:
        ValueError, TypeError: Of another shape or kind than that, a tick longer than a day or than
            10,000 steps.
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
    friction: DryFriction | None = None
    floor: Array | None = None
    names: Sequence[str] | None = None

    def __post_init__(self) -> None:
        import control  # late, as in ftc.compensator

        plant = copy(check.instance("plant", self.plant, control.StateSpace))
        k, n, s = plant.nstates // 2, plant.ninputs, plant.nstates
        for name in "ABCD":
            setattr(plant, name, check.frozen(check.matrix(f"plant.{name}", getattr(plant, name))))
        mechanical = np.array_equal(plant.A[:k], np.eye(k, 2 * k, k)) and not plant.B[:k].any()
        if not (k and n and plant.noutputs and mechanical) or plant.D.any() or not plant.isctime():
            raise ValueError(
                "plant must be continuous with states [q; q_dot] and no feedthrough, got "
                f"{check.shown(plant)}"
            )
        shapes = {"displacement": (n, s), "feedback": (n, s), "spring": (n, s)}
        shapes |= {"holding": (n,), "preload": (n,), "noise": (plant.noutputs,), "floor": (k, 3)}
        damping = check.flag("implicit_damping", self.implicit_damping)
        kept: dict[str, Any] = {"plant": plant, "implicit_damping": damping}
        for name, shape in shapes.items():
            if name in ("displacement", "noise") or getattr(self, name) is not None:
                kept[name] = check.frozen(check.exactly(name, getattr(self, name), *shape))
        check.all_positive("noise", kept["noise"], plant.noutputs)
        if self.friction is not None:
            kept["friction"] = check.instance("friction", self.friction, DryFriction).checked(k)
        if self.names is not None:
            kept["names"] = check.members("names", self.names, str)
            if len(kept["names"]) != n:
                raise ValueError(f"names must be {n}, got {len(kept['names'])}")
        for name in ("period_s", "step_s"):
            kept[name] = check.duration(name, getattr(self, name))
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
        """Number of them, n."""
        return self.plant.ninputs

    def measured(self, C: ArrayLike, noise: ArrayLike) -> "NominalModel":
        """The same plant with other outputs.

        Args:
            C: What is measured, per state, shape (p, s).
            noise: Standard deviation of each output's white noise, shape (p,).

        Raises:
            ValueError, TypeError: Of another shape than that.
        """
        import control  # late, as in ftc.compensator

        rows = check.matrix("C", C, columns=self.plant.nstates)
        return replace(self, plant=control.ss(self.plant.A, self.plant.B, rows, 0), noise=noise)

    @property
    def loses_only_commands(self) -> bool:
        """Whether a released actuator leaves the rest of the plant as it is: no servo, no load."""
        return all(part is None or not part.any() for part in (self.feedback, self.holding))


@dataclass(frozen=True)
class FaultModel:
    """x' = A x + B u + drift from tick to tick, u the commanded displacements; outputs y = C x.

    Attributes:
        A: Shape (s, s).
        B: Shape (s, n).
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
        """The states before, between and after N commands, shape (N + 1, s).

        Args:
            commanded: Displacements held for a tick each, shape (N, n); or (N, n, c) for c
                sequences of commands at once, and the states are (N + 1, s, c).
            start: The first state; None is rest.
        """
        x = np.zeros((len(self.A), *commanded.shape[2:])) if start is None else start
        states = [x]
        for u in commanded:
            x = self.step(x, u)
            states.append(x)
        return np.array(states)

    def outputs(self, commanded: Array) -> Array:
        """Whitened outputs (N, p) at the ticks from which on commands (N, n) hold, from rest.

        Several sequences at once as in :meth:`states`: (N, p, c).
        """
        return np.array([self.C @ x for x in self.states(commanded)[:-1]])


@np.errstate(all="ignore")  # the end says what overflows
def fault_model(nominal: NominalModel, faults: Sequence[Fault] = ()) -> FaultModel:
    """The plant with these faults from tick to tick, in the coordinates of the fault-free one.

    An actuator without force neither drives nor feeds back nor holds anything; a weak one has a
    part of all three left. A locked one is a constraint c q_dot = 0, c its row of `displacement`:
    the constraint force acts along M^-1 c^T, as the actuator's own does, so the accelerations are
    projected by P = I - b (c b)^-1 c. The frozen displacement stays in the state. A loose one has
    lost its own spring, preload included, besides.

    Raises:
        ValueError, TypeError: Not a model, or not faults of its actuators; one is loose whose
            spring the model does not know, or locked and does not move itself; or the plant moves
            beyond all numbers in a tick.
    """
    plant = check.instance("nominal", nominal, NominalModel).plant
    k = plant.nstates // 2
    locked = sorted(
        {
            fault.actuator
            for fault in of_actuators(faults, nominal.actuators)
            if fault.kind == "locked"
        }
    )
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
    # One step of the integration: velocities first, then positions with the new ones.
    h, eye = nominal.step_s, np.eye(k)
    unimpeded = [P @ part for part in (lower, np.column_stack([drive, push]))]
    floor = np.zeros((k, 3)) if nominal.floor is None else nominal.floor
    stiffness, damping, drive, push, floor = (
        h * P @ part for part in (lower[:, :k], lower[:, k:], drive, push, floor)
    )
    kept = eye + damping
    if nominal.implicit_damping:
        kept = np.linalg.inv(eye - damping)
        stiffness, drive, push, floor = (kept @ part for part in (stiffness, drive, push, floor))
    A, B = _blocks(eye + h * stiffness, h * kept, stiffness, kept), np.vstack([h * drive, drive])
    steps = round(nominal.period_s / h)
    total = sum(np.linalg.matrix_power(A, step) for step in range(steps))
    none = np.zeros((k, k))
    found = FaultModel(
        A=np.linalg.matrix_power(A, steps),
        B=total @ B,
        C=plant.C / nominal.noise[:, None],
        onset=_blocks(eye, none, none, P),
        drift=total @ np.concatenate([h * push, push]),
        floor=None if nominal.floor is None else total @ np.vstack([h * floor, floor]),
        rubbing=_rubbing(
            nominal, P, unimpeded, A, np.column_stack([B, [*(h * push), *push]]), kept
        ),
    )
    if not all(map(check.is_moderate, (found.A, found.B, found.C, found.onset, found.drift))):
        raise ValueError(
            "nominal must move by moderate numbers in a tick, got more by its plant, displacement, "
            "loads or noise"
        )
    return found


def _blocks(a: Array, b: Array, c: Array, d: Array) -> Array:
    """[a, b; c, d] of four matrices of one size; `numpy.block` takes ten times as long."""
    k = len(a)
    whole = np.empty((2 * k, 2 * k))
    whole[:k, :k], whole[:k, k:], whole[k:, :k], whole[k:, k:] = a, b, c, d
    return whole


def at_rest(A: Array, B: Array) -> Array:
    """States per constant input, long after it, of x' = A x + B u; at rest itself may be a pole."""
    return np.linalg.solve(np.exp(_SLOW) * np.eye(len(A)) - A, B)


def static_gain(nominal: NominalModel, faults: Sequence[Fault] = ()) -> Array:
    """Displacements per constant command, long after it, of a plant with faults, shape (n, n)."""
    plant = fault_model(nominal, faults)
    return nominal.displacement @ at_rest(plant.A, plant.B)


def static_share(nominal: NominalModel, fault: Fault) -> float:
    """Displacement that a command of the actuator still causes, over that of a sound one, 0..1.

    Of a coil that works against a spring it is the part of the force that is left; a weak position
    servo still goes nearly where it is told.

    Raises:
        ValueError, TypeError: Not a model, or not a fault of its actuators.
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

    Raises:
        ValueError, TypeError: As :func:`fault_model`, or commands of another shape.
    """
    plant = fault_model(nominal, faults)
    commanded = check.exactly("commanded", commanded, nominal.actuators)
    if np.abs(np.linalg.eigvals(plant.A)).max() > 1 - _SLOW:
        return None
    at_rest = np.linalg.solve(np.eye(len(plant.A)) - plant.A, plant.B @ commanded + plant.drift)
    return nominal.displacement @ at_rest


def _rubbing(
    nominal: NominalModel, P: Array, unimpeded: list[Array], A: Array, B: Array, kept: Array
) -> Rubbing | None:
    """Physics steps x' = A x + B [u; 1] with dry friction of a plant that is projected by P.

    `unimpeded` are the accelerations per state and per [u; 1] without it. MuJoCo finds the forces
    for these, before the integration makes the dampers implicit by `kept`.
    """
    rubs, h, plant = nominal.friction, nominal.step_s, nominal.plant
    if rubs is None:
        return None
    push = P @ rubs.push
    E, D = (rubs.rows @ part for part in unimpeded)
    E[:, len(P) :] += rubs.rate[:, None] * rubs.rows
    jolt = h * kept @ push if nominal.implicit_damping else h * push
    return Rubbing(
        A=A,
        B=B,
        G=np.vstack([h * jolt, jolt]),
        E=E,
        D=D,
        K=rubs.rows @ push + np.diag(rubs.softness),
        limit=rubs.limit,
        C=plant.C / nominal.noise[:, None],
        steps_a_tick=round(nominal.period_s / h),
    )
