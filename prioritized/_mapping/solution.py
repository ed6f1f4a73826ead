"""Solutions of the mappings under limits."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from argument_checks import Array, Mask
from argument_checks.ties import ACCURACY
from prioritized._mapping.levels import Level, lexicographic
from prioritized._mapping.limited import Optimum, optimum
from prioritized._mapping.task import Status, status_of
from prioritized._solver.arrays import ReadOnly, read_only, times
from prioritized._solver.packed import Point
from prioritized._solver.rank import ROUND_OFF, frobenius

if TYPE_CHECKING:
    from prioritized._mapping.force import ForceMapping
    from prioritized._mapping.velocity import VelocityMapping


@dataclass(frozen=True, eq=False)
class Limited(ReadOnly):
    """Optimum of a mapping under limits.

    Attributes:
        mapping: Mapping that was solved.
        targets: Major task and desired secondary quantities, (..., p).
        optimum: Result of the solver.
    """

    mapping: "VelocityMapping | ForceMapping"
    targets: Array
    optimum: Optimum

    @property
    def major_target(self) -> Array:
        """Target of the major task in the units of the problem, shape (..., m1)."""
        return self.targets[..., : len(self.mapping._problem.S_m)]

    @cached_property
    def unlimited(self) -> Array:
        """Unknowns without limits, (..., n)."""
        mapping = self.mapping
        return optimum(mapping._levels, self.targets, None, mapping._problem.tolerance).x

    @property
    def residual(self) -> Array:
        """Part of the major task that is not achieved, shape (..., m1)."""
        return read_only(np.asarray(self.major_target - self._major(self.optimum.x)))

    @property
    def scale(self) -> Array:
        """Fraction of the achievable major task that remains within the limits, (...).

        Below 1 if limits restrict it and `when_limited` is "scaled".
        """
        return self.optimum.scale

    @property
    def point(self) -> Point:
        """Result of the solver, which can warm-start another solution."""
        return self.optimum.point

    @cached_property
    def limited(self) -> Mask:
        """Return whether limits restrict the major task, (...)."""
        lost = np.linalg.norm(self._major(self.optimum.x - self.unlimited), axis=-1)
        terms = np.abs(self.mapping._levels[1].A).sum(axis=(-2, -1))
        round_off = 1e3 * ROUND_OFF * terms * np.linalg.norm(self.unlimited, axis=-1)
        is_limited = lost > ACCURACY * np.linalg.norm(self.major_target, axis=-1) + round_off
        return read_only(np.asarray(is_limited))

    @property
    def status(self) -> Status:
        """Status that holds for every problem of the batch; its value says what to do."""
        conditions = {
            Status.UNFINISHED: lambda: not self.optimum.point.ended.all(),
            Status.INFEASIBLE: lambda: self.optimum.infeasible,
            Status.SELF_MOTION: lambda: self.mapping.status is Status.SELF_MOTION,
            Status.SCALED: lambda: self.limited.any() and np.any(self.scale < 1.0),
            Status.LIMITED: self.limited.any,
        }
        return status_of(conditions, self.mapping.status)

    def _major(self, x: Array) -> Array:
        """Return the major task of the unknowns."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class VelocitySolution(Limited):
    """Optimal rates under limits; created by :meth:`VelocityMapping.solve`."""

    mapping: "VelocityMapping"

    @property
    def rates(self) -> Array:
        """Rates of the surviving actuators, within the limits exactly, shape (..., n)."""
        return self.mapping._own_rates(self.optimum.x)

    @property
    def active_limits(self) -> NDArray[np.int8]:
        """Limits that the rates are at: -1 the lower, 1 the upper, 0 none, shape (..., n)."""
        return self.optimum.active

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """Limits that the inequality rows are at: -1 the lower, 1 the upper, 0 none, (..., r)."""
        return self.optimum.active_rows

    def _major(self, x: Array) -> Array:
        return times(self.mapping._problem.major_jacobian, x)

    @cached_property
    def gains(self) -> Array:
        """Derivative of the rates by [v_m; rates_d; v_sd] with these limits active.

        Shape (..., n, m1 + n + m2); rows of actuators at their limits are zero. With
        `when_limited="scaled"`, v_m is the scaled major velocity.
        """
        free = self.active_limits[..., None, :] == 0
        levels = [level._replace(A=level.A * free) for level in self.mapping._levels]
        nothing = np.zeros((1, levels[0].target.shape[-1]))
        rows, first = [], 0
        for block in self.mapping._rows:
            is_active = self.active_rows[..., first : first + len(block.G), None] != 0
            first += len(block.G)
            rows.append(Level(block.G * is_active * free, nothing, frobenius(block.G)))
        X, _ = lexicographic([*rows, *levels], self.mapping._problem.tolerance)
        return read_only(self.mapping._own_gains(X * np.swapaxes(free, -1, -2)))


@dataclass(frozen=True, eq=False)
class ForceSolution(Limited):
    """Optimal torques under limits; created by :meth:`ForceMapping.solve`."""

    mapping: "ForceMapping"

    @property
    def torques(self) -> Array:
        """Torques of the surviving actuators, within the limits exactly, shape (..., n)."""
        limit, units = self.mapping._rows[0], self.mapping._units
        torques = times(limit.G, self.optimum.x)
        if units is not None:
            torques = torques / units.torques
        box = self.mapping._torque_limits
        return read_only(torques if box is None else torques.clip(*box))

    @property
    def active_limits(self) -> NDArray[np.int8]:
        """Limits that the torques are at: -1 the lower, 1 the upper, 0 none, shape (..., n)."""
        return self.optimum.active_rows[..., : len(self.mapping._rows[0].limits[0])]

    @property
    def active_rows(self) -> NDArray[np.int8]:
        """Limits that `torque_rows`, then `force_rows` are at: -1, 1, or 0 for none, (..., r)."""
        return self.optimum.active_rows[..., len(self.mapping._rows[0].limits[0]) :]

    @property
    def residual(self) -> Array:
        """Part of the major force that no equilibrium within the limits admits, (..., m1)."""
        residual, units = super().residual, self.mapping._units
        return residual if units is None else read_only(residual / units.measure.major)

    @property
    def secondary_force(self) -> Array:
        """Secondary force f_s of these torques, shape (..., m2)."""
        force, units = self._parts[1], self.mapping._units
        return force if units is None else force / units.secondary

    @property
    def internal_force(self) -> Array:
        """Internal force eta of these torques, one per row of C, shape (..., r)."""
        force, units = self._parts[2], self.mapping._units
        return force if units is None else times(units.internal, force)

    @property
    def _parts(self) -> list[Array]:
        problem = self.mapping._problem
        m1, m2 = len(problem.S_m), len(problem.S_s)
        return np.split(self.optimum.x, [m1, m1 + m2], axis=-1)

    def _major(self, x: Array) -> Array:
        return x[..., : len(self.mapping._problem.S_m)]
