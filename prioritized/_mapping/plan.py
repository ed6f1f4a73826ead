"""What no pose changes of the levels that a tick solves."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from argument_checks import Array, Indices
from argument_checks.ties import ACCURACY
from kernels import Struct
from prioritized._mapping.asked import Asked
from prioritized._mechanism.conditioning import well_conditioned_above
from prioritized._mechanism.elimination import Partition
from prioritized._mechanism.geometry import Geometry
from prioritized._solver.arrays import none
from prioritized._solver.rank import ROUND_OFF, largest, norm

if TYPE_CHECKING:
    from prioritized._kinematics import Kinematics

_CLEAR = ROUND_OFF / ACCURACY
"""Part of a scale above which a singular value is regular: any way then finds nine digits."""


class Plan(NamedTuple):
    """What ``tick_plan`` in ``kernels.h`` names.

    Attributes:
        order: Passive velocities that move, then the rates, (p + n,).
        idle: Passive velocities that stay at rest.
        levels: What is asked for.
        errors: Size of the errors of J_C and J_T per bound of them, and the part of J_C and of J
            up to which a singular value is in doubt.
        units: Natural units of the task rows, of those of the loops, and of the velocities.
    """

    order: Indices
    idle: Indices
    levels: "Levels"
    errors: tuple[float, float, float]
    units: tuple[Array, Array, Array]

    @classmethod
    def of(cls, asked: Asked, mechanism: "Kinematics") -> "Plan | None":
        """Of a mechanism at any pose; None where it has springs, or a level is an interval."""
        system = mechanism.system
        active, is_interval = system.joints.active, any(each[0].interval for each in asked.levels)
        if is_interval or not system.is_rigid or not len(active):
            return None
        moving, idle = _widest_last(system)
        order = np.concatenate([moving, active])
        of = system.geometry
        units = of.task_units, of.constraint_units, of.velocity_units
        return cls(order, idle, Levels.of(asked), _errors(of), units)

    def for_kernel(self, c: int, N: int) -> Struct:
        """The same for :data:`kernels.lib` and J_C (c, N)."""
        _, _, of, (error_C, error_T, doubt), (rows_T, rows_C, velocities) = self
        m, (k, n), t = of.S.shape[1], of.R.shape, of.T.shape[1]
        sizes = {
            "m": m,
            "c": c,
            "N": N,
            "t": t,
            "p": len(self.order) - n,
            "n": n,
            "k": k,
            "d": len(of.D),
        }
        return Struct(
            "tick_plan",
            **sizes,
            levels=len(of.ends),
            e=of.beside,
            idles=len(self.idle),
            order=self.order,
            idle=self.idle,
            S=of.S,
            R=of.R if of.R.any() else None,
            D=of.D,
            T=of.T,
            weight=of.weight,
            damping=of.damping if of.damping.any() else None,
            sizes=of.sizes,
            on_rates=of.on_rates,
            ends=of.ends,
            error_C=error_C,
            error_T=error_T,
            doubt=doubt,
            task_units=rows_T,
            loop_units=rows_C,
            velocity_units=velocities,
        )


class Levels(NamedTuple):
    """Rows S J + R of all levels, and a weighted norm of the rates beside the last or after it.

    Attributes:
        S: Shape (k, m).
        R: Shape (k, n).
        T: What the rows are to be, and then, where they have weights, the rates: (., t).
        ends: Of each level, (levels,).
        damping: Likewise.
        weight: Of the rates, (n,); None is |rates|.
        beside: How many rows of the last level stand beside that norm.
        D: Directions of the task in these rows, (d, m).
        sizes: 2-norm of S of each level, then of all directions of the task, (levels + 1,).
        on_rates: What may be zero of R of each level, (levels,).
    """

    S: Array
    R: Array
    T: Array
    ends: NDArray[np.int32]
    damping: Array
    weight: Array | None
    beside: int
    D: Array
    sizes: Array
    on_rates: Array

    @classmethod
    def of(cls, asked: Asked) -> "Levels":
        """As they were asked for."""
        stacked, levels, ties = asked.stacked, asked.levels, asked.ties.A
        S, R, T = stacked.split(stacked.on_task), stacked.split(stacked.on_rates), _rights(asked)
        damping, weight, wanted, D, beside = list(asked.damping), None, [], [], 0
        none_of_task, is_norm = none((len(ties), S[0].shape[1])), R[-1].any(axis=1)
        own = _diagonal(R[-1][is_norm]) if stacked.rates_last and not damping[-1] else None
        if own is not None and (own.all() or (own.any() and not len(ties))):
            weight, ties = own, ties[:0]
            square = np.where(own > 0.0, own, 1.0)[:, None] ** 2
            wanted = [R[-1][is_norm].T @ T[-1][is_norm] / square]
            of_task = [part.S for part in levels[-1] if part.S is not None and part.matrix.any()]
            D = [directions * asked.units[0] for directions in of_task]
            S[-1], R[-1], T[-1] = S[-1][~is_norm], R[-1][~is_norm], T[-1][~is_norm]
            beside = len(S[-1])
        if len(ties):
            own = None if any(each.any() for each in R) else _diagonal(ties)
            none_asked = none((len(ties), T[0].shape[1]))
            if own is not None and own.all():
                weight, wanted = own, [none((len(own), T[0].shape[1]))]
            else:
                S, R, T = [*S, none_of_task], [*R, ties], [*T, none_asked]
                damping.append(0.0)
        ends = np.cumsum([*map(len, S)]).astype(np.int32)
        directions = [*S[: len(S) - bool(beside)], *D]
        return cls(
            S=np.concatenate(S),
            R=np.concatenate(R),
            T=np.concatenate([*T, *wanted]),
            ends=ends,
            damping=np.array(damping),
            weight=weight,
            beside=beside,
            D=np.concatenate([S[0][:0], *D]),
            sizes=np.array([*map(largest, S), largest(np.concatenate(directions))]),
            on_rates=np.array([_CLEAR * norm(each) for each in R]),
        )


def _rights(asked: Asked) -> list[Array]:
    """What the weighted rows of each level are to be, per target, (., t)."""
    whole = block_diag(*(part.matrix for level in asked.levels for part in level))
    return asked.stacked.split(whole)


def _diagonal(rows: Array) -> Array | None:
    """Weights w (n,) for which |rows rates| = |w rates|; None where there are none."""
    squares = rows.T @ rows
    weight = np.sqrt(squares.diagonal())
    return None if (squares != np.diag(squares.diagonal())).any() else weight


def _widest_last(system: Partition) -> tuple[Indices, Indices]:
    """The passive velocities that move, and those that neither loops nor task know.

    The former begin with those of one loop: more zeros then stay zeros.
    """
    moving = system.joints.moving
    is_idle = ~(system.J_C[:, moving].any(axis=0) | system.geometry.J_T[:, moving].any(axis=0))
    moving, idle = moving[~is_idle], moving[is_idle]
    rows = [np.flatnonzero(column) for column in system.J_C[:, moving].T]
    widths = [int(np.ptp(each)) if len(each) else 0 for each in rows]
    return moving[np.argsort(widths, kind="stable")], idle


def _errors(geometry: Geometry) -> tuple[float, float, float]:
    """Size of the errors of J_C and J_T per bound, and where singular values are in doubt."""
    clear = max(_CLEAR, well_conditioned_above(geometry.rank_tolerance))
    if geometry.accuracy is None or geometry.is_stated:
        return 0.0, 0.0, clear
    loops, task = np.sqrt(geometry.J_C.size), np.sqrt(geometry.J_T.size)
    if not len(geometry.J_C) and 0.0 < geometry.error_bound < np.inf:
        error = geometry.elsewhere.task_error
        task = task if error is None else norm(error) / geometry.error_bound
    return float(loops), float(task), clear
