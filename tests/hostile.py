"""Attack every public argument: each call gives one sentence that names it, or finite numbers."""

import dataclasses
import inspect
import itertools
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from argument_checks import is_masked
from tests.profiles import examples


def label(value: Any) -> str:
    return repr(value)[:20]


ANYWHERE = [
    *(None, "text", b"1", object(), len, {"a": 1}, {0.5}, [None], ["a", "b"], [[1.0, 2.0], [3.0]]),
    *([0, [1, 2]], np.datetime64("2003-01-01")),
    *(True, 1j, np.nan, np.inf, -np.inf, -1, 0.5, 2.0, -0.5, 0.0, 5e-324, 1e-310, 1e-160, 1e160),
    *(1e308, 2**70, 10**400),
    *([], [[]], [1.0], np.ones(2, dtype=bool), [-1], [2**62], [0.5], np.array([object()])),
    *(np.zeros((1, 1, 1, 1, 1)), np.zeros((0, 3)), np.ones(99), [np.ma.masked, 1.0]),
    np.ones((1, 1)).view(np.matrix),  # it once ended the process as a seed
]
"""Values that replace any argument."""
FEW = (None, "text", np.nan, -1, np.ones(99))
THIN = {
    *map(label, (*FEW, [], object(), 0.0, 1e308, [np.ma.masked, 1.0])),
    *("as bools", "masked", "with inf", "scaled by -1", "a row more", "a batch of two"),
}
"""Names of one value of each kind."""
SCALES = (0.0, -1.0, 5e-324, 1e-310, 1e-308, 1e-200, 1e-160, 1e-100, 1e100, 1e160, 1e300)
POSITIVE = (5e-324, np.inf)
PLANTED = (np.nan, np.inf, 1e308, 1e160, 5e-324, 1e-310, 1j)


def hostile(good: Any) -> Iterator[tuple[str, Any]]:
    """Yield replacements of a valid value, each with its name."""
    for value in ANYWHERE:
        if not (callable(good) and callable(value)):  # functions may raise any error
            yield label(value), value
    if isinstance(good, float):
        yield from ((f"scaled by {factor:g}", good * factor) for factor in SCALES)
    if isinstance(good, np.ndarray) and good.dtype == float and good.size:
        yield from _bent(good)
    if isinstance(good, tuple) and all(isinstance(each, np.ndarray) for each in good):
        for number in (*PLANTED, -np.inf):  # limits that no number satisfies
            yield f"all {number}", tuple(np.full(each.shape, number) for each in good)


def _bent(good: np.ndarray) -> Iterator[tuple[str, Any]]:
    """Yield modified copies of a valid array: scaled, with one bad number, other shapes, masked."""
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


Wrong = dict[str, tuple[str, Any]]
"""Arguments, each with the name of its hostile value, and the value."""


class Target(NamedTuple):
    """Callable with valid arguments, of which those with these names are attacked."""

    label: str
    call: Callable[..., Any]
    good: Mapping[str, Any]
    names: Sequence[str]

    def values(self, name: str, *, thin: bool) -> list[tuple[str, Any]]:
        """Return all hostile values of an argument, or one of each kind."""
        return [each for each in hostile(self.good[name]) if not thin or each[0] in THIN]

    def ones(self, *, thin: bool) -> Iterator[Wrong]:
        """Yield each argument in turn."""
        return ({name: each} for name in self.names for each in self.values(name, thin=thin))

    def twos(self) -> Iterator[Wrong]:
        """Yield every pair of arguments, each with a few values of all kinds."""
        for first, second in itertools.combinations(self.names, 2):
            for one, other in itertools.product(FEW, FEW):
                yield {first: (label(one), one), second: (label(other), other)}

    def sample(self, data: st.DataObject) -> Wrong:
        """Sample any two arguments with one value of each kind."""
        pair = data.draw(st.sampled_from(list(itertools.combinations(self.names, 2))))
        return {name: data.draw(st.sampled_from(self.values(name, thin=True))) for name in pair}


Callables = dict[str, tuple[Callable[..., Any], type | None]]
"""Callables by name, each with the class that it is a method of."""


