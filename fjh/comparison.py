"""Comparison of two results of a study: differences larger than noise."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import mannwhitneyu

from fjh.result_frames import is_table, runs_of
from fjh.study.errors import WrongInput
from fjh.study.interrupts import printable
from fjh.study.untrusted_files import read_json

REPEATED, RESAMPLED, OF_LARGEST, LEVEL = 1e-6, 0.05, 0.01, 0.01
"""Thresholds above which a relative change or a significance level counts; see :func:`compare`."""
SMALLEST, LARGEST, SENTENCE = 1e-9, 1e9, 40
"""Smallest and largest compared number, and longest compared text; others are round-off, prose."""
ORIGIN = {"versions", "model_sha256", "machine", "basis", "took"}
SETTINGS = {"seed", "duration_s", "configuration", "jacobian", "bench", "rules", "dither", "robot"}
"""Keys of the settings in results of earlier versions, which do not list them."""
SAMPLING_KEYS = {"flights", "events", "design", "seed"}
"""Keys of the basis of a dataset from which its rows are sampled."""
NOT_COMPARED = {"experiment", "files", "dataset", "recording", "data", "checks", "settings"}
ABSENT, VALUES_WIDTH = "absent", 40


@dataclass(frozen=True)
class Comparison:
    """Differences between two results, a and b, of one study; the frames have columns place, a, b.

    Attributes:
        study: Name of the study.
        settings: Settings, versions and machines that differ.
        resampled: Whether the runs have another seed or other settings.
        changed: Values that changed by more than noise, with the change relative to the larger
            value, in descending order.
        compared: Number of compared values.
        absent: Values that only one result has.
        failing: Checks that fail only in the second result: what, where, value, limit.
    """

    study: str
    settings: pd.DataFrame
    resampled: bool
    changed: pd.DataFrame
    compared: int
    absent: pd.DataFrame
    failing: pd.DataFrame

    def __str__(self) -> str:
        """Return the comparison in Markdown, at most 25 lines."""
        headings = {
            "settings differ": self.settings,
            f"of {self.compared} values changed by more than noise": self.changed,
            "values are in only one result": self.absent,
            "checks fail that passed before": self.failing,
        }
        most = 16 // max(1, sum(len(frame) > 0 for frame in headings.values())) - 1
        parts = [f"**{self.study}**"]
        for heading, frame in headings.items():
            lines = [f"{len(frame)} {heading}{':' if len(frame) else '.'}"]
            for row in frame.head(most).to_dict("records"):
                texts = {key: f"{x:.6g}" if _is_number(x) else str(x) for key, x in row.items()}
                form = "{place}\n{a} -> {b}"
                if "what" in texts:
                    form = "{where}: {what}\n{value}, expected below {limit}"
                place, values = (printable(one.format_map(texts)) for one in form.split("\n"))
                values = values[:VALUES_WIDTH]
                cut = len(place) - (79 - len("- : ") - len(values))
                lines.append(f"- {place if cut <= 0 else f'...{place[cut + 3 :]}'}: {values}")
            lines += [f"- {len(frame) - most} more"] * (len(frame) > most)
            parts.append("\n".join(lines))
        return "\n\n".join(parts)


def compare(a: Path | str, b: Path | str) -> Comparison:
    """Compare two results of one study, each a folder or a JSON file; list changes beyond noise.

    With equal settings, relative changes up to 1e-6 are noise: a study on another processor differs
    by 1e-8. With another seed or other settings, noise is a change of at most 5 % of a number, or
    of at most 1 % of the largest number of the same name. A rate with stated 95 % confidence bounds
    has changed if the two ranges are disjoint; a column of a dataset, if the Mann-Whitney U test is
    significant (1 % for all columns together). Numbers below 1e-9 are round-off; sentences are not
    compared.

    Raises:
        WrongInput: An argument is no result of a study, or the results are of different studies.
    """
    (first, one), (second, other) = _result(Path(a)), _result(Path(b))
    study = one["experiment"]
    if study != other["experiment"]:
        raise WrongInput(
            f"results must be of one study, got {a} of {study} and {b} of {other['experiment']}"
        )
    try:
        pairs = list(_pairs(one, other, ()))
    except RecursionError:
        raise WrongInput(f"{a} or {b} is nested too deeply") from None
    values = pd.DataFrame(pairs, columns=["path", "a", "b", "disjoint"])
    top, inner, name = (values.path.str[k] for k in (0, 1, -1))
    values.insert(0, "place", values.path.map(".".join))
    values["change"] = [_change(x, y) for x, y in zip(values.a, values.b, strict=True)]
    settings = {*one.get("settings", SETTINGS), *other.get("settings", SETTINGS)} - ORIGIN
    is_about = top.isin(settings | ORIGIN) | (name == "seed")
    is_absent = values.a.eq(ABSENT) | values.b.eq(ABSENT)
    is_sampling_key = top.isin(settings) | (top.eq("basis") & inner.isin(SAMPLING_KEYS))
    # A setting that only one version has does not change the sample.
    resampled = bool((is_sampling_key & values.change.gt(0) & ~is_absent).any())
    has_bounds = values.disjoint.notna() & resampled
    compared = ~is_about & ~is_absent
    if resampled and "dataset" in one:
        compared &= has_bounds
    size = values[["a", "b"]].map(lambda x: abs(x) if _is_number(x) else 0.0).max(axis=1)
    beyond = values.change > REPEATED
    if resampled:
        largest = size.where(compared, 0.0).groupby(name).transform("max")
        moved = values.change.replace(np.inf, 1.0) * size
        is_text = values.change == np.inf
        beyond = (values.change > RESAMPLED) & ((moved >= OF_LARGEST * largest) | is_text)
    disjoint = values.disjoint.eq(True) & values.change.gt(0)
    changed = values[compared & disjoint.where(has_bounds, beyond)]
    count = int(compared.sum())
    if resampled and "dataset" in one:
        medians, tested = shifted(runs_of(first, one), runs_of(second, other))
        changed, count = pd.concat([changed, medians]), count + tested
    changed = changed.sort_values("change", ascending=False, kind="stable")
    columns = ["place", "a", "b"]
    return Comparison(
        study,
        values.loc[is_about & values.change.gt(0), columns],
        resampled,
        changed[[*columns, "change"]],
        count,
        values.loc[is_absent & ~is_about, columns],
        _failing(one, other),
    )


def _result(place: Path) -> tuple[Path, dict[str, Any]]:
    """Return the folder and the contents of a result, given its folder or JSON file."""
    for file in sorted(place.glob("*.json")) if place.is_dir() else [place]:
        content = read_json(file)
        if isinstance(content, dict) and isinstance(content.get("experiment"), str):
            return file.parent, content
    raise WrongInput(f"{place} must be a JSON file of a study's results, or a folder with one")


def _pairs(a: Any, b: Any, path: tuple[str, ...], disjoint: bool | None = None) -> Iterator[Any]:
    """Yield path, both values, and disjointness of confidence ranges for each number and text.

    The disjointness is None for values without a range.
    """
    if is_table(a) and is_table(b):
        a, b = _labelled(a, b)
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        a, b = ({str(k): entry for k, entry in enumerate(one)} for one in (a, b))
    if not (isinstance(a, dict) and isinstance(b, dict)):
        yield path, a, b, disjoint
        return
    ranges, bounds = _disjoint_ranges(a, b)
    for key in dict.fromkeys((*a, *b)):
        if key not in NOT_COMPARED | bounds:
            name = next((name for name in ranges if key in (f"{name}rate", f"{name}count")), "")
            of_key = ranges.get(name)
            yield from _pairs(a.get(key, ABSENT), b.get(key, ABSENT), (*path, key), of_key)


def _labelled(a: list[dict[str, Any]], b: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return both tables by row labels, made of the fewest first columns that are unique."""
    keys = [key for key in a[0] if all(key in row for row in a + b)]
    for count in range(1, len(keys) + 1):
        names = [[", ".join(str(row[k]) for k in keys[:count]) for row in one] for one in (a, b)]
        tables = [dict(zip(of, one, strict=True)) for of, one in zip(names, (a, b), strict=True)]
        if [len(tables[0]), len(tables[1])] == [len(a), len(b)]:
            return tables
    return [{str(k): row for k, row in enumerate(one)} for one in (a, b)]


