"""Distances between geoms, their rates, and steps that keep them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from sim.array import Array
from sim.closing.newton import FRACTIONS
from sim.errors import ModelError
from sim.kinematics.task import carried_bodies
from sim.mjcf.frame import Body, located
from sim.mjcf.model import check_state, element_id

_FARTHEST_M = 100.0
"""MuJoCo loses digits of a distance with the largest that it is asked for."""
_TOUCHING_M, _LIFT_M = 1e-9, 1e-6
"""Witness points nearer than the first give no direction; geoms apart by the second do."""
_ACCURACY_M = 1e-9
"""What a distance may lack of the one allowed: round-off of MuJoCo's."""
_GEOMETRY = (
    *("body_parentid", "body_pos", "body_quat", "jnt_type", "jnt_bodyid", "jnt_pos", "jnt_axis"),
    *("qpos0", "geom_type", "geom_bodyid", "geom_size", "geom_pos", "geom_quat", "geom_dataid"),
    *("mesh_vert", "hfield_size", "hfield_data"),
)
"""What distances depend on."""
_PLANE, _SDF = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SDF)

GeomPairs: TypeAlias = Sequence[tuple[Sequence[str | int | Body], Sequence[str | int | Body]]]
"""Pairs of groups; a group lists geoms by name or number, or bodies with all that they carry."""


