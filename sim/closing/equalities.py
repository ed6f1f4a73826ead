"""Rows of the active equalities, taken where the loops are closed, and how far they are open."""

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
"""Rows of an equality; others have one."""
_TORQUE_SCALE = 10
"""Where `eq_data` of a weld has its torquescale."""
_WITHOUT_CLOSURES = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY) | int(
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
)


def check_closures(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    frames: Iterable[Located] = (),
    among: Iterable[int] | None = None,
) -> tuple[str, ...]:
    """Refuse active equalities that are no closures of what actuators move and closures tie.

    `frames` belong to the mechanism besides; actuators are `among` these numbers, None is all.
    Returns a sentence for each equality that is left out; see :func:`left_out`.

    Raises:
        ModelError: As described; or the model's flags switch equalities off that are active.
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
    """A sentence for each active equality of a flex beside a mechanism that moves these frames.

    Raises:
        ModelError: One of them ties the mechanism to a flex.
    """
    if not (of_flexes := _of_flexes(model, data)):
        return ()
    part = task_part(model, frames, np.flatnonzero(data.eq_active).tolist()).bodies
    names = {k: equality_name(model, k) for k in of_flexes}
    for k, name in names.items():
        if equality_bodies(model, k) & part:
            raise ModelError(
                f"{name} ties a flex to the mechanism, and only connect, weld, joint and tendon "
                'are closures: state active="false" for it in the file, or set its '
                "model.eq_active0 and data.eq_active to 0"
            )
    suffix = "holds a flex beside the mechanism and is left out"
    return tuple(f"{name} {suffix}" for name in names.values())


def _of_flexes(model: mujoco.MjModel, data: mujoco.MjData) -> list[int]:
    """Active equalities of a flex."""
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
    """The active equality constraints: what of their rows no pose changes.

    Attributes:
        equality: To which equality each row belongs, shape (c,).
        units: What makes of MuJoCo's residuals meters and radians, shape (c,).
        points: Which rows keep two points together: three of each connect and weld, shape (3k,).
        carried: How many of the two bodies each velocity carries, in each of these, (3k, nv).
        places: Which of MuJoCo's rows of equalities these are; None is all. Others are of a flex.
    """

    equality: NDArray[np.intp]
    units: Array
    points: NDArray[np.intp]
    carriers: Array
    places: NDArray[np.intp] | None

    def rows(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Rows of the closures, shape (c, nv); see :meth:`write_rows`."""
        self.write_rows(model, data, rows := np.empty((len(self.units), model.nv)))
        return rows

    def write_rows(self, model: mujoco.MjModel, data: mujoco.MjData, out: Array) -> None:
        """Overwrite an array (c, nv) by the closures' rows, from what MuJoCo last computed.

        MuJoCo takes the rows of a connect or weld with each body's own anchor. While these are D
        apart, a joint that carries both bodies moves them apart by omega x D, although it opens
        nothing, and redundant rows become constraints. Here both bodies move as at the anchors'
        midpoint.
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
        """Number, kind and rows of each equality."""
        return _parts(model, self.equality)

    def frames(self, model: mujoco.MjModel) -> tuple[Located, ...]:
        """What connects and welds keep together."""
        frames = list[Located]()
        for k, kind, _ in self.parts(model):
            if kind in _ROWS:
                is_site = model.eq_objtype[k] == _SITE
                ends = zip(_ends(model, k), _bodies(model, k), strict=True)
                frames += [Located(end, body, is_site) for end, body in ends]
        return tuple(frames)

    def turns(self, model: mujoco.MjModel) -> NDArray[np.bool_]:
        """Whether each row's gap is an angle, shape (c,); otherwise it is a length."""
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
        """MuJoCo's residuals, those of the closures first."""
        return data.efc_pos if self.places is None else data.efc_pos[self.places]

    def gaps(self, data: mujoco.MjData) -> Array:
        """How far each row is open, shape (c,), from what MuJoCo last computed.

        [m] or [rad]; of a weld's turn the rotation vector.
        """
        return self._open(data)[: len(self.units)] * self.units

    def largest_gap(self, data: mujoco.MjData) -> float:
        """The largest gap, [m] or [rad]; 0 without closures.

        Raises:
            ModelError: An equality is not finite.
        """
        if not self.units.size:
            return 0.0
        gaps, units = pointer(self._open(data)), pointer(self.units)
        largest = lib.largest(gaps, units, len(self.units))
        if not isfinite(largest):
            raise ModelError("an equality of the model is not finite")
        return largest

    def check_closed(self, model: mujoco.MjModel, data: mujoco.MjData, tolerance: float) -> float:
        """The largest gap, [m] or [rad], where it is at most the tolerance.

        Raises:
            ClosureError: It is larger.
            ModelError: An equality is not finite.
        """
        if (gap := self.largest_gap(data)) > tolerance:
            name = equality_name(model, self.worst(data))
            raise ClosureError(name, gap, "call sim.assemble(model, data)")
        return gap

    def worst(self, data: mujoco.MjData) -> int:
        """The equality with the largest gap; -1 without closures."""
        gaps = np.abs(self.gaps(data))
        return int(self.equality[greatest(gaps)]) if gaps.size else -1


def active_closures(model: mujoco.MjModel, data: mujoco.MjData) -> Closures:
    """The active equality constraints, from what MuJoCo last computed.

    Raises:
        ModelError: The model's flags switch equalities off that are active.
    """
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
    """Number, kind and rows of each equality, one after the other."""
    parts, start = [], 0
    for k in dict.fromkeys(equality.tolist()):
        kind = int(model.eq_type[k])
        parts.append((k, kind, slice(start, start := start + _ROWS.get(kind, 1))))
    return parts


def closure_rows(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """:meth:`Closures.rows` of the active equality constraints, shape (c, nv)."""
    return active_closures(model, data).rows(model, data)


def equality_name(model: mujoco.MjModel, equality: int) -> str:
    """What a reader calls an equality: by its name, or by the bodies or joints it ties."""
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
    """MuJoCo's own of these constraints, which may be a view; equalities come first."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J[: data.nefc * model.nv].reshape(-1, model.nv)[which]
    filled, first = data.efc_J_rownnz[which], data.efc_J_rowadr[which]
    mujoco.mju_sparse2dense(
        rows := np.zeros((len(filled), model.nv)), data.efc_J, filled, first, data.efc_J_colind
    )
    return rows


def _bodies(model: mujoco.MjModel, equality: int) -> list[int]:
    """The two bodies of a connect or weld, which may be given by sites."""
    ends = _ends(model, equality)
    return model.site_bodyid[ends].tolist() if model.eq_objtype[equality] == _SITE else ends


def _ends(model: mujoco.MjModel, equality: int) -> list[int]:
    return [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]


def _moving_velocities(model: mujoco.MjModel, body: int) -> Array:
    """Which velocities carry a body, one for those and zero for others, shape (nv,)."""
    chain = np.zeros(model.nv)
    while body:
        first = model.body_dofadr[body]
        chain[first : first + model.body_dofnum[body]] = 1.0
        body = int(model.body_parentid[body])
    return chain
