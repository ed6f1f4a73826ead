"""Limits of a robot in one call: ranges, velocities, accelerations, distances."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from argument_checks import Indices
from prioritized import Kinematics, viable_rates
from sim import Array, Distances, Jacobians, ranges

Limited = float | Mapping[str, float] | None
"""One number for every velocity, one for each joint by its name, or no limit."""


@dataclass(frozen=True)
class Limits:
    """What a robot may do, whatever its tasks ask for.

    Rates are such that all limits can be kept at the next tick and every later one
    (:func:`prioritized.viable_rates`). A joint beyond its range returns as fast as the other limits
    allow; geoms nearer than their margin part by a share of what is missing in each tick
    (:class:`sim.Distances`). Where loops and limits together do not let it return so fast, it goes
    no farther.

    Attributes:
        ranges: Whether joints and tendons stay within the ranges that the model states.
        velocity: Largest rate of a joint [rad]/[s] or [m]/[s]: one number for all, or by name of
            joint, tendon or actuator.
        acceleration: Likewise, of joints [rad]/[s^2] or [m]/[s^2]; `data.qvel` is the rate before.
        distances: Geoms that keep their distance, or None.

    Raises:
        ValueError: A limit that is not positive.
        TypeError: An argument is of another kind.
    """

    ranges: bool = True
    velocity: Limited = None
    acceleration: Limited = None
    distances: Distances | None = None

    def __post_init__(self) -> None:
        """Check the arguments."""
        check.flag("ranges", self.ranges)
        for name in ("velocity", "acceleration"):
            value = getattr(self, name)
            if isinstance(value, Mapping):
                own = {key: check.positive(name, each) for key, each in value.items()}
                object.__setattr__(self, name, own)
            elif value is not None:
                check.positive(name, value)
        if self.distances is not None:
            check.instance("distances", self.distances, Distances)

    def of(self, model: mujoco.MjModel, jac: Jacobians) -> "LimitsOf":
        """The same by the numbers of a mechanism's velocities.

        Raises:
            ValueError: A name that the mechanism does not have, with the nearest.
        """
        assert jac.machine is not None
        names = jac.machine.names.velocities
        positions = Positions.of(model, jac) if self.ranges else Positions.free(len(names))
        velocity = _both_ways(_each("velocity", self.velocity, names))
        acceleration = _both_ways(_each("acceleration", self.acceleration, names))
        without = np.zeros((0, model.nv)), np.zeros(0)
        return LimitsOf(self, positions, velocity, acceleration, without)


class Positions(NamedTuple):
    """Positions of slides, hinges and tendons, of which ranges are stated.

    Attributes:
        ranges: Lower and upper position of each velocity, infinite where there is none, (N,) each.
        joints: Velocities of slides and hinges, and their places in `qpos`.
        tendons: Velocities of tendons, and their numbers.
    """

    ranges: tuple[Array, Array]
    joints: tuple[Indices, Indices]
    tendons: tuple[Indices, Indices]

    @classmethod
    def of(cls, model: mujoco.MjModel, jac: Jacobians) -> "Positions":
        """Those of a mechanism's velocities."""
        assert jac.machine is not None
        stated, extra = ranges(model), [d for d in jac.machine.drives if d.joint is None]
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
        """Those of velocities without ranges."""
        none = np.zeros(0, dtype=np.intp)
        return cls(_both_ways(np.full(N, np.inf)), (none, none), (none, none))

    def at(self, data: mujoco.MjData) -> Array:
        """Position of each velocity, zero where none is limited, (N,)."""
        (velocities, places), (lengths, tendons) = self.joints, self.tendons
        x = np.zeros(len(self.ranges[0]))
        x[velocities] = data.qpos[places]
        if len(tendons):
            x[lengths] = data.ten_length[tendons]
        return x


class RateLimits(NamedTuple):
    """Limits of the rates at one tick.

    Attributes:
        box: Lower and upper limit of each actuator's rate, (n,) each.
        rows: R, lower and upper of lower <= R rates <= upper, for those that survive.
    """

    box: tuple[Array, Array]
    rows: tuple[Array, Array, Array]

    @property
    def excludes_rest(self) -> bool:
        """Whether something must move."""
        sides = [self.box, self.rows[1:]] if len(self.rows[0]) else [self.box]
        return any(
            np.count_nonzero(lower > 0.0) or np.count_nonzero(upper < 0.0) for lower, upper in sides
        )

    def no_farther(self) -> "RateLimits":
        """The same where rest is allowed: what is beyond a limit need not return."""
        R, *sides = self.rows
        return RateLimits(_with_zero(*self.box), (R, *_with_zero(*sides)))


