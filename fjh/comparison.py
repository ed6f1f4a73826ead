"""Two results of a study: what differs by more than noise."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import mannwhitneyu

from fjh.result_frames import is_table, runs_of
from fjh.study.errors import WrongInput
from fjh.study.untrusted_files import read_json

REPEATED, RESAMPLED, OF_LARGEST, LEVEL = 1e-6, 0.05, 0.01, 0.01
"""What noise is, see :func:`compare`."""
SMALLEST, LARGEST, SENTENCE = 1e-9, 1e9, 40
"""Smaller numbers are round-off, larger ones its reciprocals; longer words are sentences."""
ORIGIN = {"versions", "model_sha256", "machine", "basis", "took"}
SETTINGS = {"seed", "duration_s", "configuration", "jacobian", "bench", "rules", "dither", "robot"}
"""Settings of results that do not list theirs."""
SAMPLING_KEYS = {"flights", "events", "design", "seed"}
"""What rows of a dataset are drawn from, of its basis."""
NOT_COMPARED = {"experiment", "files", "dataset", "recording", "data", "checks", "settings"}
ABSENT, PRINTED = "absent", 15


@dataclass(frozen=True)
class Comparison:
    """How two results of a study differ; the frames have the columns place, a, b.

    Attributes:
        study: Its name.
        settings: Settings and versions that differ.
        drawn: Whether the runs were drawn otherwise: by another seed or other settings.
        changed: Values that changed by more than noise, the largest change first, and the change
            as a part of the larger value.
        compared: How many values were compared.
        absent: Values that one of them has alone.
        failing: Checks that fail in the second and did not in the first: what, where, value, limit.
    """

    study: str
    settings: pd.DataFrame
    drawn: bool
    changed: pd.DataFrame
    compared: int
    absent: pd.DataFrame
    failing: pd.DataFrame

    def __str__(self) -> str:
        """The comparison in Markdown."""
        headings = {
            "settings differ": self.settings,
            f"of {self.compared} values changed by more than noise": self.changed,
            "values are in one of them alone": self.absent,
            "checks fail that did not": self.failing,
        }
        parts = [f"**{self.study}**"]
        for heading, frame in headings.items():
            parts.append(f"{len(frame)} {heading}{':' if len(frame) else '.'}")
            if len(frame):
                text = frame.head(PRINTED).to_string(index=False, max_colwidth=60)
                more = f"\n... and {len(frame) - PRINTED} more" * (len(frame) > PRINTED)
                parts.append(f"```text\n{text}{more}\n```")
        return "\n\n".join(parts)


def compare(a: Path | str, b: Path | str) -> Comparison:
    """Compare two results of one study, each a folder or a JSON file.

    Noise is, where the settings are the same, 1e-6 of a number: a study repeats its numbers, and
    other processors differ by 1e-8. Under another seed or other settings it is 5 % of a number and
    1 % of the largest of its name; of a rate with stated bounds of 95 % confidence, that
    both ranges have something in common; and of the rows of a dataset, column by column, that the
    test of Mann, Whitney and Wilcoxon cannot tell two samples apart, at 1 % for all columns
    together. Numbers below 1e-9 are round-off; sentences are not compared.

    Raises:
        WrongInput: One of them is no result of a study, or both are of different studies.
    """
    (first, one), (second, other) = _result(Path(a)), _result(Path(b))
    study = one["experiment"]
    if study != other["experiment"]:
        raise WrongInput(f"{a} is of fjh {study}, {b} of fjh {other['experiment']}")
    try:
        pairs = list(_pairs(one, other, ()))
    except RecursionError:
        raise WrongInput(f"{a} or {b} is nested too deeply") from None
    found = pd.DataFrame(pairs, columns=["path", "a", "b", "disjoint"])
    top, inner, name = (found.path.str[k] for k in (0, 1, -1))
    found.insert(0, "place", found.path.map(".".join))
    found["change"] = [_change(x, y) for x, y in zip(found.a, found.b, strict=True)]
    settings = {*one.get("settings", SETTINGS), *other.get("settings", SETTINGS)} - ORIGIN
    is_about = top.isin(settings | ORIGIN) | (name == "seed")
    is_absent = found.a.eq(ABSENT) | found.b.eq(ABSENT)
    is_draw = top.isin(settings) | (top.eq("basis") & inner.isin(SAMPLING_KEYS))
    # A setting that only one version has is no other draw.
    drawn = bool((is_draw & found.change.gt(0) & ~is_absent).any())
    has_bounds = found.disjoint.notna() & drawn
    compared = ~is_about & ~is_absent
    if drawn and "dataset" in one:
        compared &= has_bounds
    size = found[["a", "b"]].map(lambda each: abs(each) if _is_number(each) else 0.0).max(axis=1)
    beyond = found.change > REPEATED
    if drawn:
        largest = size.where(compared, 0.0).groupby(name).transform("max")
        moved = found.change.replace(np.inf, 1.0) * size
        is_word = found.change == np.inf
        beyond = (found.change > RESAMPLED) & ((moved >= OF_LARGEST * largest) | is_word)
    apart = found.disjoint.eq(True) & found.change.gt(0)
    changed = found[compared & apart.where(has_bounds, beyond)]
    count = int(compared.sum())
    if drawn and "dataset" in one:
        medians, tested = shifted(runs_of(first, one), runs_of(second, other))
        changed, count = pd.concat([changed, medians]), count + tested
    changed = changed.sort_values("change", ascending=False, kind="stable")
    columns = ["place", "a", "b"]
    return Comparison(
        study,
        found.loc[is_about & found.change.gt(0), columns],
        drawn,
        changed[[*columns, "change"]],
        count,
        found.loc[is_absent & ~is_about, columns],
        _failing(one, other),
    )


def _result(place: Path) -> tuple[Path, dict[str, Any]]:
    """Folder and contents of a result."""
    for file in sorted(place.glob("*.json")) if place.is_dir() else [place]:
        content = read_json(file)
        if isinstance(content, dict) and isinstance(content.get("experiment"), str):
            return file.parent, content
    raise WrongInput(f"{place} is no result of a study")


def _pairs(a: Any, b: Any, path: tuple[str, ...], disjoint: bool | None = None) -> Iterator[Any]:
    """Path and both values of all numbers and words; and whether their stated ranges are apart."""
    if is_table(a) and is_table(b):
        a, b = _labelled(a, b)
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        a, b = ({str(k): each for k, each in enumerate(one)} for one in (a, b))
    if not (isinstance(a, dict) and isinstance(b, dict)):
        yield path, a, b, disjoint
        return
    apart, bounds = _disjoint_ranges(a, b)
    for key in dict.fromkeys((*a, *b)):
        if key not in NOT_COMPARED | bounds:
            whose = next((each for each in apart if key in (f"{each}rate", f"{each}count")), "")
            own = apart.get(whose)
            yield from _pairs(a.get(key, ABSENT), b.get(key, ABSENT), (*path, key), own)


def _labelled(a: list[dict[str, Any]], b: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of two tables by the values of the fewest first columns that tell them apart."""
    keys = [key for key in a[0] if all(key in each for each in a + b)]
    for many in range(1, len(keys) + 1):
        names = [[", ".join(str(row[k]) for k in keys[:many]) for row in one] for one in (a, b)]
        found = [dict(zip(own, one, strict=True)) for own, one in zip(names, (a, b), strict=True)]
        if [len(found[0]), len(found[1])] == [len(a), len(b)]:
            return found
    return [{str(k): row for k, row in enumerate(one)} for one in (a, b)]


