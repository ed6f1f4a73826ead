"""Distances between geoms, their rates, and step lengths that keep them safe."""

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
from sim.kinematics.task import subtree_bodies
from sim.mjcf.frame import Body, located
from sim.mjcf.model import check_state, element_id, name_of

_FARTHEST_M = 100.0
"""Largest requested distance [m]: MuJoCo loses digits of a distance as this grows."""
_TOUCHING_M, _LIFT_M = 1e-9, 1e-6
"""Distance [m] of witness points below which they give no direction, and the one used then."""
_ACCURACY_M = 1e-9
"""Tolerance of allowed distances [m], for round-off in MuJoCo."""
_GEOMETRY = (
    *("body_parentid", "body_pos", "body_quat", "jnt_type", "jnt_bodyid", "jnt_pos", "jnt_axis"),
    *("qpos0", "geom_type", "geom_bodyid", "geom_size", "geom_pos", "geom_quat", "geom_dataid"),
    *("mesh_vert", "hfield_size", "hfield_data"),
)
"""Fields of a model that distances depend on."""
_PLANE, _SDF = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SDF)

GeomPairs: TypeAlias = Sequence[tuple[Sequence[str | int | Body], Sequence[str | int | Body]]]
"""Pairs of groups; a group lists geoms by name or number, or bodies with their subtrees."""


