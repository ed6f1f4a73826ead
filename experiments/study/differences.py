"""Two results of one study, number by number: what differs, by names that a person reads."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from math import inf, isfinite
from typing import Any, TypeGuard


class Absent:
    """What one of two results does not have."""

    def __str__(self) -> str:
        return "nothing"


ABSENT = Absent()

NOT_COMPARED = ("experiment", "files", "dataset", "took", "recording", "data")
"""Names of files, and how long it took."""

SENTENCE = 40
"""Longer texts are sentences, made of the numbers that are compared."""

SMALLEST, LARGEST = 1e-9, 1e9
"""A number below the one, or above the other, is round-off or its reciprocal."""


@dataclass(frozen=True)
class Pair:
    """A value in both results, or in one of them.

    Attributes:
        place: Keys of objects and labels of entries on the way to it.
        labels: How many of these come before the keys in the last entry of a list.
        a: In the first, or `ABSENT`.
        b: In the second, likewise.
        bounds: Of either entry that states its own spread: lower and upper bounds.
        times: Whether these are of repeated timings.
    """

    place: tuple[str, ...]
    labels: int
    a: Any
    b: Any
    bounds: tuple[tuple[float, float], tuple[float, float]] | None = None
    times: bool = False

    @property
    def key(self) -> str:
        """Its keys within the last entry."""
        return ".".join(self.place[self.labels :])

    @property
    def name(self) -> str:
        """They, and the entry: "alpha_rms_urad of W_b"."""
        return f"{self.key} of {self.place[self.labels - 1]}" if self.labels else self.key

    @property
    def full_name(self) -> str:
        """With all that it is in."""
        return f"{self.key} of {', '.join(self.place[: self.labels])}" if self.labels else self.key

    @property
    def only(self) -> str:
        """Which of them has it, where only one does."""
        return "first" if self.b is ABSENT else "second" if self.a is ABSENT else "both"

    @property
    def largest(self) -> float:
        """The larger size of both numbers; 0 if they are none."""
        both = is_number(self.a) and is_number(self.b)
        return max(abs(self.a), abs(self.b)) if both else 0.0

    @property
    def size(self) -> float:
        """The change over the larger of both numbers, from 0 to 2; infinite if they are no numbers.

        Zero for two numbers that are round-off.
        """
        if not (is_number(self.a) and is_number(self.b)):
            return 0.0 if _same(self.a, self.b) else inf
        most = self.largest
        if self.a == self.b or most < SMALLEST or min(abs(self.a), abs(self.b)) > LARGEST:
            return 0.0
        return abs(self.b - self.a) / most if isfinite(most) else inf

    @property
    def is_disjoint(self) -> bool:
        """Whether the entries' own bounds have nothing in common."""
        assert self.bounds is not None
        (low, high), (its_low, its_high) = self.bounds
        return its_low > high or its_high < low


def is_number(value: Any) -> bool:
    """Whether it is one; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, str) and isinstance(b, str) and max(len(a), len(b)) > SENTENCE:
        return True
    return type(a) is type(b) and (a == b or (a != a and b != b))


def pairs(a: Any, b: Any) -> Iterator[Pair]:
    """All values of two results beside each other, whatever the order of entries in a list."""
    return _pairs(a, b, Pair((), 0, a, b))


def _pairs(a: Any, b: Any, at: Pair) -> Iterator[Pair]:
    if isinstance(a, dict) and isinstance(b, dict):
        bounds = _bounds(a, b)
        for key in dict.fromkeys((*a, *b)):
            if key not in NOT_COMPARED and not (bounds and key in bounds[0]):
                one, other = a.get(key, ABSENT), b.get(key, ABSENT)
                inner = replace(at, place=(*at.place, key), a=one, b=other)
                if bounds:
                    inner = replace(inner, bounds=bounds[1], times=bounds[0][0].startswith("p5"))
                yield from _pairs(one, other, inner)
    elif entries(a) and entries(b):
        (own, its), depth = labelled(a, b), len(at.place) + 1
        for label in dict.fromkeys((*own, *its)):
            one, other = own.get(label, ABSENT), its.get(label, ABSENT)
            yield from _pairs(one, other, Pair((*at.place, label), depth, one, other))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        *before, last = at.place or ("",)
        for k, (one, other) in enumerate(zip(a, b, strict=True)):
            inner = replace(at, place=(*before, f"{last}[{k}]"), a=one, b=other)
            yield from _pairs(one, other, inner)
    else:
        yield at


def entries(value: Any) -> TypeGuard[list[dict[str, Any]]]:
    """Whether it is a list of objects."""
    return isinstance(value, list) and all(isinstance(each, dict) for each in value)


def labelled(
    a: Sequence[Mapping[str, Any]], b: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Entries of two lists by labels: the values of the fewest first keys that tell them apart.

    Those keys are of words and numbers, in the order of the first entry; where they tell nothing
    apart, or the lists have no key in common, entries are labelled by their places.
    """
    own, its = ([dict(_scalars(each)) for each in one] for one in (a, b))
    common = [key for key in (own or its or [{}])[0] if all(key in each for each in own + its)]
    for many in range(1, len(common) + 1):
        labels, others = (
            [", ".join(_word(each[key]) for key in common[:many]) for each in one]
            for one in (own, its)
        )
        if len(set(labels)) == len(own) and len(set(others)) == len(its):
            return dict(zip(labels, a, strict=True)), dict(zip(others, b, strict=True))
    places = (f"entry {k}" for k in count(1)), (f"entry {k}" for k in count(1))
    return dict(zip(places[0], a, strict=False)), dict(zip(places[1], b, strict=False))


def _scalars(entry: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Words, numbers, and truth values of an entry, those of objects in it among them."""
    for key, value in entry.items():
        if isinstance(value, dict):
            yield from _scalars(value, f"{before}{key}.")
        elif value is None or isinstance(value, str | int | float):
            yield f"{before}{key}", value


def _word(value: Any) -> str:
    return f"{value:g}" if is_number(value) else str(value)


def _bounds(a: dict[str, Any], b: dict[str, Any]) -> tuple[tuple[str, str], Any] | None:
    """Keys and values of the bounds that two entries state of their numbers; None if they do not.

    From the 5th to the 95th percentile of repeated timings, or of 95 % confidence.
    """
    for key in a:
        for low, high in (("p5", "p95"), ("low", "high")):
            if key.startswith(low) and (upper := high + key.removeprefix(low)) in a:
                found = tuple((each.get(key), each.get(upper)) for each in (a, b))
                if all(is_number(bound) for pair in found for bound in pair):
                    return (key, upper), found
    return None


def unambiguous(found: Sequence[Pair]) -> list[str]:
    """A name of each: the short one where no other has it."""
    many = Counter(each.name for each in found)
    return [each.name if many[each.name] == 1 else each.full_name for each in found]