def _disjoint_ranges(a: dict[str, Any], b: dict[str, Any]) -> tuple[dict[str, bool], set[str]]:
    """Return whether each confidence range is disjoint in two entries, and the keys of all bounds.

    The keys NAME_low and NAME_high bound NAME_rate and NAME_count; low and high bound all entries.
    """
    disjoint, bounds = dict[str, bool](), set[str]()
    for lower in [key for key in a if "_low" in f"_{key}"]:
        name, _, end = lower.rpartition("low")
        keys = lower, f"{name}high{end}"
        if all(_is_number(entry.get(key)) for key in keys for entry in (a, b)):
            disjoint[name] = b[keys[0]] > a[keys[1]] or b[keys[1]] < a[keys[0]]
            bounds |= {*keys}
    return disjoint, bounds


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _change(a: Any, b: Any) -> float:
    """Return the change relative to the larger of two numbers; infinite for texts that differ."""
    if _is_number(a) and _is_number(b):
        size = max(abs(a), abs(b))
        is_round_off = size < SMALLEST or min(abs(a), abs(b)) > LARGEST
        return 0.0 if a == b or is_round_off else abs(b - a) / size
    is_sentence = isinstance(a, str) and isinstance(b, str) and max(len(a), len(b)) > SENTENCE
    return 0.0 if is_sentence or (type(a) is type(b) and a == b) else np.inf


def shifted(a: pd.DataFrame, b: pd.DataFrame) -> tuple[pd.DataFrame, int]:
    """Return both medians of the columns that differ significantly, and the number of tests."""
    rows = []
    for name in [name for name in a.select_dtypes("number") if name in b and name != "case"]:
        x, y = a[name].dropna(), b[name].dropna()
        if min(len(x), len(y)) and np.ptp(np.concatenate([x, y])) > 0:
            medians = float(x.median()), float(y.median())
            p = mannwhitneyu(x, y).pvalue
            rows.append((f"median of {name}", *medians, _change(*medians), p))
    tested = pd.DataFrame(rows, columns=["place", "a", "b", "change", "p"])
    return tested[tested.p < LEVEL / max(len(tested), 1)], len(tested)


def _failing(a: dict[str, Any], b: dict[str, Any]) -> pd.DataFrame:
    failed = [[check for check in one.get("checks", []) if not check["passed"]] for one in (a, b)]
    former = {(check["what"], check["where"]) for check in failed[0]}
    new = [check for check in failed[1] if (check["what"], check["where"]) not in former]
    return pd.DataFrame(new, columns=["what", "where", "value", "limit"])