class Near(NamedTuple):
    """Pairs of geoms, p in number, that are near at one pose.

    Attributes:
        distance_m: Distance of each pair, shape (p,); negative for penetration.
        rows: Rate of each distance per qvel, shape (p, nv).
        pairs: Numbers of the geoms, shape (p, 2).
    """

    distance_m: Array
    rows: Array
    pairs: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances between geoms, for limits that avoid collisions.

    Pairs that MuJoCo never lets collide are left out: geoms of one rigid body, of a body and its
    parent unless that is fixed in the world, of bodies under an `exclude`, and those whose
    `contype` and `conaffinity` do not match. A `pair` of the model is always included.

    Distances are those of `mj_geomDistance`. Rates of separated geoms, and of penetrating spheres,
    boxes, meshes and planes, are accurate to 1e-3 of a unit velocity. For the approximate depth of
    a capsule in a box, of an ellipsoid or of a cylinder, one rate in ten is wrong by 1 % or more,
    and a few have another direction. Outside height fields one rate in a hundred is wrong; inside,
    the depth is not the distance to the surface. Pairs of height fields, or of a height field and a
    plane, are never near.

    Attributes:
        model: Any model.
        pairs: Pairs of groups, every geom of one with every geom of the other. A group is a list
            of names or numbers of geoms, or of :class:`Body`, which stands for all geoms of the
            body and its subtree. None is every pair of the model.
        margin_m: Smallest allowed distance [m].
        detection_m: Distance [m] below which a pair is near; above the margin, at most 100 m.
        gain: Fraction of the distance to the margin that a tick may use, above 0, at most 1.

    Raises:
        ModelError: A geom or body does not exist, or is a signed distance field, whose distances
            MuJoCo does not compute; or no pair can collide.
    """

    model: mujoco.MjModel
    pairs: GeomPairs | None = None
    margin_m: float = 0.005
    detection_m: float = 0.05
    gain: float = 0.5

    def __post_init__(self) -> None:
        """Check the arguments and find the pairs."""
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
            candidates = np.transpose(np.triu_indices(model.ngeom, 1))
        else:
            given: Any = pairs if isinstance(pairs, list | tuple) and len(pairs) else [None]
            if not all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in given):
                raise TypeError(
                    "pairs must be a list of pairs of lists of geoms or bodies, got "
                    f"{check.short_repr(pairs)}"
                )
            groups = [[_numbers(model, group) for group in pair] for pair in given]
            every = [np.stack(np.meshgrid(*pair), axis=-1).reshape(-1, 2) for pair in groups]
            candidates = np.unique(np.sort(np.concatenate(every), axis=1), axis=0)
        collidable = candidates[_can_collide(model, candidates)]
        if not len(collidable):
            raise ModelError(
                "pairs must name two geoms that MuJoCo lets collide, got none: see contype, "
                "conaffinity and exclude; geoms of one body, or of it and its parent, never collide"
            )
        if (fields := collidable[model.geom_type[collidable] == _SDF]).size:
            field = name_of(model.geom(fields[0]))
            raise ModelError(f"pairs must name no signed distance field, got geom {field}")
        return check.read_only(collidable)

    def at(self, data: mujoco.MjData, within_m: float = 0.0) -> Near:
        """Return the pairs nearer than `detection_m`, or than a larger `within_m`, at `data.qpos`.

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
                mujoco.mj_jac(self.model, data, jacobian, None, point, self.model.geom_bodyid[geom])
            normal = self._normal(data, pair, distance, fromto)
            np.matmul(normal, jacobians[1] - jacobians[0], out=row)
        distance_m = np.array([distance for _, distance, _ in near], dtype=float)
        pairs = self.geom_pairs[[k for k, _, _ in near]]
        return Near(check.read_only(distance_m), check.read_only(rows), check.read_only(pairs))

    def fits(self, model: mujoco.MjModel) -> bool:
        """Return whether a model has the same bodies, joints and geoms."""
        return model is self.model or all(
            np.array_equal(getattr(model, name), getattr(self.model, name)) for name in _GEOMETRY
        )

    def farthest(self, data: mujoco.MjData, qvel: Array, dt: float) -> float:
        """Return the largest displacement [m] of a geom in a step; see :meth:`safe_fraction`."""
        ends = []
        for duration_s in (dt, 0.0):
            with self._moved(data, qvel, duration_s):
                ends.append((data.geom_xpos.copy(), data.geom_xmat.copy()))
        (to, turned), (start, axes) = ends
        turns = self.model.geom_rbound * np.linalg.norm(turned - axes, axis=1)
        return float((np.linalg.norm(to - start, axis=1) + turns).max(initial=0.0))

    def safe_fraction(self, data: mujoco.MjData, qvel: ArrayLike, dt: float) -> float:
        """Return the largest fraction 1, 1/2, ..., 1/1024, 0 of a step that ends at safe distances.

        After the step no pair is more than 1 nm nearer than the margin, or than before if it was
        within the margin. (Rates do not ensure this, because they are those of the present witness
        points.) Only the end of the step is checked, so steps must be shorter than obstacles are
        thick.

        Args:
            data: State, as for :meth:`at`. Its `qpos` is changed and restored.
            qvel: Velocity of the step, shape (nv,).
            dt: Duration of the step [s].
        """
        check_state(self.model, data)
        velocity = check.array("qvel", qvel, self.model.nv)
        check.number("dt", dt, *check.SECONDS)
        return self.largest_fraction(data, lambda fraction: [(velocity, fraction * dt)])

    def largest_fraction(
        self, data: mujoco.MjData, steps: Callable[[float], Iterable[tuple[Array, float]] | None]
    ) -> float:
        """Return the largest of :data:`FRACTIONS` for which all given steps end at safe distances.

        `steps` returns, for a fraction, velocities and durations of steps from the present state,
        or None if that fraction is not allowed. The result is 0 if no fraction is safe.
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
        """Provide the state after a step with frames up to date, and restore it afterwards."""
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
        """Geoms of each pair, a plane first; sums of their radii (q,); pairs that have a plane.

        Radii are those of bounding spheres, infinite where there is none, and zero for a plane.
        """
        pairs, is_plane = self.geom_pairs, self.model.geom_type == _PLANE
        first, second = np.where(is_plane[pairs[:, 1], None], pairs[:, ::-1], pairs).T.copy()
        bound = self.model.geom_rbound
        radius = np.where(is_plane | (bound > 0.0), bound, np.inf)
        return first, second, radius[first] + radius[second], np.flatnonzero(is_plane[first])

    def _within(self, data: mujoco.MjData, distance_m: float) -> NDArray[np.intp]:
        """Return the pairs that may be nearer than this, by bounding spheres and half spaces."""
        first, second, radii_m, planes = self._spheres
        offset = data.geom_xpos.take(second, axis=0) - data.geom_xpos.take(first, axis=0)
        limit_m = radii_m + distance_m
        near = np.einsum("ij,ij->i", offset, offset) <= limit_m * limit_m
        if planes.size:
            normals = data.geom_xmat[first[planes], 2::3]
            near[planes] = np.einsum("ij,ij->i", normals, offset[planes]) <= limit_m[planes]
        return np.flatnonzero(near)

    def _measured(
        self, data: mujoco.MjData, below_m: float
    ) -> Iterator[tuple[np.intp, float, Array]]:
        """Iterate over number, distance and witness points (6,) of the pairs nearer than this."""
        for k in self._within(data, below_m):
            pair, fromto = self.geom_pairs[k], np.empty(6)
            distance = mujoco.mj_geomDistance(self.model, data, *pair, below_m, fromto)
            if distance < below_m:
                yield k, distance, fromto

    def _keeps(self, data: mujoco.MjData, allowed: Array, qvel: Array, dt: float) -> bool:
        """Return whether no pair is nearer than allowed, (q,), after a step."""
        with self._moved(data, qvel, dt):
            near = self._measured(data, self.margin_m)
            return all(distance >= allowed[k] - _ACCURACY_M for k, distance, _ in near)

    def _normal(
        self, data: mujoco.MjData, pair: NDArray[np.intp], distance: float, fromto: Array
    ) -> Array:
        """Return the unit vector (3,) along which the second geom separates from the first.

        Touching geoms have one witness point and no direction: the second is then shifted along
        the line of centres, which separates convex geoms.
        """
        if abs(distance) < _TOUCHING_M:
            place = data.geom_xpos[pair[1]]
            here, offset = place.copy(), place - data.geom_xpos[pair[0]]
            place += _LIFT_M * offset / np.linalg.norm(offset)
            fromto = np.empty(6)
            distance = mujoco.mj_geomDistance(self.model, data, *pair, _FARTHEST_M, fromto)
            place[:] = here
        normal = fromto[3:] - fromto[:3]
        return normal / np.copysign(np.linalg.norm(normal), distance)


def _numbers(model: mujoco.MjModel, group: Any) -> NDArray[np.intp]:
    """Return the numbers of the geoms of a group."""
    numbers: list[int] = []
    for item in check.members("pairs", group, str, int, np.integer, Body):
        if isinstance(item, Body):
            subtree = subtree_bodies(model, located(model, "pairs", item).body)
            numbers.extend(np.flatnonzero(np.isin(model.geom_bodyid, subtree)).tolist())
        elif isinstance(item, str):
            numbers.append(element_id(model, "geom", item))
        else:
            numbers.append(check.integer("pairs", item, model.ngeom))
    return np.array(numbers, dtype=np.intp)


def _can_collide(model: mujoco.MjModel, pairs: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return whether MuJoCo lets the geoms of each pair (p, 2) collide, shape (p,)."""
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
    """Return one number for each pair (p, 2), independent of its order."""
    first, second = np.sort(pairs.astype(np.intp), axis=1).T
    return first * base + second