def _disjoint_ranges(a: dict[str, Any], b: dict[str, Any]) -> tuple[dict[str, bool], set[str]]:
    """Whether the ranges that two entries state have nothing in common; and the keys of these.

    A range is that of `NAME_rate` and `NAME_count`, by what its keys begin with, or of all.
    """
    apart, bounds = dict[str, bool](), set[str]()
    for lower in [key for key in a if "_low" in f"_{key}"]:
        name, _, end = lower.rpartition("low")
        keys = lower, f"{name}high{end}"
        if all(_is_number(each.get(key)) for key in keys for each in (a, b)):
            apart[name] = b[keys[0]] > a[keys[1]] or b[keys[1]] < a[keys[0]]
            bounds |= {*keys}
    return apart, bounds


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _change(a: Any, b: Any) -> float:
    """The change over the larger of two numbers; infinite where words differ."""
    if _is_number(a) and _is_number(b):
        size = max(abs(a), abs(b))
        is_round_off = size < SMALLEST or min(abs(a), abs(b)) > LARGEST
        return 0.0 if a == b or is_round_off else abs(b - a) / size
    is_sentence = isinstance(a, str) and isinstance(b, str) and max(len(a), len(b)) > SENTENCE
    return 0.0 if is_sentence or (type(a) is type(b) and a == b) else np.inf


def shifted(a: pd.DataFrame, b: pd.DataFrame) -> tuple[pd.DataFrame, int]:
    """Medians of columns in which two samples of rows differ; how many columns were tested."""
    rows = []
    for name in [name for name in a.select_dtypes("number") if name in b and name != "case"]:
        x, y = a[name].dropna(), b[name].dropna()
        if min(len(x), len(y)) and np.ptp(np.concatenate([x, y])) > 0:
            medians = float(x.median()), float(y.median())
            p = mannwhitneyu(x, y).pvalue
            rows.append((f"median of {name}", *medians, _change(*medians), p))
    found = pd.DataFrame(rows, columns=["place", "a", "b", "change", "p"])
    return found[found.p < LEVEL / max(len(found), 1)], len(found)


def _failing(a: dict[str, Any], b: dict[str, Any]) -> pd.DataFrame:
    """Checks that fail in the second result and did not in the first."""
    failed = [[check for check in each.get("checks", []) if not check["passed"]] for each in (a, b)]
    before = {(check["what"], check["where"]) for check in failed[0]}
    new = [check for check in failed[1] if (check["what"], check["where"]) not in before]
    return pd.DataFrame(new, columns=["what", "where", "value", "limit"])
