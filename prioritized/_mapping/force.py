"""Force mapping: Problem 6 of the paper for any weights, with internal forces and self-motion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from argument_checks import Array, Indices
from prioritized._mapping.amplification import as_sentence, closure_sentences, length_sentences
from prioritized._mapping.levels import (
    Forces,
    Level,
    force_levels,
    forces_of,
    lexicographic,
    smallest_gap,
)
from prioritized._mapping.limited import Limiting, WhenLimited, limiting, optimum
from prioritized._mapping.problem import Problem, checked
from prioritized._mapping.solution import ForceSolution
from prioritized._mapping.task import Status, status_of
from prioritized._mechanism.decisions import respanned
from prioritized._mechanism.measure import Measure, units_of
from prioritized._solver.arrays import (
    ReadOnly,
    apply,
    joined,
    on_axes,
    read_only,
    stack,
    transposed,
)
from prioritized._solver.limits import Limits, limits
from prioritized._solver.packed import Rows
from prioritized._solver.rank import RANK_TOLERANCE, basis_scale, frobenius, largest, ranked_svd

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics

Gains = tuple[Array, ...]
"""Gains of major force, desired torque and desired secondary force."""


@dataclass(frozen=True, eq=False)
class ForceMapping(ReadOnly):
    """Mapping from a major force to the optimal active joint torques, by :func:`force_mapping`.

    torques = major @ f_m + torque @ torques_desired + secondary @ f_s_desired

    Attributes:
        achieved: Major force in equilibrium per major force commanded, (..., m1, m1).
        reaction: Orthogonal projector on the task forces that the structure bears without any
            torque, shape (..., m, m); zero if there are none. If these have a major part, the
            torques balance f_m but do not determine it.
        rank: Dimension of the major forces that equilibrium admits, shape (...).
        gap: Factor by which the rank threshold could change before any rank would, shape (...).
        status: Status that holds for every problem of the batch.
        closure_condition: As :attr:`Manipulability.closure_condition`; 1 for a J given as a matrix.
    """

    _torque_gains: Gains
    _secondary_gains: Gains
    _internal_gains: Gains
    achieved: Array
    reaction: Array
    rank: Indices
    gap: Array
    status: Status
    _problem: Problem
    _limiting: Limiting | None  # of the unknowns [f_m; f_s; eta]; its first rows are the torques'
    _torque_limits: Limits | None
    closure_condition: float = 1.0
    _units: "ForceUnits | None" = None  # in which the problem is stated; None are those of J

    def __str__(self) -> str:
        sentences = (
            as_sentence(self.status.value),
            *length_sentences(self.characteristic_length),
            *closure_sentences(self.closure_condition),
        )
        return " ".join(sentences)

    @property
    def characteristic_length(self) -> float | None:
        """Length that relates forces and moments in one norm, as for :class:`VelocityMapping`."""
        if self._units is None:
            return None
        is_exact = self.status is not Status.LEAST_SQUARES and self._limiting is None
        return self._units.measure.length(not is_exact, self._problem.has_ties)

    @cached_property
    def largest_gain(self) -> Array:
        """Largest norm of the torques per unit norm of the major force alone, shape (...).

        If forces and moments are mixed, lengths are in units of the mechanism's length.
        """
        gain = self.major
        if self._units is not None:
            gain = self._units.measure.inverse.of_gain(gain)
        return read_only(largest(gain))

    @property
    def major(self) -> Array:
        """Torques per major force, shape (..., n, m1)."""
        return self._torque_gains[0]

    @property
    def torque(self) -> Array:
        """Torques per desired torque, shape (..., n, n)."""
        return self._torque_gains[1]

    @property
    def secondary(self) -> Array:
        """Torques per desired secondary force, shape (..., n, m2)."""
        return self._torque_gains[2]

    def __call__(
        self,
        f_major: ArrayLike,
        torque: ArrayLike | None = None,
        secondary_force: ArrayLike | None = None,
    ) -> Array:
        """Return the optimal active joint torques, shape (..., n); None counts as zero."""
        if self._limiting is not None:
            return self.solve(f_major, torque, secondary_force).torques
        return _respond(self._torque_gains, f_major, torque, secondary_force)

    def solve(
        self,
        f_major: ArrayLike,
        torque: ArrayLike | None = None,
        secondary_force: ArrayLike | None = None,
        *,
        start: ForceSolution | None = None,
    ) -> ForceSolution:
        """Return the optimal torques within the limits, with residual, active limits and status.

        Limits and equilibrium hold first, then the error of the major force is least, then the
        weighted sum of :func:`force_mapping`. Gains, :meth:`secondary_force` and
        :meth:`internal_force` of the mapping ignore limits: use those of the solution.

        Args:
            f_major: Major force, shape (..., m1).
            torque: Desired torques, shape (..., n); None is zero.
            secondary_force: Desired secondary force, shape (..., m2); None is zero.
            start: Solution of a similar problem, such as that of the previous tick.
        """
        problem = self._problem
        m1, n = len(problem.S_m), problem.J.shape[-1]
        p = joined(
            problem.lead,
            "f_major",
            f_major=(f_major, m1),
            torque=(torque, n),
            secondary_force=(secondary_force, len(problem.S_s)),
        )
        if self._units is not None:
            p = p * self._units.inputs
        warm = None if start is None else check.instance("start", start, ForceSolution).point
        best = optimum(self._levels, p, self._within, problem.tolerance, warm)
        return ForceSolution(self, p, best)

    @property
    def _forces(self) -> Forces:
        """Task force and torques per unknown."""
        return forces_of(self._problem)

    @property
    def _levels(self) -> list[Level]:
        """Problem 6 as levels of least squares."""
        return force_levels(self._problem, self._forces)

    @property
    def _rows(self) -> tuple[Rows, ...]:
        """Inequality rows of the unknowns; the first ones are the torques, even without limits."""
        return self._within.rows

    @property
    def _within(self) -> Limiting:
        if self._limiting is not None:
            return self._limiting
        return _of_torques(self._forces, limits("torque_limits", None, self._problem.J.shape[-1]))

    def secondary_force(
        self,
        f_major: ArrayLike,
        torque: ArrayLike | None = None,
        secondary_force: ArrayLike | None = None,
    ) -> Array:
        """Return the secondary force f_s of the optimal torques, shape (..., m2)."""
        return _respond(self._secondary_gains, f_major, torque, secondary_force)

    def internal_force(
        self,
        f_major: ArrayLike,
        torque: ArrayLike | None = None,
        secondary_force: ArrayLike | None = None,
    ) -> Array:
        """Return the internal force eta of the optimal torques, one per row of C, (..., r)."""
        return _respond(self._internal_gains, f_major, torque, secondary_force)

    def residual(self, f_major: ArrayLike) -> Array:
        """Return the part of the major force that no equilibrium admits, shape (..., m1)."""
        f_m = check.array("f_major", f_major, ..., self.achieved.shape[-1])
        return f_m - apply(self.achieved, "f_major", f_m)


class ForceUnits(NamedTuple):
    """Natural units in which a force mapping is solved, as velocities dual to the forces.

    Attributes:
        measure: Natural units of the major velocities and of the rates.
        secondary: Natural units of the secondary velocities, (m2,).
        task: Natural units of the task rows, (m,).
        torques: Natural units of the rates, (n,).
        internal: Internal force in the units of J per one in natural units, (r, r).
    """

    measure: Measure
    secondary: Array
    task: Array
    torques: Array
    internal: Array

    @property
    def inputs(self) -> Array:
        """Natural major force, torques and secondary force per one in the units of J."""
        return np.concatenate([self.measure.major, self.torques, self.secondary])


class ForceLimits(NamedTuple):
    """Limits of torques and forces as given to :func:`force_mapping`."""

    torques: tuple[ArrayLike, ArrayLike] | None
    torque_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None
    force_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None
    when: WhenLimited


def force_mapping(
    J: ArrayLike,
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None = None,
    torque_weight: ArrayLike | None = None,
    secondary_weight: ArrayLike | None = None,
    active_constraint: ArrayLike | None = None,
    self_motion: ArrayLike | None = None,
    *,
    major_metric: ArrayLike | None = None,
    tie_metric: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
    torque_limits: tuple[ArrayLike, ArrayLike] | None = None,
    torque_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    force_rows: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    when_limited: WhenLimited = "least_squares",
) -> ForceMapping:
    """Return the mapping from a major force to the optimal active joint torques.

    It minimizes |W3 (torques - torques_d)|^2 + |W4 (f_s - f_sd)|^2 at the given major force, where
    torques = J^T f + C^T eta with f = S_m^T f_m + S_s^T f_s, eq. (16): f_m is dual to v_m by
    power, for any directions. The unknowns are the secondary force f_s and the internal force eta.
    Lexicographic least squares: each level is solved without changing those before it.

    1. Q^T f = 0                          (otherwise f accelerates the self-motion, eq. 9)
    2. |M (f_m - f_md)|        smallest   (zero where level 1 admits the major force, eq. 33)
    3. the weighted sum above  smallest
    4. |T torques|, then |torques|, then |f_s|, then |eta| smallest   (ties)

    Theorems 7, 8 and 9 of Chen, McInroy, Yi (2003) are the cases without self-motion and internal
    force of W3, W4 both nonsingular, W4 = 0, and W3 = 0; here the weights may be any matrices.
    f . v = torques . rates for all admissible rates and any self-motion.

    Args:
        J: Task Jacobian, eq. (14), shape (..., m, n).
        major: Task rows of the major task, or a matrix of directions (m1, m).
        secondary: Task rows, or directions (m2, m), of the secondary task; by default the
            remaining rows in ascending order (for directions: their orthogonal complement).
        torque_weight: W3, diagonal (n,) or matrix (..., k, n); None is zero.
        secondary_weight: W4, diagonal (m2,) or matrix (..., k, m2); None is zero.
        active_constraint: C, shape (..., r, n); admissible rates are its null space, eq. (17).
        self_motion: Q, task motion with every actuator locked, shape (..., m, k), columns of unit
            size.
        major_metric: M, diagonal (m1,) or matrix (..., k, m1); None is the identity. It affects the
            torques where self-motion does not admit the major force.
        tie_metric: T, diagonal (n,) or matrix (..., k, n); None is zero. It affects the torques
            where the weights do not determine them.
        scale: Size of J that ranks are decided against, shape (...); None is the norm of J.
        rank_tolerance: Singular values below this fraction of the scale count as zero. This
            includes the stacked weights: at 1e-10, no goal can be weighted 1e10 times another.
        torque_limits: Lower and upper limits of the torques, each (n,) or one number, also infinite
            ((0, inf) is an actuator that only pushes); they have priority over all levels.
        torque_rows: (R, lower, upper) with R (r, n): lower <= R torques <= upper, with the same
            priority.
        force_rows: (R, lower, upper) with R (r, m): lower <= R f <= upper of the task force f, such
            as the sides of a friction cone.
        when_limited: Treatment of a major force beyond the limits: "least_squares", the least error
            |M (f_m - f_md)|, or "scaled", the largest force in the same direction.
    """
    problem = checked(
        J,
        major,
        secondary,
        weight_name="torque_weight",
        weight=torque_weight,
        secondary_weight=secondary_weight,
        active_constraint=active_constraint,
        self_motion=self_motion,
        major_metric=major_metric,
        tie_metric=tie_metric,
        scale=scale,
        rank_tolerance=rank_tolerance,
    )
    return _solved(problem, ForceLimits(torque_limits, torque_rows, force_rows, when_limited), None)


def force_mapping_of(
    mechanism: "Kinematics",
    major: Sequence[int] | ArrayLike,
    secondary: Sequence[int] | ArrayLike | None,
    weights: tuple[ArrayLike | None, ArrayLike | None],
    metrics: tuple[ArrayLike | None, ArrayLike | None],
    bounds: ForceLimits,
) -> ForceMapping:
    """Return the force mapping of a mechanism; see :meth:`Kinematics.force_mapping`.

    `weights` are those of torques and secondary force, `metrics` of major force and ties.
    """
    stated = checked(
        mechanism.J,
        major,
        secondary,
        weight_name="torque_weight",
        weight=weights[0],
        secondary_weight=weights[1],
        major_metric=metrics[0],
        tie_metric=metrics[1],
    )
    reduced = mechanism._reduced
    measure, rows = reduced.measure(stated.S_m), reduced.task_units
    secondary_units, rates = units_of(stated.S_s, rows), reduced.rate_units
    C, common = reduced.constraint, reduced.common_unit
    internal = (mechanism.active_constraint / rates) @ C.T
    units = ForceUnits(measure, secondary_units, rows, rates, internal)
    J, scale = reduced.truncated_jacobian(stated.S_m, stated.S_s)
    problem = stated._replace(
        J=J * common,  # torques of J and of C are added
        S_m=stated.S_m * rows / measure.major[:, None],
        S_s=stated.S_s * rows / secondary_units[:, None],
        weight=stated.weight / rates,
        secondary_weight=stated.secondary_weight / secondary_units,
        active_constraint=C,
        self_motion=reduced.self_motion,
        major_metric=None if stated.major_metric is None else stated.major_metric / measure.major,
        tie_metric=stated.tie_metric / rates,
        scale=np.asarray(scale * common),
    )
    mapping = _solved(problem, bounds, units)
    return replace(
        mapping,
        gap=np.minimum(mapping.gap, reduced.major(stated.S_m, stated.S_s).gap),
        closure_condition=mechanism.closure_condition,
    )


def _solved(problem: Problem, bounds: ForceLimits, units: ForceUnits | None) -> ForceMapping:
    """Return the mapping of checked arguments, which are in natural units if `units` is given."""
    _refuse_overlap(problem.S_m, problem.S_s, problem.tolerance)
    n, m1, m2 = problem.J.shape[-1], len(problem.S_m), len(problem.S_s)
    forces = forces_of(problem)
    levels = force_levels(problem, forces)
    X, decisions = lexicographic(levels, problem.tolerance)
    X, major_rank = on_axes(X, problem.lead), decisions[1].rank
    # Response to the major force with the least secondary force that self-motion requires.
    alone, _ = lexicographic([*levels[:2], levels[-1]], problem.tolerance)
    limited = _limiting(problem, forces, bounds, units)
    box = None if bounds.torques is None else limits("torque_limits", bounds.torques, n)
    reaction, work_rank = _reaction(problem, forces, alone[..., :m1])
    torques, (to_f_m, to_f_s, to_eta) = forces.torques @ X, np.split(X, [m1, m1 + m2], axis=-2)
    if units is not None:
        torques = torques * units.inputs / units.torques[:, None]
        to_f_m = to_f_m * units.inputs / units.measure.major[:, None]
        to_f_s = to_f_s * units.inputs / units.secondary[:, None]
        to_eta = units.internal @ to_eta * units.inputs
        reaction = _spanned(reaction, 1.0 / units.task)
    conditions = {
        Status.LEAST_SQUARES: lambda: np.any(major_rank < m1),
        Status.UNSEEN: lambda: np.any(work_rank < m1),
    }
    return ForceMapping(
        _torque_gains=tuple(np.split(torques, [m1, m1 + n], axis=-1)),
        _secondary_gains=tuple(np.split(to_f_s, [m1, m1 + n], axis=-1)),
        _internal_gains=tuple(np.split(to_eta, [m1, m1 + n], axis=-1)),
        achieved=to_f_m[..., :m1],
        reaction=on_axes(reaction, problem.lead),
        rank=np.broadcast_to(major_rank, problem.lead),
        gap=np.broadcast_to(smallest_gap(decisions), problem.lead),
        status=status_of(conditions, Status.EXACT),
        _problem=problem,
        _limiting=limited,
        _torque_limits=box,
        _units=units,
    )


def _limiting(
    problem: Problem, forces: Forces, bounds: ForceLimits, units: ForceUnits | None
) -> Limiting | None:
    """Convert limits of torques and forces to limits of the unknowns [f_m; f_s; eta]."""
    m, n = problem.J.shape[-2:]
    rows_of_torques, rows_of_forces = {"torque_rows": bounds.torque_rows}, bounds.force_rows
    on_torques = limiting(n, "torque_limits", bounds.torques, rows_of_torques, bounds.when)
    on_forces = limiting(m, "", None, {"force_rows": rows_of_forces}, bounds.when)
    if on_torques is None and on_forces is None:
        return None
    if units is not None:
        on_torques = on_torques and on_torques.natural(1.0 / units.torques)
        on_forces = on_forces and on_forces.natural(1.0 / units.task)
    box = limits("torque_limits", None, n) if on_torques is None else on_torques.box
    rows: list[Rows] = []
    for part, of_unknowns in ((on_torques, forces.torques), (on_forces, forces.task)):
        if part is not None:
            rows += [Rows(block.G @ of_unknowns, block.limits) for block in part.rows]
    return _of_torques(forces, box, rows, bounds.when)


def _of_torques(
    forces: Forces,
    box: Limits,
    rows: Sequence[Rows] = (),
    when_limited: WhenLimited = "least_squares",
) -> Limiting:
    """Return limits whose first rows are the torques, with unlimited unknowns."""
    unknowns = limits("", None, forces.torques.shape[-1])
    return Limiting(unknowns, (Rows(forces.torques, box), *rows), when_limited)


def _refuse_overlap(S_m: Array, S_s: Array, tolerance: float) -> None:
    """Raise if a secondary force could cancel the major force."""
    ranks = [ranked_svd(S, frobenius(S), tolerance).rank for S in (S_m, S_s, stack(S_m, S_s))]
    if ranks[2] < ranks[0] + ranks[1]:
        raise ValueError("secondary must exclude the major directions, got some of them")


def _reaction(problem: Problem, forces: Forces, gain: Array) -> tuple[Array, Indices]:
    """Return the projector on task forces without work, and the rank of the work of gain @ f_m."""
    Q, tolerance = problem.self_motion, problem.tolerance
    driven = transposed(problem.admissible_jacobian)
    motion = stack(driven, transposed(Q) * problem.scale[..., None, None])
    scale = problem.scale * basis_scale(Q)
    work = ranked_svd(motion @ forces.task @ gain, forces.task_scale * scale, tolerance)
    return ranked_svd(motion, scale, tolerance).null_projector(), work.rank


def _spanned(projector: Array, factors: Array) -> Array:
    """Return the projector on the range of one, with the rows of its vectors scaled."""
    U, sigma, _ = np.linalg.svd(projector)
    basis = respanned(U[:, sigma > 0.5], factors)
    return basis @ basis.T


def _respond(
    gains: Gains, f_major: ArrayLike, torque: ArrayLike | None, secondary_force: ArrayLike | None
) -> Array:
    """Return the sum of each gain (..., i, j) times its input (..., j); None counts as zero."""
    inputs = {"f_major": f_major, "torque": torque, "secondary_force": secondary_force}
    total = np.zeros(gains[0].shape[-2])
    for gain, (name, value) in zip(gains, inputs.items(), strict=True):
        if value is not None or name == "f_major":
            total = total + apply(gain, name, value)
    return total
