"""Print and plot ratios of times: `python -m benchmarks.table RUN.json [FOLDER] [--check]`.

pytest-benchmark writes RUN.json (`make bench`). With --check the exit code is 1 if a stable ratio
exceeds three times its bound, because ratios reached 2.3 times the bound on another processor.
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
"""Ratios of times, one in each row.

`compared` describes the ratio for a `question`: the time of candidate `over` divided by that of
`under`. The ratio should be below `bound`; `goal` is a long-term aim. Only `stable` ratios, which
hardly scatter, are checked.
"""


def candidates() -> dict[str, list[str]]:
    """Return the names of the candidates for each question."""
    rows = RATIOS.melt("question", ["over", "under"], value_name="name")
    return rows.groupby("question", sort=False)["name"].unique().map(list).to_dict()


def times_us(run: dict[str, Any]) -> pd.Series:
    """Return the least time of one tick or mapping [us], by question and candidate."""
    times = pd.DataFrame(
        entry["extra_info"] | {"us": 1e6 * entry["stats"]["min"]} for entry in run["benchmarks"]
    )
    times["us"] /= times["units"]
    return times.groupby(["question", "name"])["us"].min()


def measured_ratios(us: pd.Series) -> pd.DataFrame:
    """Return the rows of `RATIOS` that were timed, with both times [us] and the ratio."""
    rows = RATIOS.copy()
    for column, role in (("us", "over"), ("beside", "under")):
        rows[column] = us.reindex(pd.MultiIndex.from_frame(rows[["question", role]])).to_numpy()
    return rows.assign(ratio=rows["us"] / rows["beside"]).dropna(subset="ratio")


def table(rows: pd.DataFrame) -> str:
    """Return all ratios as a Markdown table."""
    columns = ["compared", "us", "beside", "ratio", "bound", "goal"]
    numbers = rows[columns[1:]].map(lambda x: "" if pd.isna(x) else f"{x:.3g}")
    cells = [columns, ["---"] * 6, *rows[["compared"]].join(numbers).values.tolist()]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


def exceeding(rows: pd.DataFrame) -> list[str]:
    """Return a sentence on each stable ratio above `MARGIN` times its bound."""
    slow = rows[rows["stable"] & (rows["ratio"] > MARGIN * rows["bound"])]
    return [
        f"{row.compared}: {row.ratio:.3g}, expected below {MARGIN * row.bound:g}"
        for row in slow.itertuples()
    ]


def figure(rows: pd.DataFrame) -> Figure:
    """Plot the ratios on a logarithmic axis, goals as ticks; below 1 this library is faster."""
    plot = Figure(figsize=(8.0, 0.26 * len(rows) + 0.8), layout="constrained")
    axes = plot.add_subplot()
    axes.axvline(1.0, color="0.6", linewidth=1.0)
    axes.plot(rows["ratio"], rows["compared"], "o", color="#0072b2")
    axes.plot(rows["goal"], rows["compared"], "|", color="#d55e00", markersize=10, label="goal")
    axes.invert_yaxis()
    axes.tick_params(axis="y", labelsize=8)
    axes.set(xscale="log", xlabel="time divided by the other's")
    axes.grid(axis="x", color="0.9")
    axes.legend(loc="lower right")
    return plot


def main(arguments: list[str]) -> int:
    """Print the table, write it and the figure, and print the ratios that exceed their bounds."""
    files = [Path(word) for word in arguments if not word.startswith("--")]
    rows = measured_ratios(times_us(json.loads(files[0].read_text(encoding="utf-8"))))
    print(table(rows))
    for folder in files[1:]:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "bench.md").write_text(f"{table(rows)}\n", encoding="utf-8")
        figure(rows).savefig(folder / "bench.png", dpi=150)
    too_slow = exceeding(rows) if "--check" in arguments else []
    print(*too_slow, sep="\n")
    return 1 if too_slow else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
