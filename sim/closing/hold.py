"""What stays where it is while loops are closed: held joints and transmissions, pinned frames."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import chain

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.closing.pin import Pin, located_pins, pin_rows, pins_of
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.frame import Body, frame_pose, rotation_vector
from sim.mjcf.model import listed
from sim.mjcf.transmission import drive_rows, drives, extra_drives


@dataclass(frozen=True)
class Hold:
    """What stays as it was in one state.

    Attributes:
        free: Velocities that may move, shape (nv,).
        drives: Transmissions whose length stays.
        lengths: These lengths, as `data.actuator_length`.
        pins: Frames that stay.
        poses: Where these were.
    """

    free: Array
    drives: tuple[Drive, ...]
    lengths: Array
    pins: tuple[Pin, ...]
    poses: tuple[tuple[Array, Array], ...]

    def binds(self, data: mujoco.MjData) -> bool:
        """Whether there are loops to close, or what stays needs more than not to be moved."""
        return bool(self.drives or self.pins or data.eq_active.any())

    def rows_and_gaps(self, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array]:
        """Slopes (p, nv) of how far these have moved, and how far, (p,), [m] or [rad]."""
        now = data.actuator_length[[drive.outputs[0] for drive in self.drives]]
        gaps = [(now - self.lengths) / [drive.gear[0] for drive in self.drives]]
        gaps[0][[not drive.has_length for drive in self.drives]] = 0.0  # held by their rows alone
        for pin, (rotation, position) in zip(self.pins, self.poses, strict=True):
            turned, shifted = frame_pose(data, pin.frame)
            change = np.concatenate([rotation_vector(turned @ rotation.T), shifted - position])
            gaps.append(change[pin.rows])
        rows = [
            drive_rows(model, data, self.drives),
            pin_rows(model, data, located_pins(model, self.pins)),
        ]
        return np.vstack(rows), np.concatenate(gaps)

    def turns(self) -> list[bool]:
        """Whether each of these gaps is an angle; otherwise it is a length."""
        of_pins = ([True, True, True, False, False, False][pin.rows] for pin in self.pins)
        return [*(drive.unit == "rad" for drive in self.drives), *chain(*of_pins)]

    def moved(self, model: mujoco.MjModel, data: mujoco.MjData, motion: Array) -> "Hold":
        """The same after a motion (nv,) from the state: transmissions grow as it says."""
        growth = drive_rows(model, data, self.drives) @ motion
        gear = np.array([drive.gear[0] for drive in self.drives])
        return replace(self, lengths=self.lengths + gear * growth)

    def names(self) -> list[str]:
        """What each row holds, in words."""
        names = [f'held "{drive.name}"' for drive in self.drives]
        for pin in self.pins:
            name = pin.frame if isinstance(pin.frame, str) else pin.frame.name
            names += [f'pinned "{name}"'] * (pin.rows.stop - pin.rows.start)
        return names


def hold(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    held: Iterable[str | int],
    pinned: Iterable[str | Body | Pin],
) -> Hold:
    """Hold joints, transmissions and frames as they are in a state, which is up to date.

    Args:
        model: The model.
        data: The state.
        held: Names of joints, tendons or actuators; or velocity indices, those beyond nv counting
            the transmissions that are no joint.
        pinned: See :func:`pins_of`.

    Raises:
        ModelError: Something that does not exist, with the nearest that does.
        TypeError: An argument is of another kind.
    """
    free, of_drives = np.ones(model.nv, dtype=bool), []
    for item in held_in(held):
        kept = _held(model, item)
        if isinstance(kept, Drive):
            of_drives.append(kept)
        else:
            free[kept] = False
    pins = pins_of(model, pinned)
    return Hold(
        free=free,
        drives=tuple(of_drives),
        lengths=data.actuator_length[[drive.outputs[0] for drive in of_drives]].copy(),
        pins=pins,
        poses=tuple(frame_pose(data, pin.frame) for pin in pins),
    )


def held_in(held: Iterable[str | int]) -> tuple[str | int, ...]:
    """Names and indices as a list.

    Raises:
        ValueError: An index that is none.
        TypeError: Something of another kind.
    """
    each = check.members("held", held, str, int, np.integer)
    return tuple(item if isinstance(item, str) else check.index("held", item) for item in each)


def _held(model: mujoco.MjModel, item: str | int) -> NDArray[np.intp] | Drive:
    """The velocities of a joint, or a transmission that is no joint."""
    if isinstance(item, int):
        return _numbered(model, item)
    of_model = drives(model)
    names = {model.joint(k).name for k in range(model.njnt)}
    names |= {name for drive in of_model for name in (drive.name, *drive.actuators)}
    found = [np.flatnonzero(model.dof_jntid == k) for k in _joints(model, of_model, item)]
    found += [drive for drive in extra_drives(of_model) if item in (drive.name, *drive.actuators)]
    if len(found) == 1 and item:
        return found[0]
    if found and item:
        raise ModelError(f'held: "{item}" means both a joint and a tendon or actuator')
    near = get_close_matches(item, filter(None, names), 1)
    hint = f'; did you mean "{near[0]}"?' if near else f"; it has: {listed(sorted(names))}"
    raise ModelError(f'held: the model has no joint "{item}"{hint}')


def _joints(model: mujoco.MjModel, of_model: tuple[Drive, ...], name: str) -> set[int]:
    """Joints of this name, or driven by an actuator of this name."""
    named = {k for k in range(model.njnt) if model.joint(k).name == name}
    return named | {d.joint for d in of_model if d.joint is not None and name in d.actuators}


def _numbered(model: mujoco.MjModel, velocity: int) -> NDArray[np.intp] | Drive:
    if velocity < model.nv:
        return np.array([velocity])
    extra = extra_drives(drives(model))
    if velocity < model.nv + len(extra):
        return extra[velocity - model.nv]
    raise ModelError(f"held must lie in 0..{model.nv + len(extra) - 1}, got {velocity}")
