"""Limits of a robot's motion: ranges, velocities, accelerations, distances."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from argument_checks import Indices
from prioritized import Kinematics, viable_rates
from sim import Array, Distances, Jacobians, ranges
from sim.mjcf import Coupled, Drive, drive_rows, joint_name, name_of

Limited = float | Mapping[str, float] | None
"""Limit of velocities: one number for all, one by joint name, or none."""

_ROUND_OFF = 1e-9
"""Relative tolerance of a position, or of its distance to a limit, for a joint at a stop."""
_BENT = 1e-6
"""Tolerance of tendon limits at the end of a step, relative to the step."""
RETURNING = (1.0, 0.25, 0.0625, 0.0)
"""Fractions of the specified return rate from beyond a limit; the first feasible one is used."""


@dataclass(frozen=True)
class Limits:
    """Limits of a robot's motion, which have priority over all tasks.

    Without accelerations, ranges, velocities and distances hold at every tick. With accelerations
    the rates are such that they hold at this tick and at every later one: each actuated joint
    satisfies :func:`prioritized.viable_rates`, and where several joints together move a limited
    quantity (a distance, tendon, ball joint or passive joint), all of them can brake in proportion
    from these rates, on a straight line. Distances are measured along this line, also beyond
    `detection_m`; the other quantities count to first order.

    If the start is too fast for that, or limits move, accelerations have priority: all joints
    brake, and the solution lists the violated limits (:attr:`IkSolution.exceeded`). A joint beyond
    its range returns as fast as the other limits permit; geoms nearer than their margin separate by
    a fraction of the missing distance in each tick (:class:`sim.Distances`). If loops and limits do
    not permit that rate, the return is slower, or the violation does not grow.

    Attributes:
        ranges: Whether joints (a ball joint's angle) and tendons, actuated or not, stay within the
            ranges of the model. Control ranges do not count.
        velocity: Largest rate of a joint [rad]/[s] or [m]/[s]: one number for all, or a mapping
            from names of joints, tendons, or actuators (meaning what they drive). Of two limits of
            one joint both hold.
        acceleration: Largest acceleration of a joint [rad]/[s^2] or [m]/[s^2], in the same forms,
            from the previous rate `data.qvel`; for tendons only if an actuator drives them.
        distances: Pairs of geoms that keep a minimum distance; None: no pairs.

    Raises:
        ValueError: A limit is not positive.
    """

    ranges: bool = True
    velocity: Limited = None
    acceleration: Limited = None
    distances: Distances | None = None

    def __post_init__(self) -> None:
        check.flag("ranges", self.ranges)
        for name in ("velocity", "acceleration"):
            value = getattr(self, name)
            if isinstance(value, Mapping):
                numbers = {
                    check.instance(f"{name}: a name", key, str): check.number(
                        f'{name}["{key}"]', limit, check.SMALLEST
                    )
                    for key, limit in value.items()
                }
                object.__setattr__(self, name, numbers)
            elif value is not None:
                object.__setattr__(self, name, check.number(name, value, check.SMALLEST))
        if self.distances is not None:
            check.instance("distances", self.distances, Distances)

    def of(self, model: mujoco.MjModel, jac: Jacobians) -> "LimitsOf":
        """Return the limits of each velocity of a mechanism in a model.

        Raises:
            ValueError: A name is ambiguous or not of the mechanism (the message suggests the
                nearest one), or the distances are of another model.
        """
        if self.distances is not None and not self.distances.fits(model):
            raise ValueError("distances must be of this model, got those of another model")
        N = len(jac.names.velocities)
        positions = Positions.of(model, jac) if self.ranges else Positions.free(N)
        meanings = _meanings(model, jac)
        velocity, of_tendons = _limit_of("velocity", self.velocity, meanings, N, model.ntendon)
        acceleration, on_tendons = _limit_of(
            "acceleration", self.acceleration, meanings, N, model.ntendon
        )
        driven = [d.tendon for d in jac.drives if d.tendon is not None]
        of_tendons[driven] = np.inf
        on_tendons[driven] = np.inf
        for k in np.flatnonzero(np.isfinite(on_tendons)):
            name = name_of(model.tendon(k))
            raise ValueError(f'acceleration: no actuator drives the tendon "{name}"')
        coupled = Coupled.of(model, driven, of_tendons, stated=self.ranges)
        extra = tuple(d for d in jac.drives if d.joint is None)
        return LimitsOf(
            self,
            model,
            positions,
            _symmetric(velocity),
            _symmetric(acceleration),
            coupled,
            (*(joint_name(model, k) for k in model.dof_jntid), *(d.name for d in extra)),
            extra,
            (np.zeros((0, model.nv)), np.zeros(0)),
        )


class Positions(NamedTuple):
    """Positions of slides, hinges and tendons with ranges.

    Attributes:
        ranges: Lower and upper position of each velocity, infinite without range, (N,) each.
        joints: Velocity indices of slides and hinges, and their indices in `qpos`.
        tendons: Velocity indices of tendons, and their numbers.
    """

    ranges: tuple[Array, Array]
    joints: tuple[Indices, Indices]
    tendons: tuple[Indices, Indices]

    @classmethod
    def of(cls, model: mujoco.MjModel, jac: Jacobians) -> "Positions":
        """Return the ranges of a mechanism's velocities."""
        stated, extra = ranges(model), [d for d in jac.drives if d.joint is None]
        bounds = np.tile([[-np.inf], [np.inf]], (1, model.nv + len(extra)))
        bounds[:, : model.nv] = stated.joint.T
        velocities = np.flatnonzero(np.isfinite(stated.joint).any(axis=1))
        places = model.jnt_qposadr[model.dof_jntid[velocities]]
        tendons = [(model.nv + k, d.tendon) for k, d in enumerate(extra) if d.tendon is not None]
        numbers = np.array(tendons, dtype=np.intp).reshape(-1, 2).T
        bounds[:, numbers[0]] = stated.tendon[numbers[1]].T
        return cls(_pair(bounds), (velocities, places), (numbers[0], numbers[1]))

    @classmethod
    def free(cls, N: int) -> "Positions":
        """Return N velocities without ranges."""
        none = np.zeros(0, dtype=np.intp)
        return cls(_symmetric(np.full(N, np.inf)), (none, none), (none, none))

    def at(self, data: mujoco.MjData) -> Array:
        """Return the position of each velocity, zero without range, (N,)."""
        (velocities, places), (lengths, tendons) = self.joints, self.tendons
        x = np.zeros(len(self.ranges[0]))
        x[velocities] = data.qpos[places]
        if len(tendons):
            x[lengths] = data.ten_length[tendons]
        return x


class Braking(NamedTuple):
    """Proportional braking of all velocities to rest, as fast as accelerations permit.

    It keeps the limits of quantities that several joints move together, because each quantity comes
    to rest on its way to the limit, too.

    Attributes:
        first: Velocities of the next tick while braking, (N,).
        per_rate: Ticks that one unit of each velocity takes to stop, (N,).
        period_s: Duration of a tick [s].
        below: Largest decrease of each position, (N,).
        above: Largest increase of each position, (N,).
        rows: Rows R (r, nv) of the limited quantities that several joints move together.
        margin: Largest decrease of these quantities, (r,).
    """

    first: Array
    per_rate: Array
    period_s: float
    below: Array
    above: Array
    rows: Array
    margin: Array

    def ticks(self, velocities: Array) -> float:
        """Return the ratio of displacement until rest to that of a tick at these velocities."""
        return stopping_ticks(float((np.abs(velocities) * self.per_rate).max()))

    def excess(self, velocities: Array) -> Array:
        """Return how far positions and rows exceed limits if all joints brake after a tick."""
        shift = self.period_s * self.ticks(velocities) * velocities
        sinks = self.rows @ shift[: self.rows.shape[1]] if len(self.rows) else self.margin
        ends = np.concatenate([self.below + shift, self.above - shift, self.margin + sinks])
        return np.maximum(-ends, 0.0)

    def tolerance(self, velocities: Array) -> Array:
        """Return the round-off tolerance of each entry of :meth:`excess`."""
        distances = np.concatenate([self.below, self.above, self.margin])
        size = np.where(np.isfinite(distances), np.abs(distances), 0.0)
        return _ROUND_OFF * (size + self.period_s * float(np.abs(velocities).max(initial=0.0)))

    def keeps(self, velocities: Array, least: Array) -> bool:
        """Return True if no limit is exceeded by more than the unavoidable `least`."""
        return bool((self.excess(velocities) <= least + self.tolerance(velocities)).all())

    def durations(self, velocities: Array, most: int = 8) -> Iterator[float]:
        """Yield up to `most` durations of a motion, from one tick to that of the way to rest."""
        total = self.ticks(velocities)
        parts = min(most, int(np.ceil(total)))
        yield self.period_s
        for part in range(1, parts):
            yield self.period_s * (1.0 + (total - 1.0) * part / (parts - 1))


def stopping_ticks(ticks: float) -> float:
    """Return the ratio of displacement until rest to that of a tick, at a rate held for a tick."""
    stop = np.floor(ticks)
    return float(1.0 + stop - stop * (stop + 1.0) / (2.0 * ticks)) if stop else 1.0


class RateLimits(NamedTuple):
    """Limits of the rates at one tick.

    Attributes:
        box: Lower and upper limit of each actuator's rate, (n,) each.
        rows: Matrix R, lower and upper limits of R rates, for the rates of the remaining actuators.
        braked: Rates (n,) and R rates while braking; zero without acceleration limits.
        is_cut: True if a row's required rate was reduced to its largest feasible one.
    """

    box: tuple[Array, Array]
    rows: tuple[Array, Array, Array]
    braked: tuple[Array, Array]
    is_cut: bool

    @property
    def excludes_braking(self) -> bool:
        """Return True if even braking violates a limit."""
        sides = [(*self.box, self.braked[0])]
        if len(self.rows[0]):
            sides.append((*self.rows[1:], self.braked[1]))
        return any(
            np.count_nonzero(lower > braked) or np.count_nonzero(upper < braked)
            for lower, upper, braked in sides
        )

    def returning(self, part: float) -> "RateLimits":
        """Return the limits with the required return from violations scaled by a fraction."""
        R, *sides = self.rows
        box, rows = (
            (
                np.minimum(lower, braked + part * np.maximum(lower - braked, 0.0)),
                np.maximum(upper, braked + part * np.minimum(upper - braked, 0.0)),
            )
            for (lower, upper), braked in zip((self.box, sides), self.braked, strict=True)
        )
        return self._replace(box=box, rows=(R, *rows))


class VelocityLimits(NamedTuple):
    """Limits of all velocities at one tick.

    Attributes:
        of: Pose-independent limits.
        pairs: Geoms that are near, (p, 2): rows after those of tendons and balls.
        box: Lower and upper limit of every velocity, (N,) each.
        rows: R of least <= R qvel, shape (r, nv), of tendons, balls, and distances.
        least: Lower limits of the rows, (r,).
        braking: Braking of all velocities; None without coupled quantities or accelerations.
        viable: True for velocities that can satisfy their own limits at all later ticks, (N,).
        period_s: Time until the next tick [s].
    """

    of: "LimitsOf"
    pairs: Indices
    box: tuple[Array, Array]
    rows: Array
    least: Array
    braking: Braking | None
    viable: Array
    period_s: float

    def names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the names of all velocities and of all rows."""
        geoms = tuple(f"geoms {' and '.join(self.of.geom(k) for k in pair)}" for pair in self.pairs)
        return self.of.names, (*self.of.coupled.names, *geoms)

    def are_satisfied_by(self, velocities: Array) -> bool:
        """Return True if velocities satisfy the rows; the box is not checked."""
        return not len(self.rows) or bool(
            (self.rows @ velocities[: self.rows.shape[1]] >= self.least).all()
        )

    def exceeded(self) -> tuple[str, ...]:
        """Return the names of quantities beyond their limits, or too fast to stop before them."""
        of_velocities, of_rows = self.names()
        late = ~self.viable
        if self.braking is None:
            return _unique(of_velocities, late)
        N, limit = len(late), self.braking.tolerance(self.braking.first)
        beyond = self.braking.excess(self.braking.first) > limit
        late = late | beyond[:N] | beyond[N : 2 * N]
        return _unique(of_velocities, late) + _unique(of_rows, beyond[2 * N :])

    def row_names(self, kinematics: Kinematics) -> tuple[str, ...]:
        """Return the names of the rows of :meth:`of_rates`."""
        of_velocities, of_rows = self.names()
        passive = [of_velocities[k] for k in np.flatnonzero(self.limited(kinematics))]
        return (*of_rows, *passive)

    def of_rates(self, active: Indices, kinematics: Kinematics) -> RateLimits:
        """Return the limits of the rates of the active velocities, which move all others."""
        (lower, upper), rows, least = self.box, self.rows, self.least
        n, box = len(kinematics.actuators), (lower[active], upper[active])
        first = np.zeros(len(lower)) if self.braking is None else self.braking.first
        limited, most = self.limited(kinematics), np.full(len(rows), np.inf)
        if not limited.any() and not len(rows):
            none = np.zeros((0, n)), least, most
            return RateLimits(box, none, (first[active], least), is_cut=False)
        motions = kinematics.velocities(np.eye(n)).T
        R = np.vstack([rows @ motions[: rows.shape[1]], motions[limited]])
        least, most = np.append(least, lower[limited]), np.append(most, upper[limited])
        of_first = np.append(rows @ first[: rows.shape[1]], first[limited])
        braked = R @ first[kinematics.active]
        # Loops rotate during the step: a braking motion that was feasible must remain feasible.
        least = np.where(least <= of_first, np.minimum(least, braked), least)
        most = np.where(most >= of_first, np.maximum(most, braked), most)
        required = least, most
        low, high = lower[kinematics.active], upper[kinematics.active]
        below, above = np.where(R > 0, low, high), np.where(R > 0, high, low)
        with np.errstate(invalid="ignore"):
            least = np.minimum(least, np.where(R, R * above, 0.0).sum(axis=1))
            most = np.maximum(most, np.where(R, R * below, 0.0).sum(axis=1))
        is_cut = bool((least < required[0]).any() or (most > required[1]).any())
        return RateLimits(box, (R, least, most), (first[active], braked), is_cut)

    def limited(self, kinematics: Kinematics) -> Array:
        """Return True for limited velocities without working actuator or lock, shape (N,)."""
        lower, upper = self.box
        limited = (lower > -np.inf) | (upper < np.inf)
        limited[kinematics.active] = False
        limited[kinematics.system.joints.stuck] = False
        return limited


class LimitsOf(NamedTuple):
    """Limits of each of the N velocities of a mechanism: joints, then drives that are no joints.

    Attributes:
        limits: Limits as given by the user.
        model: Model of the mechanism.
        positions: Positions of joints and tendons with ranges.
        velocity: Lowest and highest rate of each velocity, (N,) each.
        acceleration: Lowest and highest acceleration, (N,) each.
        coupled: Limited ball joints and undriven tendons, which several velocities move together.
        names: Name of each velocity.
        extra: Drives that are no joints, such as tendons; their velocities follow those of joints.
        without: Rows (0, nv) and lower limits (0,) of a mechanism without coupled quantities.
    """

    limits: Limits
    model: mujoco.MjModel
    positions: Positions
    velocity: tuple[Array, Array]
    acceleration: tuple[Array, Array]
    coupled: Coupled
    names: tuple[str, ...]
    extra: tuple[Drive, ...]
    without: tuple[Array, Array]

    @property
    def has_rows(self) -> bool:
        """Return True if several joints together may move a limited quantity."""
        return self.limits.distances is not None or len(self.coupled.names) > 0

    def at(self, data: mujoco.MjData, period_s: float, kinematics: Kinematics) -> VelocityLimits:
        """Return the limits of the velocities, which are constant until the next tick.

        Args:
            data: The state, updated.
            period_s: Time until the next tick [s].
            kinematics: The mechanism at any pose.
        """
        x, most = self.positions.at(data), self.acceleration[1]
        v = np.zeros(len(x))
        braked = self.limits.acceleration is not None
        if braked:
            v[: self.model.nv] = check.array("data.qvel", data.qvel, None)
            if self.extra:
                v[self.model.nv :] = drive_rows(self.model, data, self.extra) @ data.qvel
            v[kinematics.system.joints.stuck] = 0.0
        box = viable_rates(
            x,
            v,
            position_limits=self.positions.ranges,
            rate_limits=self.velocity,
            acceleration_limits=self.acceleration,
            period_s=period_s,
        )
        is_coupled = self.has_rows or (
            braked and (len(kinematics.passive) > 0 or len(kinematics.active_constraint) > 0)
        )
        sides, common = (box.lower, box.upper), (None, box.viable, period_s)
        if not is_coupled:
            return VelocityLimits(self, _NO_PAIRS, sides, *self.without, *common)
        ticks = float((np.abs(v) / most).max()) / period_s if braked else 0.0
        span_s = period_s * stopping_ticks(ticks + 1.0) if braked else period_s
        rows, margin, gain, pairs = self._rows(data, v, span_s)
        slowest = np.full(len(rows), -np.inf)  # only tendons have velocity limits
        slowest[: len(self.coupled.velocity)] = -self.coupled.velocity
        least = np.where(margin > 0.0, np.minimum(gain / period_s, 1.0 / span_s), gain / period_s)
        with np.errstate(invalid="ignore"):
            least = np.maximum(-least * margin, slowest)
        limits = VelocityLimits(self, pairs, sides, rows, least, *common)
        if not braked:
            return limits
        first = v * max(0.0, 1.0 - 1.0 / ticks) if ticks else v
        low, high = self.positions.ranges
        braking = Braking(first, 1.0 / (most * period_s), period_s, x - low, high - x, rows, margin)
        return limits._replace(
            box=self._of_passive(limits.box, limits.limited(kinematics), v, span_s, braking),
            least=np.where(margin >= 0.0, np.minimum(least, rows @ first[: self.model.nv]), least),
            braking=braking,
        )

    def tightened(
        self, data: mujoco.MjData, limits: VelocityLimits, velocities: Array
    ) -> VelocityLimits | None:
        """Return limits tightened by the violations at the end of a step; None without violations.

        Rows of tendons and ball joints are linearized at the start of a step, but rotate during it.
        `data` is moved and restored.
        """
        model, count, braking = self.model, len(self.coupled.names), limits.braking
        if not count:
            return None
        period_s, span_s = limits.period_s, limits.period_s
        if braking is not None:
            span_s *= braking.ticks(velocities)
        ends = []
        start, qvel = data.qpos.copy(), velocities[: model.nv]
        for duration_s in (span_s, 0.0):
            data.qpos[:] = start
            mujoco.mj_integratePos(model, data.qpos, qvel, duration_s)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            ends.append(self.coupled.slack(data))
        data.qpos[:] = start
        violation = np.minimum(ends[1], 0.0) - ends[0]
        if (violation <= _BENT * period_s * float(np.abs(qvel).max()) + _ROUND_OFF**2).all():
            return None
        least = limits.least.copy()
        least[:count] += np.maximum(violation, 0.0) / span_s
        return limits._replace(least=least)

    def _of_passive(
        self, box: tuple[Array, Array], passive: Array, v: Array, span_s: float, braking: Braking
    ) -> tuple[Array, Array]:
        """Return the box in which passive velocities can brake with the active ones."""
        step = self.acceleration[1] * braking.period_s
        least, most = (np.clip(side, v - step, v + step) for side in self.velocity)
        below, above, first = braking.below, braking.above, braking.first
        lower = np.clip(-below / np.where(below < 0.0, braking.period_s, span_s), least, most)
        upper = np.clip(above / np.where(above < 0.0, braking.period_s, span_s), least, most)
        lower = np.where(below < 0.0, lower, np.minimum(lower, first))
        upper = np.where(above < 0.0, upper, np.maximum(upper, first))
        return (
            np.where(passive, np.where(above < 0.0, np.minimum(lower, upper), lower), box[0]),
            np.where(passive, np.where(below < 0.0, np.maximum(lower, upper), upper), box[1]),
        )

    def _rows(
        self, data: mujoco.MjData, v: Array, span_s: float
    ) -> tuple[Array, Array, Array, Indices]:
        """Return rows R of coupled quantities, their margins, gains per tick, pairs of geoms."""
        rows, margin, pairs = self.coupled.rows(data), self.coupled.slack(data), _NO_PAIRS
        gain, distances = np.ones(len(margin)), self.limits.distances
        if distances is not None:
            qvel = v[: self.model.nv]
            travel_m = 2.0 * distances.farthest(data, qvel, span_s) if qvel.any() else 0.0
            near = distances.at(data, distances.margin_m + travel_m)
            rows = np.vstack([rows, near.rows])
            margin = np.append(margin, near.distance_m - distances.margin_m)
            gain, pairs = np.append(gain, np.full(len(near.rows), distances.gain)), near.pairs
        return rows, margin, gain, pairs

    def geom(self, number: int) -> str:
        """Return the name of a geom, or its number and the name of its body."""
        geom = self.model.geom(number)
        return geom.name or f"{number} of {name_of(self.model.body(geom.bodyid[0]))}"


def _symmetric(most: Array) -> tuple[Array, Array]:
    """Return lower and upper limits, (N,) each, from the largest magnitudes."""
    return _pair(np.array([-most, most]))


def _pair(both: Array) -> tuple[Array, Array]:
    lower, upper = check.read_only(both)
    return lower, upper


class Meaning(NamedTuple):
    """Object that a name denotes: a joint with all its velocities, or another drive.

    Attributes:
        what: Kind and number; an actuator is replaced by its joint or tendon.
        velocities: Velocity indices; none for a tendon without an actuator.
    """

    what: tuple[str, int]
    velocities: list[int]


def _meanings(model: mujoco.MjModel, jac: Jacobians) -> dict[str, list[Meaning]]:
    """Return the objects that each name of a joint, tendon or actuator denotes."""
    meanings: dict[str, list[Meaning]] = {}
    for k in range(model.njnt):
        own = np.flatnonzero(model.dof_jntid == k).tolist()
        meanings.setdefault(model.joint(k).name, []).append(Meaning(("joint", k), own))
    for k in range(model.ntendon):
        meanings.setdefault(model.tendon(k).name, []).append(Meaning(("tendon", k), []))
    for drive, velocity in zip(jac.drives, jac.active.tolist(), strict=False):
        first = drive.ids[0]
        what = ("actuator", first)
        if drive.tendon is not None:
            what = ("tendon", drive.tendon)
            meanings.setdefault(model.tendon(drive.tendon).name, []).append(
                Meaning(what, [velocity])
            )
        elif int(model.actuator_trntype[first]) in _ON_JOINT:
            what = ("joint", int(model.actuator_trnid[first, 0]))
        for k in drive.ids:
            meanings.setdefault(model.actuator(k).name, []).append(Meaning(what, [velocity]))
    meanings.pop("", None)
    return meanings


def _limit_of(
    argument: str, value: Limited, meanings: dict[str, list[Meaning]], N: int, tendons: int
) -> tuple[Array, Array]:
    """Return the limit of every velocity, (N,), and of tendons by name; infinite without limit."""
    by_name = isinstance(value, Mapping)
    limits = np.full(N, np.inf if value is None or by_name else value)
    of_tendons = np.full(tendons, np.inf)
    for name, limit in value.items() if by_name else ():
        matches = meanings.get(name, [])
        if not matches:
            near = get_close_matches(name, meanings, 1)
            hint = f'did you mean "{near[0]}"?' if near else f"it has {', '.join(meanings)}"
            raise ValueError(
                f'{argument}: the model has no joint, tendon or actuator "{name}"; {hint}'
            )
        if len(referents := {meaning.what for meaning in matches}) > 1:
            both = " and ".join(f"{kind} {k}" for kind, k in sorted(referents))
            raise ValueError(f'{argument}: "{name}" stands for {both}: use a unique name')
        for what, velocities in matches:
            limits[velocities] = np.minimum(limits[velocities], limit)
            if what[0] == "tendon":
                of_tendons[what[1]] = min(of_tendons[what[1]], limit)
    return limits, of_tendons


_ON_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
_NO_PAIRS = np.zeros((0, 2), dtype=np.intp)


def _unique(names: tuple[str, ...], chosen: Array) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names[k] for k in np.flatnonzero(chosen)))
