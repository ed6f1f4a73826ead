"""Which differences of two results are more than noise: the rule, and what it is based on.

* An entry that states its own spread, from the 5th to the 95th percentile of repeated timings or
  bounds of 95 % confidence, has changed where both ranges have nothing in common.
* Under the same seed and settings a study repeats its numbers: more than :data:`REPEATED` of a
  number is a change. Other processors differ by 1e-8 at most (docs/runs.md).
* Under another seed or settings it is more than :data:`ANOTHER_DRAW`, and more than
  :data:`OF_LARGEST` of the largest number of this name in any entry (docs/find.md).
* Rows of a dataset that are drawn otherwise are two samples: a column has changed where the test of
  Mann, Whitney and Wilcoxon says so, at a level of :data:`LEVEL` for all columns together.
* Where numbers are times, or summarize rows that are drawn otherwise, no others are compared.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isinf
from typing import Any

from argument_checks.ties import ascending
from experiments.study.differences import ABSENT, Pair, pairs

REPEATED, ANOTHER_DRAW, OF_LARGEST, LEVEL = 1e-6, 0.05, 0.01, 0.01

SETTINGS = (
    *("seed", "duration_s", "configuration", "jacobian", "bench", "rules", "dither", "robot"),
    *("simulated_s", "rounds"),
)
"""What a result is drawn and computed with."""

ORIGIN = ("versions", "model_sha256", "machine", "basis")
"""What it was computed by; the basis of a dataset has both."""

_DRAWN = ("flights", "events", "design", "seed", "robot", "quick", "turn_s", "dither")
"""Of a basis: what the rows are drawn from."""


@dataclass(frozen=True)
class Difference:
    """Two results of a study.

    Attributes:
        settings: In which they differ, or what they were computed by.
        drawn: Whether settings or the seed differ, not what computed them alone.
        changed: By more than noise, the largest change first.
        compared: How many were compared.
        absent: What only one of them has.
    """

    settings: list[Pair]
    drawn: bool
    changed: list[Pair]
    compared: int
    absent: list[Pair]


def difference(a: dict[str, Any], b: dict[str, Any], *, times: bool) -> Difference:
    """How two results differ; `times`: their numbers are times of a machine."""
    about, results = list[Pair](), list[Pair]()
    for pair in pairs(a, b):
        if pair.place[0] in (*SETTINGS, *ORIGIN):
            about.append(pair)
        elif pair.place[-1] != "seed":  # it is in entries as well
            results.append(pair)
    settings = [pair for pair in about if pair.size > 0 and not _is_said(pair)]
    drawn = any(_is_drawn(pair) for pair in settings)
    rows = drawn and "dataset" in a
    chosen = [pair for pair in results if pair.bounds or not (times or rows)]
    absent = [pair for pair in results if ABSENT in (pair.a, pair.b)]
    compared = [pair for pair in chosen if ABSENT not in (pair.a, pair.b)]
    largest = dict[str, float]()
    for pair in compared:
        largest[pair.key] = max(largest.get(pair.key, 0.0), pair.largest)
    changed = [each for each in compared if is_more_than_noise(each, drawn, largest[each.key])]
    order = ascending([-pair.size for pair in changed])
    return Difference(settings, drawn, [changed[k] for k in order], len(compared), absent)


def _is_said(pair: Pair) -> bool:
    """Whether a basis repeats what the result says of itself."""
    inner = "".join(pair.place[1:2])
    return pair.place[0] == "basis" and (inner in SETTINGS + ORIGIN or inner.startswith("version"))


def _is_drawn(pair: Pair) -> bool:
    """Whether it is a setting of both; what only one version has changes no draw of the other."""
    if pair.only != "both":
        return False
    if pair.place[0] == "basis":
        return len(pair.place) > 1 and pair.place[1] in _DRAWN
    return pair.place[0] in SETTINGS


def is_more_than_noise(pair: Pair, drawn: bool, largest: float) -> bool:
    """Whether a value has changed, by the rule above; `largest` is of all entries."""
    if pair.bounds and (drawn or pair.times):
        return pair.size > 0 and pair.is_disjoint
    if not drawn:
        return pair.size > REPEATED
    if isinf(pair.size):  # no numbers
        return True
    return pair.size > ANOTHER_DRAW and pair.size * pair.largest >= OF_LARGEST * largest


@dataclass(frozen=True)
class Shift:
    """A column of two samples of rows.

    Attributes:
        name: Of the column.
        medians: In each of the samples.
        p: Probability of such a difference, or a larger one, of two samples of one distribution.
        counts: Rows that have a number.
    """

    name: str
    medians: tuple[float, float]
    p: float
    counts: tuple[int, int]


def shifts(a: Any, b: Any) -> tuple[list[Shift], int]:
    """Columns that differ by more than two samples do, the surest first; how many were tested.

    Args:
        a: Rows (pyarrow.Table) of one result.
        b: Of the other.
    """
    tested = list(_tested(a, b))
    found = [each for each in tested if each.p < LEVEL / len(tested)]
    return [found[k] for k in ascending([each.p for each in found])], len(tested)


def _tested(a: Any, b: Any) -> Iterator[Shift]:
    import numpy as np
    import pyarrow as pa
    from scipy.stats import mannwhitneyu

    for name in (each for each in a.column_names if each in b.column_names and each != "case"):
        kinds = [table[name].type for table in (a, b)]
        if not all(pa.types.is_floating(k) or pa.types.is_integer(k) for k in kinds):
            continue
        x, y = (np.asarray(table[name].drop_null().to_numpy(), dtype=float) for table in (a, b))
        x, y = x[~np.isnan(x)], y[~np.isnan(y)]
        if min(len(x), len(y)) and np.ptp(np.concatenate([x, y])) > 0:
            p = float(mannwhitneyu(x, y).pvalue)
            yield Shift(name, (float(np.median(x)), float(np.median(y))), p, (len(x), len(y)))


def grouped(changed: Sequence[Pair]) -> list[tuple[Pair, int]]:
    """The largest change of each quantity, and in how many more entries it has changed."""
    first = dict[str, Pair]()
    many = dict[str, int]()
    for pair in changed:
        first.setdefault(pair.key, pair)
        many[pair.key] = many.get(pair.key, -1) + 1
    return [(pair, many[key]) for key, pair in first.items()]
