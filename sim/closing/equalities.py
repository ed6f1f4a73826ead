"""Rows and gaps of the active equalities that close loops."""

from collections.abc import Iterable
from math import isfinite
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from argument_checks.ties import greatest
from kernels import lib, pointer
from sim.array import Array
from sim.errors import ClosureError, ModelError
from sim.mjcf.drive import is_turn
from sim.mjcf.frame import Located
from sim.mjcf.model import name_of, with_sleepers
from sim.mjcf.part import equality_bodies, moved_bodies, task_part

_EQ = mujoco.mjtEq
_CONNECT, _WELD, _JOINT, _TENDON = (
    int(kind) for kind in (_EQ.mjEQ_CONNECT, _EQ.mjEQ_WELD, _EQ.mjEQ_JOINT, _EQ.mjEQ_TENDON)
)
_KINDS = {_CONNECT: "connect", _WELD: "weld", _JOINT: "joint", _TENDON: "tendon"}
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_ROWS = {_CONNECT: 3, _WELD: 6}
"""Number of rows of an equality; other kinds have one."""
_TORQUE_SCALE = 10
"""Index of the torquescale in a weld's `eq_data`."""
_DISABLE = mujoco.mjtDisableBit
_WITHOUT_CLOSURES = int(_DISABLE.mjDSBL_EQUALITY) | int(_DISABLE.mjDSBL_CONSTRAINT)


def check_closures(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    frames: Iterable[Located] = (),
    among: Iterable[int] | None = None,
) -> tuple[str, ...]:
    """Check that no active equality couples the mechanism to a flex.

    The mechanism has the bodies of `frames`, of closures, and of the actuators `among` (None is
    all). Returns a sentence for each equality that is left out; see :func:`left_out`.

    Raises:
        ModelError: As for :func:`left_out`; or the model's flags disable active equalities.
    """
    _check_flags(model, data)
    if not _of_flexes(model, data):  # the common case
        return ()
    bodies = [moved_bodies(model, k) for k in (range(model.nactuator) if among is None else among)]
    closures = data.eq_active.astype(bool) & np.isin(model.eq_type, list(_KINDS))
    bodies += [equality_bodies(model, k) for k in np.flatnonzero(closures).tolist()]
    moved = (Located(body, body, is_site=False) for body in frozenset[int]().union(*bodies))
    return left_out(model, data, [*frames, *moved])


def left_out(
    model: mujoco.MjModel, data: mujoco.MjData, frames: Iterable[Located]
) -> tuple[str, ...]:
    """Return a sentence for each active equality of a flex outside the mechanism of some frames.

    Raises:
        ModelError: An equality couples the mechanism to a flex.
    """
    if not (of_flexes := _of_flexes(model, data)):
        return ()
    part = task_part(model, frames, np.flatnonzero(data.eq_active).tolist()).bodies
    names = {k: equality_name(model, k) for k in of_flexes}
    for k, name in names.items():
        if equality_bodies(model, k) & part:
            raise ModelError(
                f"{name} couples a flex to the mechanism, and only connect, weld, joint and tendon "
                'are closures: state active="false" for it in the file, or set its '
                "model.eq_active0 and data.eq_active to 0"
            )
    suffix = "acts on a flex outside the mechanism and is left out"
    return tuple(f"{name} {suffix}" for name in names.values())


def _of_flexes(model: mujoco.MjModel, data: mujoco.MjData) -> list[int]:
    """Return the active equalities of flexes."""
    if not model.nflex:
        return []
    active = data.eq_active.astype(bool)
    return np.flatnonzero(active & ~np.isin(model.eq_type, list(_KINDS))).tolist()


