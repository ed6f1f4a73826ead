"""Numbers of a study, each written once: its entry in the JSON, column, check and words follow."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from experiments.study.results import Check
from experiments.study.tables import Column

Entry = Mapping[str, Any]
Limit = float | Callable[[Entry], float | None]
"""A number, or what gives it for an entry; None: the entry is not checked."""


@dataclass(frozen=True)
class Quantity:
    """One number of a study; it is None where it does not apply, and not checked there.

    Attributes:
        key: In the JSON, with its unit.
        of: The number, from what the study measured.
        words: For checks and sentences; a field such as `{:.3f}` takes the number.
        heading: Of its column; None: it has none.
        format: Of its cells, or a function of the number that makes them.
        below: What it must stay below.
        agrees_with: Key of another quantity, which it must equal.
        within: Largest relative difference from that one.
    """

    key: str
    of: Callable[[Any], Any]
    words: str = ""
    heading: str | None = None
    format: str | Callable[[Any], str] = ""
    below: Limit | None = None
    agrees_with: str | None = None
    within: Limit | None = None

    def said(self, entry: Entry) -> str:
        """Its words, with its number of this entry."""
        return self.words.format(entry[self.key])


def of_each(names: Sequence[str], *quantities: Quantity) -> tuple[Quantity, ...]:
    """The quantities of each component in turn; its name takes the place of each `*`.

    Their `of` gives all components in one array or tuple, or None.
    """
    return tuple(_component(each, name, k) for k, name in enumerate(names) for each in quantities)


def _component(all_of_them: Quantity, name: str, k: int) -> Quantity:
    def component(source: Any) -> Any:
        values = all_of_them.of(source)
        return None if values is None else values[k]

    texts = {
        field: text.replace("*", name)
        for field in ("key", "words", "heading", "agrees_with")
        if (text := getattr(all_of_them, field)) is not None
    }
    return replace(all_of_them, of=component, **texts)


def entry_of(quantities: Iterable[Quantity], source: Any) -> dict[str, Any]:
    """What goes into the JSON."""
    return {each.key: each.of(source) for each in quantities}


def columns_of(quantities: Iterable[Quantity]) -> list[Column]:
    """Columns of the quantities that have a heading."""
    return [
        Column(each.heading, each.key, each.format)
        for each in quantities
        if each.heading is not None
    ]


def checks_of(quantities: Iterable[Quantity], entry: Entry, where: str) -> list[Check]:
    """Checks of an entry, to which a study adds what its limits depend on.

    Raises:
        KeyError: The entry lacks a number that is checked or agreed with.
    """
    by_key, found = {each.key: each for each in quantities}, []
    for each in by_key.values():
        found += _below(each, entry, where)
        if each.agrees_with is not None:
            found += _agreement(each, by_key[each.agrees_with], entry, where)
    return found


def _below(quantity: Quantity, entry: Entry, where: str) -> list[Check]:
    limit = _limit(quantity.below, entry)
    if limit is None or (value := entry[quantity.key]) is None:
        return []
    return [Check(quantity.said(entry), where, value, limit)]


def _agreement(quantity: Quantity, other: Quantity, entry: Entry, where: str) -> list[Check]:
    value, expected = entry[quantity.key], entry[other.key]
    limit = _limit(quantity.within, entry)
    if limit is None or value is None or expected is None:
        return []
    what = f"relative difference between {quantity.said(entry)} and {other.said(entry)}"
    return [Check(what, where, abs(value - expected) / abs(expected), limit)]


def _limit(limit: Limit | None, entry: Entry) -> float | None:
    return limit(entry) if callable(limit) else limit
