"""Pins: frames that stay where they are, contacts taken as equalities."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.mjcf.frame import Body, Located, located


@dataclass(frozen=True)
class Pin:
    """A frame that stays where it is, as a foot that stands: a contact taken as an equality.

    Attributes:
        frame: Name of a site or else of a body, or a :class:`Body`.
        weld: Whether it does not turn either; otherwise only its origin stays.
    """

    frame: str | Body
    weld: bool = False

    def __post_init__(self) -> None:
        """Check the arguments."""
        check.instance("frame", self.frame, str, Body)
        check.flag("weld", self.weld)

    @property
    def rows(self) -> slice:
        """Which rows of the frame's twist are zero."""
        return slice(0, 6) if self.weld else slice(3, 6)


def pins_of(model: mujoco.MjModel, pinned: Iterable[str | Body | Pin]) -> tuple[Pin, ...]:
    """The pins; a frame alone is one that may turn.

    Raises:
        ModelError: A frame that does not exist.
        TypeError: Something of another kind.
    """
    given = check.members("pinned", pinned, str, Body, Pin)
    pins = tuple(pin if isinstance(pin, Pin) else Pin(pin) for pin in given)
    located_pins(model, pins)  # raises where one does not exist
    return pins


class LocatedPin(NamedTuple):
    """A pin by the number of its frame, and which rows of its twist are zero."""

    frame: Located
    rows: slice

    @property
    def height(self) -> int:
        """How many rows."""
        return self.rows.stop - self.rows.start


def located_pins(model: mujoco.MjModel, pins: Iterable[Pin]) -> tuple[LocatedPin, ...]:
    """The pins, looked up by their names.

    Raises:
        ModelError: A frame that does not exist.
    """
    return tuple(LocatedPin(located(model, "pinned", pin.frame), pin.rows) for pin in pins)


def pin_rows(model: mujoco.MjModel, data: mujoco.MjData, pins: Iterable[LocatedPin]) -> Array:
    """Velocities that pins forbid, shape (p, nv)."""
    rows = [frame.jacobian(model, data)[forbidden] for frame, forbidden in pins]
    return np.vstack([np.zeros((0, model.nv)), *rows])
