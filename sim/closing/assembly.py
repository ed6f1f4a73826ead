"""Assembly: joint positions at which every loop of a model is closed."""

import copy
import warnings
from collections.abc import Iterable

import mujoco
import numpy as np

import argument_checks as check
from argument_checks.ties import greatest
from sim.array import Array
from sim.closing.equalities import check_closures
from sim.closing.hold import held_in, hold
from sim.closing.newton import CLOSED, close
from sim.closing.pin import Pin, pins_of
from sim.mjcf.dynamics import mass_of
from sim.mjcf.frame import Body
from sim.mjcf.model import check_state, name_of
from sim.mjcf.ranges import turning

_LONGEST_CORRECTION = 0.05
_LONGEST_TURN_RAD = 1.0
_CANCELLED = 1e-6
"""Part of the fastest site's motion below which a site stays where it is."""
_FOLLOWED = 0.2
"""Part of its way by which a site may miss after a step that is shortened as advised."""


def assemble(
    model: mujoco.MjModel,
    data: mujoco.MjData | None = None,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
    *,
    geometry_accuracy: float | None = None,
) -> mujoco.MjData:
    """A state whose `qpos` closes every active equality to 1e-10 m or rad.

    Newton's method on the manifold of joint positions: each step closes the gaps to first order
    with the least change in the metric of the mass matrix. Joint limits do not count.

    An over-constrained mechanism closes as far as its geometry is accurate: with axes that are
    parallel to 1e-6 only, gaps of this size stay that no motion within it can close.

    Args:
        model: Any model.
        data: The state to begin from, which stays as it is; None is the model's `qpos0`.
        held: What does not move: names of joints, tendons or actuators, or velocity indices as in
            `system.stuck`.
        pinned: Frames that stay where they are: names of sites, :class:`Body`, or :class:`Pin`.
        geometry_accuracy: In rad or relative length; None is what the numbers of the model show, as
            in `jac.geometry_accuracy`, and mostly zero.

    Returns:
        A new state, derived quantities up to date.

    Raises:
        ClosureError: An equality that does not close: which, and how far it stays open.
        ModelError: A name that does not exist; an active equality of a flex; closures that the
            model's flags switch off.
        ValueError: `data` is of another model, or its `qpos` is not finite.
        TypeError: An argument is of another kind.
    """
    check.instance("model", model, mujoco.MjModel)
    if data is not None:
        check_state(model, data)
    closed = mujoco.MjData(model) if data is None else copy.copy(data)
    check_closures(model, closed)
    mujoco.mj_fwdPosition(model, closed)
    close(model, closed, hold(model, closed, held, pinned), _checked(geometry_accuracy))
    return closed


def advance(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    velocity: Array,
    duration_s: float = 1.0,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
    *,
    geometry_accuracy: float | None = None,
) -> mujoco.MjData:
    """The state after moving at a constant velocity for some time, all loops closed again.

    Args:
        model: The model.
        data: The state to begin from, which stays as it is.
        velocity: Of all joints, in MuJoCo's order, shape (N,), as `kin.velocities(rates)`; what
            follows the first nv numbers belongs to transmissions and follows from these.
        duration_s: How long; 1 for a velocity that is a displacement.
        held: What takes no part in closing the loops: joints that are stuck (`system.stuck`), or
            actuated ones that must move exactly as commanded.
        pinned: As for :func:`assemble`.
        geometry_accuracy: As for :func:`assemble`.

    Where a site misses where its velocity leads by more than the way there, as next to a singular
    pose, a `RuntimeWarning` says which and how much shorter the step must be: the site follows the
    command to a fifth then. Sites whose velocities cancel entirely are no part of a command.

    Raises:
        ValueError: The step is too long: a joint turns by more than 1 rad, or closing the loops
            again would change the motion by more than a twentieth.
        ClosureError, ModelError, TypeError: As :func:`assemble`.
    """
    check_state(model, data)
    v = check.series("velocity", velocity)
    if len(v) < model.nv:
        raise ValueError(f"velocity must have shape (N,), N at least {model.nv}, got {v.shape}")
    motion = v[: model.nv] * check.positive("duration_s", duration_s)
    _refuse_long_turns(model, motion)
    held, pinned = held_in(held), pins_of(model, pinned)
    accuracy = _checked(geometry_accuracy)
    moved = assemble(model, data, held, pinned, geometry_accuracy=accuracy)
    fixed = hold(model, moved, held, pinned).moved(model, moved, motion)
    begun, wanted = moved.site_xpos.copy(), _site_motion(model, moved, motion)
    mujoco.mj_integratePos(model, moved.qpos, motion, 1.0)
    mujoco.mj_fwdPosition(model, moved)
    before = moved.qpos.copy()
    close(model, moved, fixed, accuracy)
    correction = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, correction, 1.0, before, moved.qpos)
    mass = mass_of(model, moved)
    change, length = (np.sqrt(d @ mass @ d) for d in (correction, motion))
    if change > _LONGEST_CORRECTION * length + CLOSED:
        raise ValueError(
            "velocity times duration_s must be a shorter step: closing the loops again changes "
            f"{change / length:.0%} of the motion"
        )
    _warn_of_miss(model, wanted, moved.site_xpos - begun)
    return moved


def _site_motion(model: mujoco.MjModel, data: mujoco.MjData, motion: Array) -> Array:
    """Displacement of each site to first order, shape (nsite, 3)."""
    wanted, rows = np.empty((model.nsite, 3)), np.zeros((3, model.nv))
    for k in range(model.nsite):
        mujoco.mj_jacSite(model, data, rows, None, k)
        wanted[k] = rows @ motion
    return wanted


def _warn_of_miss(model: mujoco.MjModel, wanted: Array, moved: Array) -> None:
    """Warn where a site ends farther from where it was to be than it was to go."""
    way, missed = (np.linalg.norm(each, axis=1) for each in (wanted, moved - wanted))
    is_command = way > np.maximum(_CANCELLED * way.max(initial=0.0), CLOSED)
    ratio = np.divide(missed, way, out=np.zeros_like(way), where=is_command)
    if ratio.max(initial=0.0) > 1.0:
        worst = greatest(ratio)
        warnings.warn(
            f'site "{name_of(model.site(worst))}" was to move by {way[worst]:.3g} and ends '
            f"{missed[worst]:.3g} from there, as next to a singular pose: take steps of at most "
            f"{_FOLLOWED / ratio[worst]:.2g} times this length",
            RuntimeWarning,
            stacklevel=3,
        )


def _refuse_long_turns(model: mujoco.MjModel, motion: Array) -> None:
    """Beyond a radian a velocity says little about where the task goes."""
    turns = np.abs(motion) * turning(model)
    if turns.max(initial=0.0) > _LONGEST_TURN_RAD:
        joint = name_of(model.joint(int(model.dof_jntid[greatest(turns)])))
        raise ValueError(
            f'velocity times duration_s must be a shorter step: joint "{joint}" turns by '
            f"{turns.max():.3g} rad, more than {_LONGEST_TURN_RAD:g}"
        )


def _checked(geometry_accuracy: float | None) -> float | None:
    if geometry_accuracy is None:
        return None
    return check.number("geometry_accuracy", geometry_accuracy)
