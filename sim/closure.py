"""Rows of the active equalities, taken where the loops are closed, and how far they are open."""

import mujoco
import numpy as np

from sim.array import Array
from sim.errors import ModelError
from sim.model import name_of

_EQ = mujoco.mjtEq
_CONNECT, _WELD, _JOINT, _TENDON = (
    int(kind) for kind in (_EQ.mjEQ_CONNECT, _EQ.mjEQ_WELD, _EQ.mjEQ_JOINT, _EQ.mjEQ_TENDON)
)
_KINDS = {_CONNECT: "connect", _WELD: "weld", _JOINT: "joint", _TENDON: "tendon"}
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_ROUND_OFF_M = 1e-14
_ROWS = {_CONNECT: 3, _WELD: 6}
"""Rows of an equality; others have one."""
_CROSS = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0.0]]
)
"""v @ _CROSS is the matrix of the cross product v x, row by row."""
_TORQUE_SCALE = 10
"""Where `eq_data` of a weld has its torquescale."""
_WITHOUT_CLOSURES = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY) | int(
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
)


def check_closures(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Refuse active equalities that are not closures, or that the model's flags switch off.

    Raises:
        ModelError: As described.
    """
    if data.eq_active.any() and model.opt.disableflags & _WITHOUT_CLOSURES:
        raise ModelError(
            "equalities are active, and the model's flags disable them: clear these flags, or "
            "data.eq_active"
        )
    strange = [
        k
        for k, kind in enumerate(model.eq_type.tolist())
        if kind not in _KINDS and data.eq_active[k]
    ]
    if strange:
        raise ModelError(
            f"{equality_name(model, strange[0])} holds a flex, and only connect, weld, joint and "
            "tendon are closures: set its data.eq_active to 0"
        )


def closure_rows(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Rows of the active equality constraints, shape (c, nv), from what MuJoCo last computed.

    MuJoCo takes the rows of a connect or weld with each body's own anchor. While these are D apart,
    a joint that carries both bodies moves them apart by omega x D, although it opens nothing, and
    redundant rows become constraints. Here both bodies move as at the anchors' midpoint.

    Raises:
        ModelError: A part of the mechanism sleeps; MuJoCo leaves its rows out.
    """
    if data.ntree_awake < model.ntree:
        raise ModelError("a part of the mechanism is asleep, with its closures: switch sleep off")
    rows = _equality_rows(model, data)
    points = [(k, start) for k, kind, start in _blocks(model, data) if kind in (_CONNECT, _WELD)]
    residual = data.efc_pos
    D = np.array([residual[start : start + 3] for _, start in points]).reshape(-1, 3)
    if (np.abs(D) > _ROUND_OFF_M).any():
        carried = _angular(model, data, [k for k, _ in points])
        opened = (D / 2).dot(_CROSS).reshape(-1, 3, 3) @ carried
        for (_, start), change in zip(points, opened, strict=True):
            rows[start : start + 3] += change
    return rows


def closure_gaps(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """How far each row of the closures is open, (c,), from what MuJoCo last computed.

    [m] or [rad]; of a weld's turn the rotation vector.
    """
    return data.efc_pos[: data.ne] * units_of_gaps(model, data)


def units_of_gaps(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """What makes of MuJoCo's residuals meters and radians, shape (c,)."""
    units = np.ones(data.ne)
    for k, kind, start in _blocks(model, data):
        if kind == _WELD:  # the last three rows are sines of half the angles, scaled
            scale = model.eq_data[k, _TORQUE_SCALE]
            units[start + 3 : start + 6] = 2.0 / scale if scale else 0.0
    return units


def largest_gap(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, int]:
    """The largest gap of all closures, [m] or [rad], and its equality; 0 and -1 without any.

    Raises:
        ModelError: An equality is not finite.
    """
    gaps = closure_gaps(model, data)
    if not gaps.size:
        return 0.0, -1
    if not np.isfinite(gaps).all():
        raise ModelError("an equality of the model is not finite")
    worst = np.abs(gaps).argmax()
    return abs(float(gaps[worst])), int(data.efc_id[worst])


def equality_name(model: mujoco.MjModel, equality: int) -> str:
    """What a reader calls an equality: by its name, or by the bodies or joints it ties."""
    if name := model.equality(equality).name:
        return f'equality "{name}"'
    kind = _KINDS.get(int(model.eq_type[equality]), "flex")
    ends = {
        _CONNECT: lambda k: name_of(model.body(_bodies(model, equality)[k])),
        _WELD: lambda k: name_of(model.body(_bodies(model, equality)[k])),
        _JOINT: lambda k: name_of(model.joint(_ends(model, equality)[k])),
        _TENDON: lambda k: name_of(model.tendon(_ends(model, equality)[k])),
    }
    find = ends.get(int(model.eq_type[equality]))
    if find is None:
        return f"equality {equality} ({kind})"
    tied = [find(k) for k, end in enumerate(_ends(model, equality)) if end >= 0]
    return f"equality {equality} ({kind} of " + " and ".join(f'"{end}"' for end in tied) + ")"


def _equality_rows(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """MuJoCo's own; equalities come first among its constraints."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J.reshape(data.nefc, model.nv)[: data.ne].copy()
    rows = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(
        rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
    )
    return rows[: data.ne]


def _bodies(model: mujoco.MjModel, equality: int) -> list[int]:
    """The two bodies of a connect or weld, which may be given by sites."""
    ends = _ends(model, equality)
    return model.site_bodyid[ends].tolist() if model.eq_objtype[equality] == _SITE else ends


def _ends(model: mujoco.MjModel, equality: int) -> list[int]:
    return [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]


def _blocks(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[int, int, int]]:
    """Each active equality, its kind and its first row."""
    kinds, blocks, start = model.eq_type.tolist(), [], 0
    for k in dict.fromkeys(data.efc_id[: data.ne].tolist()):
        blocks.append((k, kinds[k], start))
        start += _ROWS.get(kinds[k], 1)
    return blocks


def _angular(model: mujoco.MjModel, data: mujoco.MjData, equalities: list[int]) -> Array:
    """Angular velocities of both bodies of connects and welds, summed, per qvel, (k, 3, nv)."""
    rows = np.empty((len(equalities), 2, 3, model.nv))
    for equality, of_bodies in zip(equalities, rows, strict=True):
        for body, of_body in zip(_bodies(model, equality), of_bodies, strict=True):
            mujoco.mj_jacBody(model, data, None, of_body, body)
    return rows[:, 0] + rows[:, 1]
