"""Assembly: joint positions at which every loop of a model is closed."""

import copy
import warnings
from collections.abc import Iterable

import mujoco

import argument_checks as check
from sim.closing.equalities import check_closures
from sim.closing.hold import hold
from sim.closing.newton import close
from sim.closing.pin import Pin, located_pins
from sim.mjcf.frame import Body
from sim.mjcf.model import check_state, start_of


def assemble(
    model: mujoco.MjModel,
    data: mujoco.MjData | None = None,
    held: Iterable[str | int] = (),
    pinned: Iterable[str | Body | Pin] = (),
    *,
    geometry_accuracy: float | None = None,
) -> mujoco.MjData:
    """A state whose `qpos` closes every active equality to 1e-10 rad, or of its own length.

    Of a length that is 1e-10 m in a model of a metre, 1e-7 mm in the same model in millimetres: the
    own length is the longest chain from a joint to what closures or pins hold. Where round-off lets
    it be, a gap is below 1e-10 in the unit of a larger model, too.

    Newton's method on the manifold of joint positions: each step closes the gaps to first order
    with the least change in the metric of the mass matrix. Joint limits do not count.

    An over-constrained mechanism closes as far as its geometry is accurate: with axes that are
    parallel to 1e-6 only, gaps of this size stay that no motion within it can close.

    Equalities of a flex beside the mechanism, such as a cloth, are left out, and a `RuntimeWarning`
    names each.

    Args:
        model: Any model.
        data: The state to begin from, which stays as it is; None is the model's
            first keyframe, or `qpos0` where it has none, as everywhere.
        held: What does not move: names of joints, tendons or actuators, or velocity indices as in
            `system.stuck`.
        pinned: Frames that stay where they are: names of sites, :class:`Body`, or :class:`Pin`.
        geometry_accuracy: In rad or relative length; None is what the numbers of the model show, as
            in `jac.geometry_accuracy`, and mostly zero.

    Returns:
        A new state, derived quantities up to date.

    Raises:
        ClosureError: An equality that does not close: which, and how far it stays open.
        ModelError: A name that does not exist; an active equality that ties a flex to what
            actuators, closures or pins have to do with; closures that the model's flags switch
            off.
        ValueError: `data` is of another model, or its `qpos` is not finite.
        TypeError: An argument is of another kind.
    """
    check.instance("model", model, mujoco.MjModel)
    if data is not None:
        check_state(model, data)
    closed = start_of(model) if data is None else copy.copy(data)
    accuracy = checked_accuracy(geometry_accuracy)
    for sentence in assemble_in_place(model, closed, held, pinned, accuracy):
        warnings.warn(sentence, RuntimeWarning, stacklevel=2)
    return closed


def assemble_in_place(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    held: Iterable[str | int],
    pinned: Iterable[str | Body | Pin],
    accuracy: float | None,
) -> tuple[str, ...]:
    """The same of a state that is changed; returns a sentence for each equality that is left out.

    Raises:
        ClosureError, ModelError, TypeError: As :func:`assemble`.
    """
    mujoco.mj_fwdPosition(model, data)
    fixed = hold(model, data, held, pinned)
    frames = [pin.frame for pin in located_pins(model, fixed.pins)]
    beside = check_closures(model, data, frames)
    if fixed.binds(data):
        close(model, data, fixed, accuracy)
    return beside


def checked_accuracy(geometry_accuracy: float | None) -> float | None:
    """The argument of this name, None or a number."""
    if geometry_accuracy is None:
        return None
    return check.number("geometry_accuracy", geometry_accuracy)
