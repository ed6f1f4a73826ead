"""Distances between geoms, their rates, and steps that keep them."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from sim.array import Array
from sim.kinematics.geom_pairs import Bounds, GeomPairs, geom_pairs
from sim.mjcf.model import check_state

_FARTHEST_M = 100.0
"""MuJoCo loses digits of a distance with the largest that it is asked for."""
_TOUCHING_M, _LIFT_M = 1e-9, 1e-6
"""Witness points nearer than the first give no direction; geoms apart by the second do."""
_ACCURACY_M = 1e-9
"""What a distance may lack of the one allowed: round-off of MuJoCo's."""
FRACTIONS = tuple(0.5**k for k in range(11))
"""Of a step, to be tried one after the other."""
_GEOMETRY = (
    *("body_parentid", "body_pos", "body_quat", "jnt_type", "jnt_bodyid", "jnt_pos", "jnt_axis"),
    *("qpos0", "geom_type", "geom_bodyid", "geom_size", "geom_pos", "geom_quat", "geom_dataid"),
    *("mesh_vert", "hfield_size", "hfield_data"),
)
"""What distances depend on."""


class Near(NamedTuple):
    """The p pairs of geoms that are near at one pose.

    Attributes:
        distance_m: Distance of each, shape (p,); below zero the depth of penetration.
        rows: Rate of each distance per qvel, shape (p, nv).
        pairs: Numbers of its geoms, shape (p, 2).
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
        ValueError, TypeError: An argument out of range or of another type; it is named.
    """

    model: mujoco.MjModel
    pairs: GeomPairs | None = None
    margin_m: float = 0.005
    detection_m: float = 0.05
    gain: float = 0.5

    def __post_init__(self) -> None:
        """Check the arguments, and find the pairs."""
        check.number("margin_m", self.margin_m)
        check.within("detection_m", self.detection_m, 0.0, _FARTHEST_M, " m")
        if not self.margin_m < self.detection_m:
            raise ValueError(
                f"margin_m must be below detection_m, got {self.margin_m} and {self.detection_m}"
            )
        check.within("gain", check.positive("gain", self.gain), 0.0, 1.0)
        _ = self.geom_pairs

    @cached_property
    def geom_pairs(self) -> NDArray[np.intp]:
        """Numbers of the geoms of all pairs, shape (q, 2), ascending."""
        return geom_pairs(self.model, self.pairs)

    def at(self, data: mujoco.MjData) -> Near:
        """The pairs nearer than `detection_m` at the present `data.qpos`.

        Args:
            data: State of the model; frames in it are brought up to date.

        Raises:
            ValueError, TypeError: `data` is of another model, or not finite.
        """
        return self.near(data, self.detection_m)

    def near(self, data: mujoco.MjData, within_m: float) -> Near:
        """The same of the pairs nearer than a distance, but at least `detection_m`."""
        check_state(self.model, data)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        near = self._measured(data, min(max(self.detection_m, within_m), _FARTHEST_M))
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

    def rate_limits(self, data: mujoco.MjData, dt: float) -> tuple[Array, Array]:
        """Rows and lower limits: rows @ qvel >= lower keeps the near pairs apart.

        A distance d may change by no less than -gain (d - margin) in a tick, so that it reaches
        the margin never; from below the margin it is led back by the same law.

        Args:
            data: As of :meth:`at`.
            dt: Duration of a tick, [s].

        Returns:
            Rows (p, nv) and lower limits (p,), [m/s].

        Raises:
            ValueError, TypeError: As :meth:`at`, or `dt` is no duration.
        """
        check.duration("dt", dt)
        near = self.at(data)
        return near.rows, check.read_only(-self.gain / dt * (near.distance_m - self.margin_m))

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

        Raises:
            ValueError, TypeError: As :meth:`rate_limits`, or `qvel` has another shape.
        """
        check_state(self.model, data)
        velocity = check.exactly("qvel", qvel, self.model.nv)
        check.duration("dt", dt)
        return self.largest_fraction(data, lambda fraction: [(velocity, fraction * dt)])

    def largest_fraction(
        self,
        data: mujoco.MjData,
        steps: Callable[[float], Iterable[tuple[Array, float]] | None],
    ) -> float:
        """The largest of the same fractions for which all of these steps end at safe distances.

        Args:
            data: As of :meth:`at`.
            steps: Gives for a fraction velocities and durations of steps from here, or None if that
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
    def _bounds(self) -> Bounds:
        return Bounds.of(self.model, self.geom_pairs)

    def _measured(self, data: mujoco.MjData, below_m: float) -> list[tuple[np.intp, float, Array]]:
        """Number, distance and witness points (6,) of the pairs nearer than a distance."""
        found = []
        for k in self._bounds.within(data, below_m):
            first, second = self.geom_pairs[k]
            fromto = np.empty(6)
            distance = mujoco.mj_geomDistance(self.model, data, first, second, below_m, fromto)
            if distance < below_m:
                found.append((k, distance, fromto))
        return found

    def _keeps(self, data: mujoco.MjData, allowed: Array, qvel: Array, dt: float) -> bool:
        """Whether no pair is nearer than allowed, (q,), after a step; it stops at one that is."""
        with self._moved(data, qvel, dt):
            for k in self._bounds.within(data, self.margin_m):
                pair = self.geom_pairs[k]
                distance = mujoco.mj_geomDistance(self.model, data, *pair, self.margin_m, None)
                if distance < allowed[k] - _ACCURACY_M:
                    return False
        return True

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
