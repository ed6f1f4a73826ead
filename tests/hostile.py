"""Hostile arguments, and what may come of a call that gets one.

Either one sentence that names the argument and says what it must be, or finite numbers.
"""

import dataclasses
import inspect
import itertools
import re
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from types import ModuleType
from typing import Any

import mujoco
import numpy as np

from argument_checks import is_masked
from fjh.rig.hexapod.forward import UnreachableLengths
from ftc import TaskLost
from ftc.control import NoResponse, UnstableLoop
from sim import ModelError, SimulationDiverged

OUR_ERRORS = (ValueError, TypeError, ModelError, UnreachableLengths)
"""Exactly these: LinAlgError is a ValueError too, but LAPACK's and not ours."""
HARD = (UnreachableLengths, TaskLost, NoResponse, UnstableLoop)
"""What arguments ask for that are valid each, but not to be had; the sentence says why."""

NOT_NUMBERS = {
    "none": None,
    "text": "text",
    "bytes": b"1",
    "object": object(),
    "function": len,
    "dictionary": {"a": 1},
    "set": {0.5},
    "list of none": [None],
    "list of text": ["a", "b"],
    "ragged": [[1.0, 2.0], [3.0]],
    "ragged with a scalar": [0, [1, 2]],
    "date": np.datetime64("2003-01-01"),
}
SCALARS = {
    "bool": True,
    "complex": 1j,
    "nan": np.nan,
    "inf": np.inf,
    "minus inf": -np.inf,
    "minus one": -1,
    "half": 0.5,
    "minus half": -0.5,
    "zero": 0.0,
    "denormal": 5e-324,
    "tiny": 1e-310,
    "small": 1e-160,
    "large": 1e160,
    "largest": 1e308,
    "beyond 64 bits": 2**70,
    "beyond floats": 10**400,
}
ARRAYS = {
    "empty list": [],
    "empty row": [[]],
    "one number": [1.0],
    "bools": np.ones(2, dtype=bool),
    "negative index": [-1],
    "huge index": [2**62],
    "a fraction": [0.5],
    "objects": np.array([object()]),
    "five axes": np.zeros((1, 1, 1, 1, 1)),
    "no rows": np.zeros((0, 3)),
    "99 numbers": np.ones(99),
    "masked constant": [np.ma.masked, 1.0],
    "a matrix of numpy": np.ones((1, 1)).view(np.matrix),  # as a seed it ended the process
}
FEW = {"none": None, "text": "text", "nan": np.nan, "minus one": -1, "99 numbers": np.ones(99)}
SCALES = (0.0, -1.0, 5e-324, 1e-310, 1e-308, 1e-200, 1e-160, 1e-100, 1e100, 1e160, 1e300)
PLANTED = (np.nan, np.inf, 1e308, 1e160, 5e-324, 1e-310, 1j)


def hostile(good: Any) -> Iterator[tuple[str, Any]]:
    """Values to put in place of a good one, each with its name."""
    for label, value in (NOT_NUMBERS | SCALARS | ARRAYS).items():
        if not (callable(good) and callable(value)):  # a function's own errors are its own
            yield label, value
    if isinstance(good, float):
        yield from ((f"scaled by {factor:g}", good * factor) for factor in SCALES)
    if isinstance(good, np.ndarray) and good.dtype == float and good.size:
        yield from _bent(good)
    if isinstance(good, tuple) and all(isinstance(each, np.ndarray) for each in good):
        for number in (*PLANTED, -np.inf):  # a limit that nothing can be within
            yield f"all {number}", tuple(np.full(each.shape, number) for each in good)


