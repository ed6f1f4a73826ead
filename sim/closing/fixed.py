"""Coordinates that stay fixed while loops are closed: joints, transmissions, pinned frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.drive import Drive, drive_rows, drives, extra_drives
from sim.mjcf.frame import Body, Located, located, rotation_vector
from sim.mjcf.model import listed

_NO_LENGTHS = check.frozen(np.zeros(0))


@dataclass(frozen=True)
class Pin:
    """Fixed frame, such as a standing foot: a contact that is treated as an equality.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`Body`.
        weld: Whether rotation is fixed as well; otherwise only the origin is.
    """

    frame: str | Body
    weld: bool = False

    def __post_init__(self) -> None:
        """Check the arguments."""
        check.instance("frame", self.frame, str, Body)
        check.flag("weld", self.weld)


class LocatedPin(NamedTuple):
    """Pin of one model: name of its frame, the frame, and the rows of its twist that are zero."""

    name: str | int
    frame: Located
    rows: slice

    @property
    def height(self) -> int:
        """Number of rows."""
        return self.rows.stop - self.rows.start


def pins_of(model: mujoco.MjModel, pinned: Iterable[str | Body | Pin]) -> tuple[LocatedPin, ...]:
    """Look up the pins of an argument `pinned`; a frame given without :class:`Pin` may rotate."""
    pins = []
    for pin in check.members("pinned", pinned, str, Body, Pin):
        frame, weld = (pin.frame, pin.weld) if isinstance(pin, Pin) else (pin, False)
        name = frame if isinstance(frame, str) else frame.name
        rows = slice(0, 6) if weld else slice(3, 6)
        pins.append(LocatedPin(name, located(model, "pinned", frame), rows))
    return tuple(pins)


class FixedMotion(NamedTuple):
    """Fixed velocities, transmissions and pins, with reference lengths and poses.

    Lengths are as `data.actuator_length`, poses rotations and positions, both set by :meth:`at`.
    """

    velocities: tuple[int, ...]
    drives: tuple[Drive, ...]
    pins: tuple[LocatedPin, ...]
    lengths: Array = _NO_LENGTHS
    poses: tuple[tuple[Array, Array], ...] = ()

    def binds(self, data: mujoco.MjData) -> bool:
        """Return whether any equality, fixed drive or pin has to be closed."""
        return bool(self.drives or self.pins or data.eq_active.any())

    def at(self, data: mujoco.MjData) -> "FixedMotion":
        """Return a copy with the lengths and poses of a state that is up to date."""
        frames = [pin.frame for pin in self.pins]
        poses = tuple((at.rotation(data).copy(), at.position_m(data).copy()) for at in frames)
        return self._replace(lengths=self._lengths(data), poses=poses)

    def rows(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the gradients (p, nv) of :meth:`gaps`."""
        of_pins = [pin.frame.jacobian(model, data)[pin.rows] for pin in self.pins]
        return np.vstack([drive_rows(model, data, self.drives), *of_pins])

    def gaps(self, data: mujoco.MjData) -> Array:
        """Return how far transmissions and frames have moved, (p,), [m] or [rad]."""
        gaps = [(self._lengths(data) - self.lengths) / self._gear]
        gaps[0][[not drive.has_length for drive in self.drives]] = 0.0  # fixed by their rows only
        for pin, (rotation, position) in zip(self.pins, self.poses, strict=True):
            turn = rotation_vector(pin.frame.rotation(data) @ rotation.T)
            gaps.append(np.append(turn, pin.frame.position_m(data) - position)[pin.rows])
        return np.concatenate(gaps)

    def turns(self) -> list[bool]:
        """Return whether each gap is an angle; otherwise it is a length."""
        of_pins = [row < 3 for pin in self.pins for row in range(6)[pin.rows]]
        return [*(drive.unit == "rad" for drive in self.drives), *of_pins]

    def names(self) -> list[str]:
        """Return a description of the element of each gap."""
        of_pins = [f'pinned "{pin.name}"' for pin in self.pins for _ in range(pin.height)]
        return [*(f'held "{drive.name}"' for drive in self.drives), *of_pins]

    def moved(self, model: mujoco.MjModel, data: mujoco.MjData, motion: Array) -> "FixedMotion":
        """Return a copy whose lengths have changed by a motion (nv,) from the state."""
        elongation = drive_rows(model, data, self.drives) @ motion
        return self._replace(lengths=self.lengths + self._gear * elongation)

    def _lengths(self, data: mujoco.MjData) -> Array:
        return data.actuator_length[[drive.outputs[0] for drive in self.drives]]

    @property
    def _gear(self) -> Array:
        return np.array([drive.gear[0] for drive in self.drives])


def fixed_motion(
    model: mujoco.MjModel, held: Iterable[str | int], pinned: Iterable[str | Body | Pin]
) -> FixedMotion:
    """Look up the arguments `held` and `pinned` of :func:`assemble`.

    Raises:
        ModelError: An element does not exist; the message suggests the nearest name.
        ValueError: An index is invalid.
    """
    velocities: list[int] = []
    fixed_drives: list[Drive] = []
    for item in check.members("held", held, str, int, np.integer):
        is_name = isinstance(item, str)
        part = _by_name(model, item) if is_name else _by_number(model, check.integer("held", item))
        if isinstance(part, Drive):
            fixed_drives.append(part)
        else:
            velocities += part
    return FixedMotion(tuple(velocities), tuple(fixed_drives), pins_of(model, pinned))


def _by_number(model: mujoco.MjModel, velocity: int) -> list[int] | Drive:
    """Return a velocity, or a transmission without a joint, by number."""
    if velocity < model.nv:
        return [velocity]
    extra = extra_drives(drives(model))
    if velocity < model.nv + len(extra):
        return extra[velocity - model.nv]
    raise ModelError(f"held must lie in 0..{model.nv + len(extra) - 1}, got {velocity}")


def _by_name(model: mujoco.MjModel, name: str) -> list[int] | Drive:
    """Return the velocities of a joint, or a transmission without a joint, by a name."""
    of_model = drives(model)
    joints = {(model.joint(k).name, k) for k in range(model.njnt)}
    joints |= {(label, d.joint) for d in of_model if d.joint is not None for label in d.actuators}
    extra = [(label, d) for d in extra_drives(of_model) for label in {d.name, *d.actuators}]
    matches = [match for label, match in (*joints, *extra) if label == name != ""]
    if not matches:
        names = sorted({label for label, _ in (*joints, *extra)} - {""})
        near = get_close_matches(name, names, 1)
        hint = f'; did you mean "{near[0]}"?' if near else f"; it has: {listed(names)}"
        raise ModelError(f'held: the model has no joint, tendon or actuator "{name}"{hint}')
    if len(matches) > 1:
        raise ModelError(f'held: "{name}" means both a joint and a tendon or actuator')
    match = matches[0]
    return match if isinstance(match, Drive) else np.flatnonzero(model.dof_jntid == match).tolist()
