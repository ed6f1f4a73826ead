"""Names of joints and actuators: read from a model, resolved in arguments, listed in sentences."""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Protocol

import numpy as np

import argument_checks as check
from argument_checks import Array, Indices
from argument_checks.ties import ACCURACY, ascending, exceeds

MAX_LISTED = 5
"""Largest number of joints listed in a sentence."""

LEAST_SHARE = 0.1
"""Least share of a joint in directions, relative to the largest share, for it to be listed."""


class HasNames(Protocol):
    """Object with names of velocities and actuators, empty where there is no name."""

    @property
    def velocities(self) -> Sequence[str]: ...
    @property
    def actuators(self) -> Sequence[Sequence[str]]: ...


@dataclass(frozen=True)
class Names:
    """Names in a mechanism of N velocities, n of them active; an empty string is no name.

    Attributes:
        velocities: The joint (or tendon) of each velocity, N strings; the velocities of a ball or
            free joint all have the joint's name.
        actuators: Actuators that drive each active velocity, n tuples of strings, mostly of one.
    """

    velocities: tuple[str, ...]
    actuators: tuple[tuple[str, ...], ...]


Aliases = tuple[tuple[str, ...], ...]
"""Accepted names of each number, with the one used in sentences first."""


def checked_names(names: HasNames, N: int, n: int) -> Names:
    """Return the names as immutable tuples.

    Other names than N strings and n tuples of strings raise a TypeError or ValueError.
    """
    try:
        velocities, actuators = tuple(names.velocities), tuple(map(tuple, names.actuators))
    except (AttributeError, TypeError):
        got = check.short_repr(names)
        raise TypeError(
            f"names must have the lists `velocities` and `actuators`, got {got}"
        ) from None
    if (len(velocities), len(actuators)) != (N, n):
        raise ValueError(
            f"names must have {count_phrase(N, 'velocity', 'velocities')} and "
            f"{count_phrase(n, 'actuator', 'actuators')}, "
            f"got {len(velocities)} and {len(actuators)}"
        )
    lists = not any(isinstance(driving, str) for driving in names.actuators)
    if not lists or not all(isinstance(x, str) for some in (velocities, *actuators) for x in some):
        raise ValueError("names must be strings, and for each active velocity a tuple of strings")
    return Names(velocities, actuators)


def velocity_aliases(names: Names | None, N: int) -> Aliases:
    """Return the names of each velocity: that of its joint, if it has one."""
    return (
        ((),) * N if names is None else tuple((name,) if name else () for name in names.velocities)
    )


def actuator_aliases(names: Names | None, active: Indices) -> Aliases:
    """Return the names of each active velocity: a unique label, its joint, and its actuators.

    Velocities of one joint and the same actuators belong to one actuator, an orientation servo, and
    have the same names.
    """
    if names is None:
        return ((),) * len(active)
    pairs = [
        (names.velocities[i], tuple(filter(None, driving)))
        for i, driving in zip(active, names.actuators, strict=True)
    ]
    names_of = [tuple(filter(None, (joint, *driving))) for joint, driving in pairs]
    # Without an actuator name the velocities of a joint may belong to different actuators.
    servos = [pair if pair[1] else k for k, pair in enumerate(pairs)]
    first = [servos.index(servo) for servo in servos]
    users = Counter(name for k in set(first) for name in set(names_of[k]))
    return tuple(
        tuple(dict.fromkeys((_word(both, k, users), *both))) if both else ()
        for both, k in zip(names_of, first, strict=True)
    )


def _word(names: tuple[str, ...], number: int, users: Counter[str]) -> str:
    """Return the first unique name, else the first name followed by the number."""
    for name in names:
        if users[name] == 1:
            return name
    word = f"{names[0]} ({number})"
    while word in users:
        word += f" ({number})"
    return word


def passive_joints(names: Names | None, active: Indices) -> frozenset[str]:
    """Return the names of the joints of all velocities that are not active."""
    if names is None:
        return frozenset()
    driven = set(active.tolist())
    return frozenset(name for i, name in enumerate(names.velocities) if name and i not in driven)