def public(*places: Any, trusted: Iterable[str] = ()) -> Callables:
    """Return the public callables of modules and given ones, without protocols, errors, enums."""
    result: Callables = {}
    for place in places:
        if isinstance(place, ModuleType):
            values = [value for name, value in vars(place).items() if name[0] != "_"]
            result |= public(*(value for value in values if isinstance(value, type | FunctionType)))
        elif not isinstance(place, type):
            result[place.__name__] = place, None
        elif not issubclass(place, Exception | Enum) and not getattr(place, "_is_protocol", False):
            result[place.__name__] = place, None
            for name, value in inspect.getmembers(place, inspect.isroutine):
                if name == "__call__" or name[0] != "_":
                    static = inspect.getattr_static(place, name)
                    owner = place if isinstance(static, FunctionType) else None
                    if isinstance(getattr(value, "__func__", value), FunctionType):
                        result[f"{place.__name__}.{name}"] = value, owner
    result = {name: function for name, function in result.items() if _parameters(*function)}
    unknown = set(trusted) - set(result)
    assert not unknown, f"trusted, but missing: {sorted(unknown)}"
    return {name: result[name] for name in result if name not in set(trusted)}


def _parameters(function: Callable[..., Any], owner: type | None) -> dict[str, Any]:
    """Return the defaults of the parameters by name, `empty` for required ones."""
    parameters = list(inspect.signature(function).parameters.values())[owner is not None :]
    various = inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL
    return {each.name: each.default for each in parameters if each.kind not in various}


