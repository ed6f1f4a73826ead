"""Loading of MJCF and URDF files, with checks of their numbers."""

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
"""Largest number of a model; MuJoCo treats a state of this size as diverged."""
SHORTEST_S, LONGEST_S = 1e-7, 1.0
"""Shortest and longest time step [s]; at the shortest, one simulated second takes minutes."""

_KINDS = {"jnt": "joint", "dof": "joint", "eq": "equality", "cam": "camera"}
"""Element kinds of `MjModel` fields whose names do not begin with the kind."""
_OPEN = re.compile(r".*range|.*_sol\w+|.*_user")
"""Fields whose numbers may be infinite or arbitrary: ranges, solver parameters, user data."""
_DERIVED = re.compile(r".*(weight0|M0|acc0|length0|mass0|rbound|aabb|_length)|(bvh|oct|efm0)_.*")
"""Fields that MuJoCo computes from others: an inverse may be large."""
_NOT_NEGATIVE = re.compile(r".*_(damping|armature|frictionloss)")
"""Fields that must not be negative, since negative ones would drive the machine."""


def load_model(path: str | Path | None = None, *, add_locks: bool = False) -> mujoco.MjModel:
    """Compile an MJCF or URDF file; without a path, the hexapod `models/fjh.xml`.

    A URDF file states no actuators: `docs/load.md` shows how to add them.

    Args:
        path: Path of the file, which is not changed.
        add_locks: Whether to add a lock, for position failures of a :class:`Plant`, to each
            actuated slide, hinge or tendon without one: an inactive equality that fixes only it,
            as stiff as the time step allows, named `lock{k + 1}` after its first actuator k.

    Raises:
        ModelError: The file is missing or not valid; a number is NaN, infinite, beyond 1e10, or
            negative where that makes no sense; the time step is not within 1e-7..1 s; or another
            equality has the name of a lock to be added.
    """
    check.instance("add_locks", add_locks, bool)
    spec, model = load_spec(path)
    return spec.compile() if add_locks and add_locks_to(spec, model) else model


def load_spec(path: str | Path | None = None) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Read a file as a specification and compile it, with the checks of :func:`load_model`."""
    file = _file(path)
    _check_text(file)
    try:
        with warnings.catch_warnings(record=True, action="always") as caught:
            spec = mujoco.MjSpec.from_file(str(file))
            model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        if "package://" in file.read_text(errors="replace"):
            reason += "; for meshes of package:// see docs/load.md: meshdir and strippath"
        raise ModelError(f"{file} is not a valid MJCF or URDF model: {reason}") from None
    _check_numbers(file, model)
    for warning in caught:  # not before the checks: a rejected file gives one error only
        warnings.warn(warning.message, warning.category, stacklevel=3)
    return spec, model


def model_sha256(path: str | Path | None = None) -> str:
    """Return the SHA-256 of an MJCF file, by which results identify their machine."""
    return hashlib.sha256(_file(path).read_bytes()).hexdigest()


def _file(path: str | Path | None) -> Path:
    file = HEXAPOD_MJCF if path is None else Path(check.instance("path", path, str, Path))
    try:
        exists = file.is_file()
    except (OSError, ValueError):  # a name too long, or with a null character
        exists = False
    if exists:
        return file
    raise ModelError(f"there is no MJCF or URDF file {check.short_repr(str(file))}")


def _check_text(file: Path) -> None:
    """Reject NaN in a file, which MuJoCo treats as a number that is not stated, such as a mass.

    Included files are not checked.
    """
    if b"nan" not in (text := file.read_bytes()).lower():
        return
    try:
        elements = ElementTree.fromstring(text).iter()
    except (ElementTree.ParseError, ValueError, LookupError):
        return  # MuJoCo reports the error when it reads the file
    for element in elements:
        for attribute, value in element.items():
            if attribute not in ("name", "class") and "nan" in value.lower().split():
                whose = f'{element.tag} "{element.get("name", "without a name")}"'
                raise ModelError(f"{file}: {attribute} of {whose} is not a number, got {value}")


def _check_numbers(file: Path, model: mujoco.MjModel) -> None:
    """Reject non-finite and absurdly large numbers, which MuJoCo compiles."""
    step_s = model.opt.timestep
    if not SHORTEST_S <= step_s <= LONGEST_S:
        within = f"from {SHORTEST_S:g} to {LONGEST_S:g} s"
        raise ModelError(f"{file}: timestep must be {within}, got {step_s:g}")
    # Derived numbers last: the message names the number in the file.
    for field, A in sorted(_arrays(model), key=lambda pair: bool(_DERIVED.fullmatch(pair[0]))):
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
            message = f"{_describe(model, field, row)} must be {expected}, got {A[wrong][0]:g}"
            raise ModelError(f"{file}: {message}")


def _arrays(model: mujoco.MjModel) -> Iterator[tuple[str, Array]]:
    """Iterate over all floating-point fields of a model: name and array."""
    for part, prefix in ((model, ""), (model.opt, "option_"), (model.stat, "statistic_")):
        for field in dir(part):
            value: Any = None if field.startswith("_") else getattr(part, field)
            if isinstance(value, float) or getattr(value, "dtype", None) == np.float64:
                yield prefix + field, np.atleast_1d(value)


def _describe(model: mujoco.MjModel, field: str, row: int) -> str:
    """Describe a row of a field as in the file: attribute, element kind and name."""
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
