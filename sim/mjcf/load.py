"""Loading MJCF and URDF files, and refusing absurd numbers in them."""

import hashlib
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.drive import add_locks as add_locks_to

# The rooms are neighbours in a checkout and in site-packages alike.
MODELS = Path(__file__).parents[2] / "models"
"""Folder of the MJCF files that come with the package: arm, arms, fjh, hand, platform."""

HEXAPOD_MJCF = MODELS / "fjh.xml"

LARGEST = 1e10
"""Largest number of a model; MuJoCo takes a state of this size for a simulation that diverged."""
SHORTEST_S, LONGEST_S = 1e-7, 1.0
"""Shortest and longest time step: at the shortest a second of simulation takes minutes."""

_KINDS = {"jnt": "joint", "dof": "joint", "eq": "equality", "cam": "camera"}
"""Kind of element of an array of an `MjModel`, where its name does not begin with the kind."""
_OPEN = re.compile(r".*range|.*_sol\w+|.*_user")
"""Ranges may be infinite, softness is a ratio or a stiffness, a user's own numbers may be any."""
_DERIVED = re.compile(r".*(weight0|M0|acc0|length0|mass0|rbound|aabb|_length)|(bvh|oct|efm0)_.*")
"""Numbers that MuJoCo computes of the others: an inverse may be large."""
_NOT_NEGATIVE = re.compile(r".*_(damping|armature|frictionloss)")
"""Negative ones would drive the machine."""


def load_model(path: str | Path | None = None, *, add_locks: bool = False) -> mujoco.MjModel:
    """Compile an MJCF or URDF file; without a path, the hexapod `models/fjh.xml`.

    A URDF file states no actuators: `docs/urdf.md` shows how to add them.

    Args:
        path: Of the file, which is not changed.
        add_locks: Whether each slide, hinge or tendon with an actuator gets a lock for position
            failures of a :class:`Plant`, unless it has one: an inactive equality that holds it
            alone, as stiff as the time step allows, named `lock{k + 1}` after its first actuator k.

    Raises:
        ModelError: The file is missing or not valid; one of its numbers is NaN, infinite, beyond
            1e10, or negative where none may be, or the time step is not within 1e-7 and 1 s; or
            the name of a lock to be added is that of another equality.
    """
    check.instance("add_locks", add_locks, bool)
    spec, model = load_spec(path)
    return spec.compile() if add_locks and add_locks_to(spec, model) else model


def load_spec(path: str | Path | None = None) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Read a file as a specification to be changed, and compile it, both as :func:`load_model`."""
    file = _file(path)
    _check_text(file)
    try:
        with warnings.catch_warnings(record=True, action="always") as said:
            spec = mujoco.MjSpec.from_file(str(file))
            model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        if "package://" in file.read_text(errors="replace"):
            reason += "; for meshes of package:// see docs/urdf.md: meshdir and strippath"
        raise ModelError(f"{file} is not a valid MJCF or URDF model: {reason}") from None
    _check_numbers(file, model)
    for each in said:  # what is refused is refused in one sentence
        warnings.warn(each.message, each.category, stacklevel=3)
    return spec, model


def model_sha256(path: str | Path | None = None) -> str:
    """Hash an MJCF file, which identifies the machine of a result; a ModelError without one."""
    return hashlib.sha256(_file(path).read_bytes()).hexdigest()


def _file(path: str | Path | None) -> Path:
    file = HEXAPOD_MJCF if path is None else Path(check.instance("path", path, str, Path))
    try:
        found = file.is_file()
    except (OSError, ValueError):  # a name too long, or with a null character
        found = False
    if found:
        return file
    raise ModelError(f"there is no MJCF or URDF file {check.short_repr(str(file))}")


def _check_text(file: Path) -> None:
    """Refuse NaN in a file: MuJoCo takes one for a number that is not stated, such as a mass.

    Files that it includes are not read.
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


def _check_numbers(file: Path, model: mujoco.MjModel) -> None:
    """Refuse numbers that no machine has: MuJoCo compiles any, and simulates NaN."""
    step_s = model.opt.timestep
    if not SHORTEST_S <= step_s <= LONGEST_S:
        within = f"from {SHORTEST_S:g} to {LONGEST_S:g} s"
        raise ModelError(f"{file}: timestep must be {within}, got {step_s:g}")
    # Derived numbers last: the message names what the file states.
    for field, A in sorted(_arrays(model), key=lambda each: bool(_DERIVED.fullmatch(each[0]))):
        expected = f"a number of at most {LARGEST:g}"
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
    """All floating-point numbers of a model, by field."""
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
    if prefix in ("option", "statistic"):
        return attribute
    kind = _KINDS.get(prefix, prefix)
    try:
        name = getattr(model, kind)(row).name
    except AttributeError:
        return f"{field} of number {row}"
    except IndexError:  # an actuator may have several rows
        name = ""
    return f'{attribute} of {kind} "{name or f"number {row}"}"'
