"""An obstacle beside the payload: desired secondary velocities that keep clear of it."""

import mujoco
import numpy as np

from experiments.goals.demonstration import Demonstration, Outcome, Way
from experiments.goals.off_axis import (
    JUDGED_FROM_S,
    Seeker,
    controllers,
    no_rates,
    off_axis_path,
    outcome,
)
from experiments.hexapod.compensator import Loop
from experiments.hexapod.goal import SECONDARY, Goal
from experiments.hexapod.simulation import fly
from experiments.hexapod.testbed import Bench
from sim import (
    HEXAPOD_MJCF,
    NOMINAL,
    Array,
    Failure,
    Pose,
    forward_kinematics,
    hexapod,
    load_model,
)

TARGET_URAD = (2000.0, 0.0)
"""Off the axis, so that the mirror cell below swings by 0.3 mm towards the obstacle."""
GAP_M = 0.25e-3
"""Between the obstacle and the mirror cell at the nominal pose."""
RADIUS_M = 0.02
SAFE_M = 0.1e-3
"""Clearance below which the payload is led away."""
RELAX_S = 0.2
"""In which it comes clear; slow against the pointing loops, fast against the slew."""
TOUCHED_UM = 10.0
"""A clearance of less is a collision, or as good as one."""
STRUT = 0
"""Locked at its centre, as in Table I: with all six struts the four secondary velocities are free,
and there would be nothing that a pseudo-inverse has to compromise."""
GOAL = Goal(secondary_weight=(1.0,) * 4, locked_m={STRUT: 0.0})
"""W_d; the desired secondary velocity is zero where the payload is clear."""
STRIDE = 10
"""Ticks from one pose at which the clearance is measured to the next."""
_REACH_M = 1.0  # farther than anything here is


def cluttered() -> mujoco.MjModel:
    """The hexapod with a sphere beside its mirror cell; the two collide, as hard as the closures.

    The sphere stands on the world's y axis, as high as the cell's middle.
    """
    spec = mujoco.MjSpec.from_file(str(HEXAPOD_MJCF))
    cell = spec.geom("mirror_cell")
    middle = np.array(spec.body("payload").pos) + np.array(cell.pos)
    spec.worldbody.add_geom(
        name="obstacle",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[RADIUS_M, 0, 0],
        pos=middle + np.array([0, cell.size[0] + GAP_M + RADIUS_M, 0]),
        contype=1,
        conaffinity=1,
        condim=1,
        priority=1,
        solref=[2.5e-4, 1],
        solimp=[0.9999, 0.9999, 0.001, 0.5, 2],
    )
    cell.contype = cell.conaffinity = 1
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec.compile()


class Clearance:
    """How far the payload is from the obstacle, and which way leads away, at any pose."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Take the machine of :func:`cluttered`."""
        self._model, self._data = model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        self._to_world = self._data.site("base").xmat.reshape(3, 3).copy()
        self._joint = model.jnt_qposadr[model.joint("payload").id]
        self._obstacle, self._cell = model.geom("obstacle").id, model.geom("mirror_cell").id

    def __call__(self, pose: Pose) -> tuple[float, Array]:
        """Clearance [m], negative where they overlap, and the unit vector (3,) away, base axes."""
        turn = self._to_world @ pose.rotation @ self._to_world.T
        at = self._joint
        self._data.qpos[:] = self._model.qpos0
        self._data.qpos[at : at + 3] += self._to_world @ pose.translation_m
        mujoco.mju_mat2Quat(self._data.qpos[at + 3 : at + 7], turn.ravel())
        mujoco.mj_kinematics(self._model, self._data)
        nearest = np.zeros(6)  # on the obstacle, on the cell
        distance = mujoco.mj_geomDistance(
            self._model, self._data, self._obstacle, self._cell, _REACH_M, nearest
        )
        away = nearest[3:] - self._data.geom_xpos[self._obstacle]
        return distance, self._to_world.T @ (away / np.linalg.norm(away))


def retreat(clearance: Clearance, pose: Pose) -> Array:
    """Desired secondary velocity, v_sd of eq. (24): [t_x, t_y, t_z, gamma], shape (4,), base axes.

    Down the gradient, over translations, of half the square of what is missing to the safe
    clearance, divided by the time to come clear, [m]/[s]; no roll.
    """
    distance, away = clearance(pose)
    return np.append(max(0.0, SAFE_M - distance) / RELAX_S * away, 0.0)


def run(way: Way, duration_s: float, loops: tuple[Loop, Loop]) -> Outcome:
    """One search around the target."""
    bench, obstructed = Bench(), cluttered()
    model = obstructed if way.limited else load_model()
    geometry, clearance = hexapod(model), Clearance(obstructed)
    controller = controllers(model, bench, loops, way)(GOAL)
    now = controller.mapping.at(geometry.inverse_jacobian(NOMINAL))
    # Struts that would move the payload so, were they not to point: J_s of them is v_sd.
    struts = now.expand @ np.linalg.pinv(now.J[SECONDARY])

    def rates(displacements_m: Array, pose: Pose) -> Array:
        return struts @ retreat(clearance, pose)

    pilot = Seeker(controller, rates if way.pursues else no_rates, bench.control_period_s)
    path = off_axis_path(bench, TARGET_URAD, duration_s)
    failures = [Failure(STRUT, "locked")]
    flown, _ = fly(model, bench, pilot, desired_rad=path, failures=failures, seed=way.seed)
    poses = forward_kinematics(geometry, flown.strut_displacement_m[::STRIDE])
    clear_m = [
        clearance(Pose(*pose))[0] for pose in zip(poses.rotation, poses.translation_m, strict=True)
    ]
    return outcome(flown, 1e6 * np.repeat(clear_m, STRIDE)[: len(flown.time_s)])


DEMONSTRATION = Demonstration(
    name="obstacle",
    title="An obstacle beside the payload",
    machine="fjh",
    angles=("alpha", "beta"),
    measure="clearance_um",
    limit=TOUCHED_UM,
    keeps_below=False,
    judged_from_s=JUDGED_FROM_S,
    duration_s=10.0,
    quick_duration_s=5.0,
    settings={
        "target_urad": TARGET_URAD,
        "gap_m": GAP_M,
        "radius_m": RADIUS_M,
        "safe_m": SAFE_M,
        "relax_s": RELAX_S,
        "locked_strut": STRUT,
    },
    run=run,
)