@dataclass(frozen=True, kw_only=True)
class Package:
    """Callables of a package that are attacked, with the valid arguments of their calls.

    Attributes:
        callables: Attacked callables.
        good: Valid values by name of the parameter, in addition to defaults.
        special: Other valid values of a callable; `...` omits an argument, `self` is the object.
            A label of more words is a further set: these values and required ones alone.
        objects: Objects by class whose methods are called, or functions that create them.
        uses: Functions that use a result, by callable or class; without a result, the object.
        errors: Exact classes of errors, since LAPACK's LinAlgError is a ValueError, too.
        unsolvable: Errors for arguments that are valid alone, but have no solution.
        gaps: By label, arguments whose masked numbers count as missing.
        excluded: By label, arguments that are not attacked in this set.
        ranges: Intervals of accepted numbers of a parameter.
        unbounded: Ends of names of numbers that are infinite without a limit.
        slow: Labels of callables that get a few values of each kind in short tests.
    """

    callables: Callables
    good: Mapping[str, Any]
    special: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    objects: Mapping[str, Any] = field(default_factory=dict)
    uses: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    errors: tuple[type[Exception], ...] = (ValueError, TypeError)
    unsolvable: tuple[type[Exception], ...] = ()
    gaps: Mapping[str, Iterable[str]] = field(default_factory=dict)
    excluded: Mapping[str, Iterable[str]] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    unbounded: tuple[str, ...] = ("gap",)
    slow: Iterable[str] = ()

    def targets(self, name: str) -> Iterator[Target]:
        """Yield a callable with each set of valid arguments, which must cover all parameters."""
        parameters = _parameters(*self.callables[name])
        options = "**" in str(inspect.signature(self.callables[name][0]))
        attacked = set[str]()
        for label in [name, *(each for each in self.special if each.startswith(f"{name} "))]:
            given = {**self.special.get(label, {})}
            if label == name and not options:
                given = {each: given[each] for each in given if each in {*parameters, "self"}}
            for each, default in parameters.items():
                if each not in given and (default is inspect.Parameter.empty or label == name):
                    given[each] = self.good.get(each, default)
                    known = {*self.good, *self.excluded.get(label, ())}
                    if default is None or default is inspect.Parameter.empty:
                        assert each in known, f"{name}: no good value of {each}"
            instance = given.pop("self", None)
            good = {each: value for each, value in given.items() if value is not ...}
            names = [each for each in good if each not in self.excluded.get(label, ())]
            attacked |= set(names)
            yield Target(label, self._call(name, instance), good, names)
        missed = set(parameters) - attacked - set(self.excluded.get(name, ()))
        assert not missed, f"{name}: never attacked: {sorted(missed)}"

    def _call(self, name: str, instance: Any) -> Callable[..., Any]:
        function, owner = self.callables[name]

        def call(**arguments: Any) -> Any:
            on = None
            if owner is not None:
                on = self.objects[owner.__name__] if instance is None else instance
                on = on() if isinstance(on, FunctionType) else on
            result = function(**arguments) if owner is None else function(on, **arguments)
            result = on if result is None else result
            for kind in (name, *(base.__name__ for base in type(result).__mro__)):
                if kind in self.uses:
                    return self.uses[kind](result)
            return result

        return call

    def attack(self, name: str, *, pairs: bool = False) -> None:
        """Attack each argument of a callable, and every pair of arguments."""
        complaints = list[str | None]()
        for target in self.targets(name):
            result = target.call(**target.good)  # else no argument would be attacked
            assert not list(self._not_finite(target.label, result))
            thin = target.label in self.slow and not pairs
            wrongs = (*target.ones(thin=thin), *(target.twos() if pairs else ()))
            complaints += [self.complaint(target, wrong) for wrong in wrongs]
        assert not any(complaints), "\n".join(filter(None, complaints))

    def attack_two(self, data: st.DataObject) -> None:
        """Attack any two arguments of any callable."""
        several = [name for name, each in self.callables.items() if len(_parameters(*each)) > 1]
        targets = self.targets(data.draw(st.sampled_from(several)))
        target = data.draw(st.sampled_from([each for each in targets if len(each.names) > 1]))
        assert not (message := self.complaint(target, target.sample(data))), message

    def complaint(self, target: Target, wrong: Wrong) -> str | None:
        """Return what is wrong with the outcome of one call, or None."""
        outcome = self._outcome(target, {name: value for name, (_, value) in wrong.items()})
        values = " and ".join(f"{name} = {label}" for name, (label, _) in wrong.items())
        return f"{target.label}: {values}: {outcome}" if outcome else None

    def _outcome(self, target: Target, wrong: Mapping[str, Any]) -> str | None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                result = target.call(**{**target.good, **wrong})
        except Exception as error:
            return self._unexpected(error, target.good)
        gaps = self.gaps.get(target.label, ())
        if any(is_masked(value) for name, value in wrong.items() if name not in gaps):
            return "accepted masked numbers as data"
        for name in wrong.keys() & self.ranges.keys():
            low, high = self.ranges[name]
            values = np.asarray(wrong[name], dtype=object).flat
            numbers = [each for each in values if isinstance(each, float | int)]
            if not all(low <= each <= high for each in numbers):
                return f"accepted {name} beyond {low:g}..{high:g}"
        return next(self._not_finite("result", result), None)

    def _unexpected(self, error: Exception, names: Iterable[str]) -> str | None:
        text = str(error)
        listed = "must" in text and any(re.search(rf"\b{name}\b", text) for name in names)
        if type(error) in self.unsolvable and "\n" not in text:
            return None
        if type(error) not in self.errors or not listed or "\n" in text or len(text) > 300:
            return f"raised {type(error).__name__}: {text[:200]!r}"
        return None

    def _not_finite(self, path: str, value: Any) -> Iterator[str]:
        """Yield where a result contains NaN or infinity."""
        if isinstance(value, np.ndarray | np.generic | float):
            array = np.ravel(value)
            wrong = np.isnan if path.endswith(self.unbounded) else lambda x: ~np.isfinite(x)
            if array.dtype.kind in "fc" and wrong(array).any():
                yield f"returned {path} = {array[wrong(array)][0]}"
        elif dataclasses.is_dataclass(value):
            for each in dataclasses.fields(value):
                yield from self._not_finite(f"{path}.{each.name}", getattr(value, each.name))
        elif isinstance(value, Mapping):
            for key, item in value.items():
                yield from self._not_finite(f"{path}.{key}", item)
        elif isinstance(value, list | tuple):
            for k, item in enumerate(value):
                yield from self._not_finite(f"{path}[{k}]", item)


def one_by_one(package: Callable[[], Package], names: Callables) -> Callable[..., None]:
    """Return the test that a hostile argument is reported or harmless; long for all pairs."""
    pairs = [False, pytest.param(True, marks=[pytest.mark.long, pytest.mark.night])]

    @pytest.mark.parametrize("pairs", pairs)
    @pytest.mark.parametrize("name", names)
    def law(name: str, pairs: bool) -> None:
        package().attack(name, pairs=pairs)

    return law


def two_at_once(package: Callable[[], Package]) -> Callable[[], None]:
    """Return the test that two hostile arguments of any kind are reported or harmless."""

    @examples(1000)
    @given(st.data())
    def law(data: st.DataObject) -> None:
        package().attack_two(data)

    return law