class VelocityLimits(NamedTuple):
    """Limits of all velocities at one tick.

    Attributes:
        box: Lower and upper limit of every velocity, (N,) each.
        rows: R of least <= R qvel, shape (r, nv), from distances.
        least: Shape (r,).
    """

    box: tuple[Array, Array]
    rows: Array
    least: Array

    def are_kept_by(self, velocities: Array) -> bool:
        """Whether the rows are; the box is left to whoever asks."""
        return not len(self.rows) or bool(
            (self.rows @ velocities[: self.rows.shape[1]] >= self.least).all()
        )

    def of_rates(self, active: Indices, kinematics: Kinematics) -> RateLimits:
        """The same for the rates of these velocities, which move all others."""
        (lower, upper), rows, least = self.box, self.rows, self.least
        n, box = len(kinematics.actuators), (lower[active], upper[active])
        # Velocities without a working actuator that are limited, and not stuck.
        limited = (lower > -np.inf) | (upper < np.inf)
        limited[kinematics.active] = False
        limited[kinematics.system.joints.stuck] = False
        most = np.full(len(rows), np.inf)
        if not limited.any() and not len(rows):
            return RateLimits(box, (np.zeros((0, n)), least, most))
        motions = kinematics.velocities(np.eye(n)).T
        R = np.vstack([rows @ motions[: rows.shape[1]], motions[limited]])
        least, most = np.append(least, lower[limited]), np.append(most, upper[limited])
        return RateLimits(box, (R, least, most))


class LimitsOf(NamedTuple):
    """Limits by the numbers of a mechanism's velocities.

    Attributes:
        limits: What is limited.
        positions: Of joints and tendons with ranges.
        velocity: Least and largest rate of each velocity, (N,) each.
        acceleration: Least and largest acceleration, (N,) each.
        without: Of distances no rows, (0, nv), and no least products, (0,).
    """

    limits: Limits
    positions: Positions
    velocity: tuple[Array, Array]
    acceleration: tuple[Array, Array]
    without: tuple[Array, Array]

    def at(self, data: mujoco.MjData, period_s: float) -> VelocityLimits:
        """Limits of the velocities that are constant until the next tick."""
        rows, least = self.without
        if self.limits.distances is not None:
            rows, least = self.limits.distances.rate_limits(data, period_s)
        return VelocityLimits(self._of_velocities(data, period_s), rows, least)

    def _of_velocities(self, data: mujoco.MjData, period_s: float) -> tuple[Array, Array]:
        """Lower and upper limit of every velocity, (N,) each."""
        rates, qvel = np.zeros(len(self.velocity[0])), data.qvel
        rates[: len(qvel)] = qvel
        box = viable_rates(
            self.positions.at(data),
            rates,
            position_limits=self.positions.ranges,
            rate_limits=self.velocity,
            acceleration_limits=self.acceleration,
            period_s=period_s,
        )
        return box.lower, box.upper


def _both_ways(most: Array) -> tuple[Array, Array]:
    """The least and the most, (N,) each, of limits that are the same in both directions."""
    return _pair(np.array([-most, most]))


def _pair(both: Array) -> tuple[Array, Array]:
    """Rows of an array (2, N), as plain vectors: a tick takes no views."""
    lower, upper = check.read_only(both)
    return lower, upper


def _with_zero(lower: Array, upper: Array) -> tuple[Array, Array]:
    return np.minimum(lower, 0.0), np.maximum(upper, 0.0)


def _each(argument: str, value: Limited, names: Sequence[str]) -> Array:
    """The limit of every velocity, infinite where there is none, (N,)."""
    if not isinstance(value, Mapping):
        return np.full(len(names), np.inf if value is None else value)
    limits, known = np.full(len(names), np.inf), np.array(names)
    for name, limit in value.items():
        own = known == check.instance(argument, name, str)
        if not own.any():
            near = get_close_matches(name, filter(None, names), 1)
            hint = (
                f'did you mean "{near[0]}"?' if near else f"it has {', '.join(filter(None, names))}"
            )
            raise ValueError(f'{argument}: the model has no joint "{name}"; {hint}')
        limits[own] = limit
    return limits