def _check_flags(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    if data.eq_active.any() and model.opt.disableflags & _WITHOUT_CLOSURES:
        raise ModelError(
            "equalities are active, and the model's flags disable them: clear these flags, or "
            "data.eq_active"
        )


class Closures(NamedTuple):
    """Pose-independent data of the rows of the active equality constraints.

    Attributes:
        equality: Number of the equality of each row, shape (c,).
        units: Factors that convert MuJoCo's residuals to metres and radians, shape (c,).
        points: Rows that keep two points together: three of each connect and weld, shape (3k,).
        carriers: Number of the two bodies that each velocity moves, for each of these, (3k, nv).
        places: Indices of these rows among MuJoCo's equality rows, without those of flexes; None is
            all.
    """

    equality: NDArray[np.intp]
    units: Array
    points: NDArray[np.intp]
    carriers: Array
    places: NDArray[np.intp] | None

    def rows(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the rows of the closures, shape (c, nv); see :meth:`write_rows`."""
        self.write_rows(model, data, rows := np.empty((len(self.units), model.nv)))
        return rows

    def write_rows(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Write the closures' rows to an array (c, nv), from MuJoCo's last computation.

        MuJoCo computes the rows of a connect or weld at each body's own anchor. If these differ by
        D, a joint that moves both bodies adds omega x D to the rows, although it opens nothing, and
        redundant rows become constraints. Here both bodies are taken at the anchors' midpoint.
        """
        if not self.units.size:
            return
        which = slice(data.ne) if self.places is None else self.places
        out[:] = constraint_rows(model, data, which)
        if self.points.size:
            # The first three columns of cdof are a joint's axis, if it turns its body.
            gaps, axes, rows = pointer(self._open(data)), pointer(data.cdof), pointer(self.points)
            counts = model.nv, rows, len(self.points)
            lib.at_midpoints(gaps, axes, *counts, pointer(self.carriers), pointer(out))

    def parts(self, model: mujoco.MjModel) -> list[tuple[int, int, slice]]:
        """Return number, kind and rows of each equality."""
        return _parts(model, self.equality)

    def frames(self, model: mujoco.MjModel) -> tuple[Located, ...]:
        """Return the frames that connects and welds keep together."""
        frames = list[Located]()
        for k, kind, _ in self.parts(model):
            if kind in _ROWS:
                is_site = model.eq_objtype[k] == _SITE
                ends = zip(_ends(model, k), _bodies(model, k), strict=True)
                frames += [Located(end, body, is_site) for end, body in ends]
        return tuple(frames)

    def turns(self, model: mujoco.MjModel) -> NDArray[np.bool_]:
        """Return whether each row's gap is an angle, shape (c,); otherwise it is a length."""
        turns = np.zeros(len(self.units), dtype=bool)
        for k, kind, rows in self.parts(model):
            first = int(model.eq_obj1id[k])
            if kind == _WELD:
                turns[rows.start + 3 : rows.stop] = True
            elif kind == _JOINT:
                turns[rows] = is_turn(model, first, None)
            elif kind == _TENDON:
                turns[rows] = is_turn(model, None, first)
        return turns

    def _open(self, data: mujoco.MjData) -> Array:
        """Return MuJoCo's residuals; the first ones are those of the closures."""
        return data.efc_pos if self.places is None else data.efc_pos[self.places]

    def gaps(self, data: mujoco.MjData) -> Array:
        """Return the gap of each row, (c,), [m] or [rad], from MuJoCo's last computation.

        For the rotation of a weld it is the rotation vector.
        """
        return self._open(data)[: len(self.units)] * self.units

    def largest_gap(self, data: mujoco.MjData) -> float:
        """Return the largest gap, [m] or [rad], 0 without closures; raise if one is not finite."""
        if not self.units.size:
            return 0.0
        gaps, units = pointer(self._open(data)), pointer(self.units)
        largest = lib.largest(gaps, units, len(self.units))
        if not isfinite(largest):
            raise ModelError("an equality of the model must be finite, got NaN or infinity")
        return largest

    def check_closed(self, model: mujoco.MjModel, data: mujoco.MjData, tolerance: float) -> float:
        """Return the largest gap, [m] or [rad], if it is within the tolerance.

        A larger gap raises a ClosureError, one that is not finite a ModelError.
        """
        if (gap := self.largest_gap(data)) > tolerance:
            unit, name = self.described(model, self.worst(data))
            raise ClosureError(name, gap, unit, "call sim.assemble(model, data)")
        return gap

    def worst(self, data: mujoco.MjData) -> int:
        """Return the row with the largest gap; -1 without closures."""
        gaps = np.abs(self.gaps(data))
        return greatest(gaps) if gaps.size else -1

    def described(self, model: mujoco.MjModel, row: int) -> tuple[str, str]:
        """Return the unit of a row's gap and a description of its equality."""
        unit = "rad" if self.turns(model)[row] else "m"
        return unit, equality_name(model, int(self.equality[row]))


def active_closures(model: mujoco.MjModel, data: mujoco.MjData) -> Closures:
    """Return the active closures; raise a ModelError if flags disable active equalities."""
    _check_flags(model, data)
    with_sleepers(model, data, mujoco.mj_tendon, mujoco.mj_makeConstraint)
    equality, places = data.efc_id[: data.ne].astype(np.intp), None
    if of_flexes := _of_flexes(model, data):
        places = np.flatnonzero(~np.isin(equality, of_flexes))
        equality = equality[places]
    units, points, carriers = np.ones(len(equality)), [], [np.zeros((0, model.nv))]
    for k, kind, rows in _parts(model, equality):
        if kind == _WELD:  # the last three rows are sines of half the angles, scaled
            scale = model.eq_data[k, _TORQUE_SCALE]
            units[rows.start + 3 : rows.stop] = 2.0 / scale if scale else 0.0
        if kind in _ROWS:
            points += range(rows.start, rows.start + 3)
            carriers += [sum(_moving_velocities(model, body) for body in _bodies(model, k))] * 3
    return Closures(equality, units, np.array(points, dtype=np.intp), np.vstack(carriers), places)


def _parts(model: mujoco.MjModel, equality: NDArray[np.intp]) -> list[tuple[int, int, slice]]:
    """Return number, kind and consecutive rows of each equality."""
    parts, start = [], 0
    for k in dict.fromkeys(equality.tolist()):
        kind = int(model.eq_type[k])
        parts.append((k, kind, slice(start, start := start + _ROWS.get(kind, 1))))
    return parts


def closure_rows(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the rows of the active closures, shape (c, nv); see :meth:`Closures.rows`."""
    return active_closures(model, data).rows(model, data)


def equality_name(model: mujoco.MjModel, equality: int) -> str:
    """Return a description of an equality by its name, or by the elements it couples."""
    if name := model.equality(equality).name:
        return f'equality "{name}"'
    kind = int(model.eq_type[equality])
    if kind not in _KINDS:
        return f"equality {equality} (flex)"
    of = {_JOINT: model.joint, _TENDON: model.tendon}.get(kind, model.body)
    ends = _bodies(model, equality) if kind in _ROWS else _ends(model, equality)
    tied = " and ".join(f'"{name_of(of(end))}"' for end in ends if end >= 0)
    return f"equality {equality} ({_KINDS[kind]} of {tied})"


def constraint_rows(
    model: mujoco.MjModel, data: mujoco.MjData, which: slice | NDArray[np.intp] = slice(None)
) -> Array:
    """Return MuJoCo's rows of some constraints, possibly a view; equalities come first."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J[: data.nefc * model.nv].reshape(-1, model.nv)[which]
    filled, first = data.efc_J_rownnz[which], data.efc_J_rowadr[which]
    rows = np.zeros((len(filled), model.nv))
    mujoco.mju_sparse2dense(rows, data.efc_J, filled, first, data.efc_J_colind)
    return rows


def _bodies(model: mujoco.MjModel, equality: int) -> list[int]:
    """Return the two bodies of a connect or weld, which may be given by sites."""
    ends = _ends(model, equality)
    return model.site_bodyid[ends].tolist() if model.eq_objtype[equality] == _SITE else ends


def _ends(model: mujoco.MjModel, equality: int) -> list[int]:
    return [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]


def _moving_velocities(model: mujoco.MjModel, body: int) -> Array:
    """Return an array (nv,) with one for velocities that move a body and zero for others."""
    chain = np.zeros(model.nv)
    while body:
        first = model.body_dofadr[body]
        chain[first : first + model.body_dofnum[body]] = 1.0
        body = int(model.body_parentid[body])
    return chain