def resolved_numbers(
    argument: str,
    value: Iterable[int | str],
    aliases: Aliases,
    *,
    several: bool,
    passive: Collection[str] = (),
) -> frozenset[int]:
    """Resolve an argument that lists numbers or names to numbers.

    Args:
        argument: Name of the argument, for errors.
        value: Numbers of range(len(aliases)), and names.
        aliases: Accepted names of each number.
        several: Whether a name may stand for several numbers.
        passive: Names of passive joints, if the argument is about actuators.

    Raises:
        ValueError: A number is out of range, or a name is unknown, ambiguous or of a passive
            joint.
    """
    if isinstance(value, str):
        raise ValueError(f"{argument} must be a list, got {value!r}: write [{value!r}]")
    is_name_array = isinstance(value, np.ndarray) and value.dtype.kind == "U" and value.ndim == 1
    if not isinstance(value, Iterable) or (isinstance(value, np.ndarray) and not is_name_array):
        return _numbers(argument, value, aliases)
    members: list[Any] = list(value)
    numbers = [member for member in members if not isinstance(member, str)]
    names = [member for member in members if isinstance(member, str)]
    by_name = [_resolved(argument, name, aliases, passive, several=several) for name in names]
    return _numbers(argument, numbers, aliases).union(*by_name)


def _numbers(argument: str, value: Any, aliases: Aliases) -> frozenset[int]:
    return frozenset(check.indices(argument, value, len(aliases), distinct=False).tolist())


def _resolved(
    argument: str, name: str, aliases: Aliases, passive: Collection[str], *, several: bool
) -> list[int]:
    """Return the numbers that have this name."""
    matches = [k for k, names in enumerate(aliases) if name in names]
    if matches and (several or len({aliases[k] for k in matches}) == 1):
        return matches  # an actuator may have several velocities, with the same names
    if matches:
        means = joined_names(aliases, matches)
        raise ValueError(f"{argument} must name one actuator, got {name!r}, which means {means}")
    kind = "joints" if several else "actuators or the joints that they drive"
    if name in passive:
        raise ValueError(
            f"{argument} must name {kind}, got the passive joint {name!r}: "
            "if it is stuck, put it in locked_passive"
        )
    everything = list(dict.fromkeys(name for names in aliases for name in names))
    if not everything:
        raise ValueError(
            f"{argument} must be numbers in a mechanism without names, got {name!r}: "
            "give ConstrainedSystem names, or make it with ConstrainedSystem.of"
        )
    near = get_close_matches(name, everything, n=1)
    suggestion = f"the nearest is {near[0]!r}" if near else f"there are {', '.join(everything)}"
    raise ValueError(f"{argument} must name {kind}, got {name!r}: {suggestion}")


def joined_names(aliases: Aliases, numbers: Iterable[int]) -> str:
    """Join names, or numbers without a name: "knee, 3", or "[2, 3]" if there are no names.

    Identical names are listed once.
    """
    listed = list(numbers)
    if not any(aliases[k] for k in listed):
        return str(listed)
    return ", ".join(dict.fromkeys(aliases[k][0] if aliases[k] else str(k) for k in listed))


def involved_joints(basis: Array, aliases: Aliases, accuracy: float = ACCURACY) -> str:
    """List the joints with a noticeable share of an orthonormal basis, the largest share first.

    The text is, for example, "hip, knee and 2 more"; empty if no joint has a name. Rows of the
    basis with the same name belong to one joint; `accuracy` is the relative tolerance of equal
    shares.
    """
    shares: dict[str, float] = {}
    for names, row in zip(aliases, basis, strict=True):
        name = names[0] if names else ""
        shares[name] = float(np.hypot(shares.get(name, 0.0), np.linalg.norm(row)))
    names, sizes = list(shares), np.array(list(shares.values()))
    noticed = ~exceeds(LEAST_SHARE * sizes.max(), sizes, accuracy)
    largest_first = ascending(-sizes, accuracy=accuracy)
    concerned = [names[k] for k in largest_first if noticed[k] and names[k]]
    more = len(concerned) - MAX_LISTED
    return ", ".join(concerned[:MAX_LISTED]) + (f" and {more} more" if more > 0 else "")


def failure_phrases(kind: str, aliases: Aliases, numbers: Iterable[int], failure: str) -> list[str]:
    """Return each failure as text: "knee locked", or "actuator 3 locked" without a name.

    Velocities of one passive joint, or of one actuator, share a name and are listed once.
    """
    labels = (aliases[k][0] if aliases[k] else f"{kind} {k}" for k in sorted(numbers))
    return list(dict.fromkeys(f"{word} {failure}" for word in labels))


def count_phrase(number: int, one: str, several: str) -> str:
    """Return a number of things as text: "1 actuator", "2 actuators"."""
    return f"{number} {one if number == 1 else several}"
