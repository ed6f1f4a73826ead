"""The table and the figure of a run: `python -m benchmarks.table RUN.json [FOLDER] [--check]`.

RUN.json is what pytest-benchmark wrote (`make bench`). With --check the exit code is 1 if a ratio
that hardly scatters exceeds three times its bound: between processors alone, the same code
scattered up to 2.3 times it.
"""

import json
import sys
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

MARGIN = 3.0
RATIOS = pd.read_csv(
    Path(__file__).with_name("ratios.csv"), true_values=["yes"], false_values=["no"]
)
"""One time over another, a row each.

`compared` says in words what two contenders on a `question` are: `over` is timed, and divided by
the time of `under`. The ratio should be below `bound` and reach `goal`, where there is one; a
commit may fail only on one that scatters so little that it is called `stable`.
"""


def contenders() -> dict[str, list[str]]:
    """Those of each question: whoever stands in a row."""
    rows = RATIOS.melt("question", ["over", "under"], value_name="name")
    return rows.groupby("question", sort=False)["name"].unique().map(list).to_dict()


def times_us(run: dict[str, Any]) -> pd.Series:
    """Time of one tick or mapping by question and contender: the least of all rounds and turns."""
    times = pd.DataFrame(
        each["extra_info"] | {"us": 1e6 * each["stats"]["min"]} for each in run["benchmarks"]
    )
    times["us"] /= times["units"]
    return times.groupby(["question", "name"])["us"].min()


def measured(us: pd.Series) -> pd.DataFrame:
    """The rows of `RATIOS` whose times there are, with both times and the ratio."""
    rows = RATIOS.copy()
    for column, who in (("us", "over"), ("beside", "under")):
        rows[column] = us.reindex(pd.MultiIndex.from_frame(rows[["question", who]])).to_numpy()
    return rows.assign(ratio=rows["us"] / rows["beside"]).dropna(subset="ratio")


def table(rows: pd.DataFrame) -> str:
    """All ratios in Markdown."""
    columns = ["compared", "us", "beside", "ratio", "bound", "goal"]
    numbers = rows[columns[1:]].map(lambda x: "" if pd.isna(x) else f"{x:.3g}")
    cells = [columns, ["---"] * 6, *rows[["compared"]].join(numbers).values.tolist()]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


def exceeding(rows: pd.DataFrame) -> list[str]:
    """A sentence on each stable ratio beyond its bound and margin."""
    slow = rows[rows["stable"] & (rows["ratio"] > MARGIN * rows["bound"])]
    return [
        f"{each.compared}: {each.ratio:.3g}, expected below {MARGIN * each.bound:g}"
        for each in slow.itertuples()
    ]


def figure(rows: pd.DataFrame) -> Figure:
    """The ratios on a logarithmic axis, left of 1 this library is the faster; goals as ticks."""
    drawn = Figure(figsize=(8.0, 0.26 * len(rows) + 0.8), layout="constrained")
    axes = drawn.add_subplot()
    axes.axvline(1.0, color="0.6", linewidth=1.0)
    axes.plot(rows["ratio"], rows["compared"], "o", color="#0072b2")
    axes.plot(rows["goal"], rows["compared"], "|", color="#d55e00", markersize=10, label="goal")
    axes.invert_yaxis()
    axes.tick_params(axis="y", labelsize=8)
    axes.set(xscale="log", xlabel="time over the other's")
    axes.grid(axis="x", color="0.9")
    axes.legend(loc="lower right")
    return drawn


def main(words: list[str]) -> int:
    """Print the table, write it with the figure, and say which ratios exceed their bounds."""
    files = [Path(word) for word in words if not word.startswith("--")]
    rows = measured(times_us(json.loads(files[0].read_text(encoding="utf-8"))))
    print(table(rows))
    for folder in files[1:]:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "bench.md").write_text(f"{table(rows)}\n", encoding="utf-8")
        figure(rows).savefig(folder / "bench.png", dpi=150)
    wrong = exceeding(rows) if "--check" in words else []
    print(*wrong, sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
