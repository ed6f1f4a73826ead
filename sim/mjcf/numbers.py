"""The numbers of a model: all finite, none absurd. MuJoCo compiles any, and flies NaN."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from sim.array import Array
from sim.errors import ModelError

LARGEST = 1e10
"""In the units of the file. MuJoCo takes a state of this size for a simulation that diverged."""
SHORTEST_S, LONGEST_S = 1e-7, 1.0
"""Of a time step: at the shortest a second of simulation takes minutes."""

_KINDS = {"jnt": "joint", "dof": "joint", "eq": "equality", "cam": "camera"}
_KINDS |= {kind: kind for kind in ("body", "geom", "site", "tendon", "actuator", "key", "sensor")}
"""What the arrays of an :class:`mujoco.MjModel` are of, by how their names begin."""

_OPEN = re.compile(r".*range|.*_sol\w+|.*_user")
"""Ranges may be infinite, softness is a ratio or a stiffness, and what a user adds is nobody's."""
_DERIVED = re.compile(r".*(weight0|M0|acc0|length0|mass0|rbound|aabb|_length)|(bvh|oct|efm0)_.*")
"""What MuJoCo computes of the others: an inverse may be large."""
_NOT_NEGATIVE = re.compile(r".*_(damping|armature|frictionloss)")
"""They would drive the machine."""


def check_text(file: Path) -> None:
    """Refuse NaN in a file: MuJoCo takes one for a number that is not stated, such as a mass.

    Files that it includes are not read.

    Raises:
        ModelError: An attribute of an element has one.
    """
    if b"nan" not in (text := file.read_bytes()).lower():
        return
    try:
        elements = ElementTree.fromstring(text).iter()
    except (ElementTree.ParseError, ValueError, LookupError):
        return  # the reader says what is wrong
    for element in elements:
        for attribute, value in element.items():
            if attribute not in ("name", "class") and "nan" in value.lower().split():
                whose = f'{element.tag} "{element.get("name", "without a name")}"'
                raise ModelError(f"{file}: {attribute} of {whose} is not a number, got {value}")


def check_numbers(file: Path, model: mujoco.MjModel) -> None:
    """Refuse numbers of a compiled model that no machine has.

    Raises:
        ModelError: One is NaN, infinite, larger than :data:`LARGEST`, or negative where none may
            be; or the time step is not within :data:`SHORTEST_S` and :data:`LONGEST_S`.
    """
    step_s = model.opt.timestep
    if not SHORTEST_S <= step_s <= LONGEST_S:
        within = f"from {SHORTEST_S:g} to {LONGEST_S:g} s"
        raise ModelError(f"{file}: timestep must be {within}, got {step_s:g}")
    arrays = dict(_arrays(model))
    for field in sorted(arrays, key=lambda field: _DERIVED.fullmatch(field) is not None):
        A, expected = arrays[field], f"a number of at most {LARGEST:g}"
        if _OPEN.fullmatch(field):
            wrong, expected = np.isnan(A), "a number"
        elif _DERIVED.fullmatch(field):
            wrong, expected = ~np.isfinite(A), "a finite number"
        else:
            wrong = ~(np.abs(A) <= LARGEST)
        if _NOT_NEGATIVE.fullmatch(field):
            wrong, expected = wrong | (A < 0), f"{expected}, not negative"
        if wrong.any():
            row = int(np.argwhere(wrong)[0, 0])
            said = f"{_named(model, field, row)} must be {expected}, got {A[wrong][0]:g}"
            raise ModelError(f"{file}: {said}")


def _arrays(model: mujoco.MjModel) -> Iterator[tuple[str, Array]]:
    """All floating numbers of a model, by field."""
    for part, prefix in ((model, ""), (model.opt, "option_"), (model.stat, "statistic_")):
        for field in dir(part):
            value: Any = None if field.startswith("_") else getattr(part, field)
            if isinstance(value, float) or getattr(value, "dtype", None) == np.float64:
                yield prefix + field, np.atleast_1d(value)


def _named(model: mujoco.MjModel, field: str, row: int) -> str:
    """A row of a field in words, as in the file: its attribute, and its element's kind and name."""
    prefix, _, attribute = field.partition("_")
    if field.startswith("qpos"):
        row = int(np.searchsorted(model.jnt_qposadr, row, side="right")) - 1
        prefix, attribute = "jnt", field
    elif prefix == "dof":
        row = int(model.dof_jntid[row])
    if (kind := _KINDS.get(prefix)) is None:
        return attribute if prefix in ("option", "statistic") else f"{field} of number {row}"
    try:
        name = getattr(model, kind)(row).name
    except IndexError:  # an actuator may have several rows
        name = ""
    return f'{attribute} of {kind} "{name or f"number {row}"}"'
