"""Which pairs of geoms are to be kept apart, and which of them may be near at a pose."""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.frame import Body, located
from sim.mjcf.model import element_id

GeomPairs: TypeAlias = Sequence[tuple[Sequence[str | int | Body], Sequence[str | int | Body]]]
"""Pairs of groups; a group lists geoms by name or number, or bodies with all that they carry."""

_PLANE, _SDF = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SDF)


def geom_pairs(model: mujoco.MjModel, pairs: GeomPairs | None) -> NDArray[np.intp]:
    """Geoms of every pair that can collide, shape (p, 2), ascending, each pair once.

    Args:
        model: Any model.
        pairs: As of :class:`sim.Distances`.

    Raises:
        ModelError: A geom or body that does not exist; no pair that can collide; or a geom that is
            a signed distance field, whose distances MuJoCo does not compute.
        ValueError, TypeError: `pairs` is no list of pairs of lists of these.
    """
    check.instance("model", model, mujoco.MjModel)
    if pairs is None:
        named = np.transpose(np.triu_indices(model.ngeom, 1))
    else:
        groups = [[_numbers(model, group) for group in pair] for pair in _listed(pairs)]
        every = [np.stack(np.meshgrid(*pair), axis=-1).reshape(-1, 2) for pair in groups]
        named = np.unique(np.sort(np.concatenate(every), axis=1), axis=0)
    found = named[can_collide(model, named)]
    if not len(found):
        raise ModelError(
            "pairs must name two geoms that MuJoCo lets collide, got none: see contype, conaffinity"
            " and exclude; those of one rigid body, or of a body and its parent, do not"
        )
    if (fields := found[model.geom_type[found] == _SDF]).size:
        raise ModelError(f"pairs must name no signed distance field, got geom {fields[0]}")
    return check.read_only(found)


def _listed(pairs: Any) -> list[Any]:
    """The pairs, if they are a list of two lists each."""
    is_list = isinstance(pairs, list | tuple) and len(pairs) > 0
    if not is_list or not all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in pairs):
        raise TypeError(
            f"pairs must be a list of pairs of lists of geoms or bodies, got {check.shown(pairs)}"
        )
    return list(pairs)


def _numbers(model: mujoco.MjModel, group: Any) -> NDArray[np.intp]:
    """Numbers of the geoms of a group."""
    numbers: list[int] = []
    for each in check.members("pairs", group, str, int, np.integer, Body):
        if isinstance(each, Body):
            moved = _moved_with(model, located(model, "pairs", each).body)
            numbers.extend(np.flatnonzero(np.isin(model.geom_bodyid, moved)).tolist())
        elif isinstance(each, str):
            numbers.append(element_id(model, "geom", each))
        else:
            numbers.append(check.index("pairs", each, model.ngeom))
    return np.array(numbers, dtype=np.intp)


def _moved_with(model: mujoco.MjModel, body: int) -> list[int]:
    """The body and all that hang from it."""
    moved = [body]
    for k in range(body + 1, model.nbody):  # parents come before their children
        if model.body_parentid[k] in moved:
            moved.append(k)
    return moved


def can_collide(model: mujoco.MjModel, pairs: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether MuJoCo lets the geoms of each pair (p, 2) collide, shape (p,).

    Not geoms of one rigid body; not those of a body and its parent, unless that is the world; not
    those whose `contype` and `conaffinity` have nothing in common, nor those of an `exclude`. The
    last three do not hold for a pair that the model lists itself.
    """
    bodies = model.geom_bodyid[pairs]
    rigid = model.body_weldid[bodies]  # bodies that move as one have the number of the first
    above = model.body_weldid[model.body_parentid[rigid]]
    parents = (rigid == above[:, ::-1]).any(axis=1) & rigid.all(axis=1)
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        parents[:] = False
    touches = (model.geom_contype[pairs] & model.geom_conaffinity[pairs][:, ::-1]).any(axis=1)
    excluded = np.isin(_keys(bodies, 1 << 16), model.exclude_signature)
    of_model = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    listed = np.isin(_keys(pairs, model.ngeom), _keys(of_model, model.ngeom))
    return (rigid[:, 0] != rigid[:, 1]) & (listed | (touches & ~parents & ~excluded))


def _keys(pairs: NDArray[Any], base: int) -> NDArray[np.intp]:
    """One number for each pair (p, 2), whatever its order."""
    first, second = np.sort(pairs.astype(np.intp), axis=1).T
    return first * base + second


class Bounds(NamedTuple):
    """Bounding spheres of the geoms of p pairs; of a plane its own half space.

    Attributes:
        first: A geom of each pair, shape (p,): the plane, if one is.
        second: The other one.
        reach_m: Sum of the radii, shape (p,); infinite where a geom has no bounding sphere.
        planes: Which pairs have a plane.
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    reach_m: Array
    planes: NDArray[np.intp]

    @classmethod
    def of(cls, model: mujoco.MjModel, pairs: NDArray[np.intp]) -> "Bounds":
        """Those of pairs of geoms (p, 2)."""
        is_plane = model.geom_type == _PLANE
        first, second = np.where(is_plane[pairs[:, 1], None], pairs[:, ::-1], pairs).T.copy()
        radius = np.where(is_plane | (model.geom_rbound > 0.0), model.geom_rbound, np.inf)
        return cls(first, second, radius[first] + radius[second], np.flatnonzero(is_plane[first]))

    def within(self, data: mujoco.MjData, distance_m: float) -> NDArray[np.intp]:
        """Numbers of the pairs that may be nearer than this; the others are not."""
        apart = data.geom_xpos.take(self.second, axis=0) - data.geom_xpos.take(self.first, axis=0)
        room = self.reach_m + distance_m
        near = np.einsum("ij,ij->i", apart, apart) <= room * room
        if self.planes.size:
            normals = data.geom_xmat[self.first[self.planes], 2::3]
            height = np.einsum("ij,ij->i", normals, apart[self.planes])
            near[self.planes] = height <= room[self.planes]
        return np.flatnonzero(near)