def _bent(good: np.ndarray) -> Iterator[tuple[str, Any]]:
    """The good array spoilt: scaled, one number planted, other shapes, masked."""
    for factor in SCALES:
        yield f"scaled by {factor:g}", good * factor
    for number in PLANTED:
        planted = good.astype(np.result_type(good, type(number)))
        planted.flat[good.size // 2] = number
        yield f"with {number}", planted
    yield "as full of the largest", np.full(good.shape, 1e308)
    yield "a row more", np.concatenate([good, good[:1]])
    yield "a column less", good[..., :-1]
    yield "a batch of two", np.stack([good, good])
    yield "a batch of none", np.zeros((0, *good.shape))
    yield "transposed", good.T
    yield "one axis less", good[0]
    yield "masked", np.ma.array(good, mask=good == good.flat[0])
    yield "rows masked", [np.ma.array(row, mask=True) for row in good]
    yield "as text", good.astype(str)
    yield "as bools", good.astype(bool)
    yield "as integers", np.rint(good).astype(np.int64)
    yield "as long doubles", good.astype(np.longdouble) * np.longdouble("1e4000")


@dataclass(frozen=True)
class Target:
    """A callable with good arguments, the ones to attack among them.

    Attributes:
        call: Takes the arguments by name and returns all its numbers.
        good: Arguments that it accepts.
        spared: Arguments that are not replaced.
        gaps: Arguments whose masked numbers count as missing, which other tests see to.
    """

    call: Callable[..., Any]
    good: Mapping[str, Any]
    spared: tuple[str, ...] = ()
    gaps: tuple[str, ...] = ()

    def attacks(self) -> Iterator[tuple[str, str, Any]]:
        """Argument, name of what is put in its place, and the value."""
        for name in self.good.keys() - set(self.spared):
            for label, value in hostile(self.good[name]):
                yield name, label, value

    def attacks_on_two(self) -> Iterator[tuple[tuple[str, str], dict[str, Any]]]:
        """Every pair of arguments, each with a few values of all kinds in its place."""
        exposed = sorted(self.good.keys() - set(self.spared))
        for first, second in itertools.combinations(exposed, 2):
            for (a, x), (b, y) in itertools.product(FEW.items(), FEW.items()):
                yield (f"{first} = {a}", f"{second} = {b}"), {first: x, second: y}


Row = tuple[Iterable[Target], str, Iterable[Any], str]
"""What refuses an argument, its name, its wrong values, and the sentence as an expression."""
Refusal = tuple[Target, str, Any, type[Exception], str]


def refusals(error: type[Exception], table: Iterable[Row]) -> list[Refusal]:
    """Each target and each value of every row on its own, with the exact class of the error."""
    return [
        (target, name, value, error, said)
        for targets, name, values, said in table
        for target in targets
        for value in values
    ]


def complaint(target: Target, wrong: Mapping[str, Any]) -> str | None:
    """What is wrong with the outcome of one call with these arguments; None where nothing is."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            answer = target.call(**{**target.good, **wrong})
    except SimulationDiverged:
        return None
    except Exception as error:
        return _strange(error, target.good)
    if any(is_masked(value) for name, value in wrong.items() if name not in target.gaps):
        return "took masked numbers for data"
    return next(_not_finite("answer", answer), None)


def complaints(target: Target) -> tuple[int, list[str]]:
    """How many calls were made of one target, and what went wrong: one argument, then two."""
    wrong = {f"{name} = {label}": {name: value} for name, label, value in target.attacks()}
    wrong |= {" and ".join(label): value for label, value in target.attacks_on_two()}
    found = {label: complaint(target, values) for label, values in wrong.items()}
    return len(found), [f"{label}: {what}" for label, what in found.items() if what]


def unattacked(
    package: ModuleType, targets: Mapping[str, Target], trusted: Iterable[str]
) -> list[str]:
    """Parameters of a package's public functions, classes and methods that no target attacks.

    Args:
        package: The package.
        targets: By names whose first word is what they call, as it is reached from the package.
        trusted: What is left out: results that the package alone makes, and what it alone calls.
    """
    attacked = defaultdict[str, set[str]](set)
    for name, target in targets.items():
        attacked[name.split()[0]] |= set(target.good)
    return [
        f"{name}({parameter})"
        for name, parameters in _public(package)
        for parameter in parameters
        if name not in set(trusted) and parameter not in attacked[name]
    ]


def _public(package: ModuleType) -> Iterator[tuple[str, list[str]]]:
    """Names and parameters; protocols, errors and enumerations are made by nobody."""
    for name, value in vars(package).items():
        if name.startswith("_") or not inspect.getmodule(value) or not callable(value):
            continue
        if inspect.isclass(value):
            if getattr(value, "_is_protocol", False) or issubclass(value, Exception | Enum):
                continue
            for method, function in vars(value).items():
                if inspect.isfunction(function) and (method == "__call__" or method[0] != "_"):
                    label = name if method == "__call__" else f"{name}.{method}"
                    yield label, list(inspect.signature(function).parameters)[1:]
        elif not inspect.isfunction(value):
            continue
        kinds = inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL
        parameters = inspect.signature(value).parameters.values()
        yield name, [each.name for each in parameters if each.kind not in kinds]


def _strange(error: Exception, names: Iterable[str]) -> str | None:
    text = str(error)
    named = "must" in text and any(re.search(rf"\b{name}\b", text) for name in names)
    if type(error) in (*HARD, ModelError) and "\n" not in text:
        return None
    if type(error) not in OUR_ERRORS or not named or "\n" in text or len(text) > 300:
        return f"raised {type(error).__name__}: {text[:200]!r}"
    return None


def _not_finite(path: str, value: Any) -> Iterator[str]:
    """Where an answer holds NaN or infinity; gaps are infinite where no threshold is near."""
    if isinstance(value, np.ndarray | np.generic | float):
        array = np.asarray(value)
        if array.dtype.kind not in "fc" or not array.size:
            return
        unbounded = path.endswith(("gap", "worst_gain"))
        if np.isnan(array).any() or (np.isinf(array).any() and not unbounded):
            yield f"returned {path} = {array.reshape(-1)[~np.isfinite(array.reshape(-1))][0]}"
    elif isinstance(value, mujoco.MjModel | mujoco.MjData | Enum | str):
        return
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from _not_finite(f"{path}.{field.name}", getattr(value, field.name))
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _not_finite(f"{path}.{key}", item)
    elif isinstance(value, list | tuple):
        yield from itertools.chain.from_iterable(
            _not_finite(f"{path}[{k}]", item) for k, item in enumerate(value)
        )
