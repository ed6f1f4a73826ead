"""Pins: frames that stay where they are, contacts taken as equalities."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.mjcf.frame import Body, frame_jacobian, located


@dataclass(frozen=True)
class Pin:
    """A frame that stays where it is, as a foot that stands: a contact taken as an equality.

    Attributes:
        frame: Name of a site, or a :class:`Body`.
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
    for pin in pins:
        located(model, "pinned", pin.frame)
    return pins


def pin_rows(model: mujoco.MjModel, data: mujoco.MjData, pins: tuple[Pin, ...]) -> Array:
    """Velocities that pins forbid, shape (p, nv)."""
    rows = [frame_jacobian(model, data, pin.frame)[pin.rows] for pin in pins]
    return np.vstack([np.zeros((0, model.nv)), *rows])