class Near(NamedTuple):
    """The p pairs of geoms that are near at one pose.

    Attributes:
        distance_m: Shape (p,); below zero the depth of penetration.
        rows: Rate of each distance per qvel, shape (p, nv).
        pairs: Numbers of the geoms, shape (p, 2).
    """

    distance_m: Array
    rows: Array
    pairs: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances between geoms, for limits that keep them apart.

    Left out are pairs that MuJoCo never lets collide: geoms of one rigid body, of a body and its
    parent unless that is fixed in the world, of bodies under an `exclude`, and those whose
    `contype` and `conaffinity` do not match. A `pair` of the model counts always.

    `mj_geomDistance` finds the distances. Rates of geoms that are apart are right within 1e-3 of a
    unit velocity, and so are those of spheres, boxes, meshes and planes that penetrate. The depth
    of a capsule in a box, of an ellipsoid and of a cylinder is found roughly: one rate in ten is
    off by 1 % and more, a few have another direction. Height fields are right from outside but for
    one rate in a hundred; into one, depth is not the distance out of it. Pairs of height fields,
    or of one with a plane, never come near.

    Attributes:
        model: Any model.
        pairs: Pairs of groups, every geom of one against every geom of the other. A group is a
            list of names or numbers of geoms, or of :class:`Body`, which is all geoms of the
            body and of those that hang from it. None is every pair of the model.
        margin_m: Distance to be kept.
        detection_m: Distance from which on a pair is near; above the margin, at most 100 m.
        gain: Part of the way to the margin that a tick may take, in 0..1 but not 0.

    Raises:
        ModelError: A geom or body that does not exist, a signed distance field, whose distances
            MuJoCo does not compute, or no pair that can collide.
    """

    model: mujoco.MjModel
    pairs: GeomPairs | None = None
    margin_m: float = 0.005
    detection_m: float = 0.05
    gain: float = 0.5

    def __post_init__(self) -> None:
        """Check the arguments, and find the pairs."""
        check.number("margin_m", self.margin_m, 0.0)
        check.number("detection_m", self.detection_m, 0.0, _FARTHEST_M)
        if not self.margin_m < self.detection_m:
            raise ValueError(
                f"margin_m must be below detection_m, got {self.margin_m} and {self.detection_m}"
            )
        check.number("gain", self.gain, check.SMALLEST, 1.0)
        _ = self.geom_pairs

    @cached_property
    def geom_pairs(self) -> NDArray[np.intp]:
        """Numbers of the geoms of every pair that can collide, shape (q, 2), ascending."""
        model, pairs = check.instance("model", self.model, mujoco.MjModel), self.pairs
        if pairs is None:
            named = np.transpose(np.triu_indices(model.ngeom, 1))
        else:
            given: Any = pairs if isinstance(pairs, list | tuple) and len(pairs) else [None]
            if not all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in given):
                raise TypeError(
                    "pairs must be a list of pairs of lists of geoms or bodies, got "
                    f"{check.short_repr(pairs)}"
                )
            groups = [[_numbers(model, group) for group in pair] for pair in given]
            every = [np.stack(np.meshgrid(*pair), axis=-1).reshape(-1, 2) for pair in groups]
            named = np.unique(np.sort(np.concatenate(every), axis=1), axis=0)
        found = named[_can_collide(model, named)]
        if not len(found):
            raise ModelError(
                "pairs must name two geoms that MuJoCo lets collide, got none: see contype, "
                "conaffinity and exclude; those of one rigid body, or of a body and its parent, do "
                "not"
            )
        if (fields := found[model.geom_type[found] == _SDF]).size:
            raise ModelError(f"pairs must name no signed distance field, got geom {fields[0]}")
        return check.read_only(found)

    def at(self, data: mujoco.MjData, within_m: float = 0.0) -> Near:
        """The pairs nearer than `detection_m`, or `within_m` if that is more, at `data.qpos`.

        Frames in `data` are brought up to date.
        """
        check_state(self.model, data)
        within_m = max(self.detection_m, check.number("within_m", within_m, 0.0))
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        near = list(self._measured(data, min(within_m, _FARTHEST_M)))
        rows, jacobians = np.empty((len(near), self.model.nv)), np.empty((2, 3, self.model.nv))
        for row, (k, distance, fromto) in zip(rows, near, strict=True):
            pair = self.geom_pairs[k]
            for jacobian, geom, point in zip(jacobians, pair, fromto.reshape(2, 3), strict=True):
                body = self.model.geom_bodyid[geom]
                mujoco.mj_jac(self.model, data, jacobian, None, point, body)
            normal = self._normal(data, pair, distance, fromto)
            np.matmul(normal, jacobians[1] - jacobians[0], out=row)
        distance_m = np.array([distance for _, distance, _ in near], dtype=float)
        pairs = self.geom_pairs[[k for k, _, _ in near]]
        return Near(check.read_only(distance_m), check.read_only(rows), check.read_only(pairs))

    def fits(self, model: mujoco.MjModel) -> bool:
        """Whether a model has the same bodies, joints and geoms."""
        return model is self.model or all(
            np.array_equal(getattr(model, name), getattr(self.model, name)) for name in _GEOMETRY
        )

    def farthest(self, data: mujoco.MjData, qvel: Array, dt: float) -> float:
        """How far the geom that moves most comes in a step; see :meth:`safe_fraction`."""
        ends = []
        for duration_s in (dt, 0.0):
            with self._moved(data, qvel, duration_s):
                ends.append((data.geom_xpos.copy(), data.geom_xmat.copy()))
        (to, turned), (start, axes) = ends
        turns = self.model.geom_rbound * np.linalg.norm(turned - axes, axis=1)
        return float((np.linalg.norm(to - start, axis=1) + turns).max(initial=0.0))

    def safe_fraction(self, data: mujoco.MjData, qvel: ArrayLike, dt: float) -> float:
        """The largest of 1, 1/2, 1/4, ..., 1/1024 and 0 of a step that ends at safe distances.

        After it no pair is nearer than the margin, or than it was where it was nearer before, but
        for a nanometre. Rates hold at the witness points alone: a turning box brings another
        corner near. What a step passes on its way is not seen; steps are to be shorter than what
        they could pass through.

        Args:
            data: As of :meth:`at`. Its `qpos` is moved and put back.
            qvel: Velocity of the step, shape (nv,).
            dt: Duration of the step, [s].
        """
        check_state(self.model, data)
        velocity = check.array("qvel", qvel, self.model.nv)
        check.number("dt", dt, *check.SECONDS)
        return self.largest_fraction(data, lambda fraction: [(velocity, fraction * dt)])

    def largest_fraction(
        self,
        data: mujoco.MjData,
        steps: Callable[[float], Iterable[tuple[Array, float]] | None],
    ) -> float:
        """The largest of :data:`FRACTIONS` for which all of these steps end at safe distances.

        `steps` gives for a fraction velocities and durations of steps from here, or None if that
        fraction is out of the question.
        """
        mujoco.mj_kinematics(self.model, data)
        allowed = np.full(len(self.geom_pairs), self.margin_m)
        for k, distance, _ in self._measured(data, self.margin_m):
            allowed[k] = distance
        for fraction in FRACTIONS:
            every = steps(fraction)
            if every is not None and all(self._keeps(data, allowed, *step) for step in every):
                return fraction
        return 0.0

    @contextmanager
    def _moved(self, data: mujoco.MjData, qvel: Array, dt: float) -> Iterator[None]:
        """A state after a step; frames in it are brought up to date, and put back afterwards."""
        start = data.qpos.copy()
        try:
            mujoco.mj_integratePos(self.model, data.qpos, qvel, dt)
            mujoco.mj_kinematics(self.model, data)
            yield
        finally:
            data.qpos[:] = start
            mujoco.mj_kinematics(self.model, data)

    @cached_property
    def _spheres(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, NDArray[np.intp]]:
        """Geoms of each pair, a plane first; sums of their radii (q,); which pairs have a plane.

        Radii are those of bounding spheres, infinite where there is none; of a plane, zero.
        """
        pairs, is_plane = self.geom_pairs, self.model.geom_type == _PLANE
        first, second = np.where(is_plane[pairs[:, 1], None], pairs[:, ::-1], pairs).T.copy()
        bound = self.model.geom_rbound
        radius = np.where(is_plane | (bound > 0.0), bound, np.inf)
        return first, second, radius[first] + radius[second], np.flatnonzero(is_plane[first])

    def _within(self, data: mujoco.MjData, distance_m: float) -> NDArray[np.intp]:
        """Numbers of the pairs that may be nearer than this, by their spheres or half spaces."""
        first, second, reach_m, planes = self._spheres
        apart = data.geom_xpos.take(second, axis=0) - data.geom_xpos.take(first, axis=0)
        room = reach_m + distance_m
        near = np.einsum("ij,ij->i", apart, apart) <= room * room
        if planes.size:
            normals = data.geom_xmat[first[planes], 2::3]
            near[planes] = np.einsum("ij,ij->i", normals, apart[planes]) <= room[planes]
        return np.flatnonzero(near)

    def _measured(
        self, data: mujoco.MjData, below_m: float
    ) -> Iterator[tuple[np.intp, float, Array]]:
        """Number, distance and witness points (6,) of the pairs nearer than a distance."""
        for k in self._within(data, below_m):
            pair, fromto = self.geom_pairs[k], np.empty(6)
            distance = mujoco.mj_geomDistance(self.model, data, *pair, below_m, fromto)
            if distance < below_m:
                yield k, distance, fromto

    def _keeps(self, data: mujoco.MjData, allowed: Array, qvel: Array, dt: float) -> bool:
        """Whether no pair is nearer than allowed, (q,), after a step; it stops at one that is."""
        with self._moved(data, qvel, dt):
            near = self._measured(data, self.margin_m)
            return all(distance >= allowed[k] - _ACCURACY_M for k, distance, _ in near)

    def _normal(
        self, data: mujoco.MjData, pair: NDArray[np.intp], distance: float, fromto: Array
    ) -> Array:
        """Unit vector (3,) along which the second geom moves away from the first.

        Geoms that touch have one witness point and no direction: there the second is lifted off
        along the line of centres, on which convex geoms part.
        """
        if abs(distance) < _TOUCHING_M:
            place = data.geom_xpos[pair[1]]
            here, apart = place.copy(), place - data.geom_xpos[pair[0]]
            place += _LIFT_M * apart / np.linalg.norm(apart)
            fromto = np.empty(6)
            distance = mujoco.mj_geomDistance(self.model, data, *pair, _FARTHEST_M, fromto)
            place[:] = here
        normal = fromto[3:] - fromto[:3]
        return normal / np.copysign(np.linalg.norm(normal), distance)


def _numbers(model: mujoco.MjModel, group: Any) -> NDArray[np.intp]:
    """Numbers of the geoms of a group."""
    numbers: list[int] = []
    for each in check.members("pairs", group, str, int, np.integer, Body):
        if isinstance(each, Body):
            moved = carried_bodies(model, located(model, "pairs", each).body)
            numbers.extend(np.flatnonzero(np.isin(model.geom_bodyid, moved)).tolist())
        elif isinstance(each, str):
            numbers.append(element_id(model, "geom", each))
        else:
            numbers.append(check.integer("pairs", each, model.ngeom))
    return np.array(numbers, dtype=np.intp)


def _can_collide(model: mujoco.MjModel, pairs: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether MuJoCo lets the geoms of each pair (p, 2) collide, shape (p,)."""
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
