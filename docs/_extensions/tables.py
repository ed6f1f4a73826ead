"""Tables and numbers of the pages, written from the results in docs/data when the site is built.

A page has `<!-- table NAME -->` where a table begins and `<!-- end -->` where it ends, and
`<!--NAME-->` before a number of `VALUES`, `<!--/-->` after it. GitHub shows those that `python
docs/_extensions/tables.py` (`make tables`) wrote last; with `--check` it writes nothing, and its
exit code is 1 if a page is not up to date.
"""

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import values
import values_diagnosis
from results import ANGLES, DOCS, count, interval, is_shown, pooled, row, rows, study

from fjh.rig.events import EVENTS

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"|{'|'.join(cells)}|" for cells in lines)


def table1() -> str:
    """Return RMS errors here and in the paper, and peaks of the secondary motion."""
    columns = study("table1")["columns"]
    rows = []
    for angle in ANGLES:
        paper = [f"{column[f'paper_{angle}_rms_urad']:.4f}" for column in columns]
        here = [f"{column[f'{angle}_rms_urad']:.3f}" for column in columns]
        rows += [[f"{angle}, here", *here], [f"{angle}, paper", *paper[:-1], f"**{paper[-1]}**"]]
    peaks = [
        ", ".join(f"{column['secondary_peak'][axis]:.3g}" for axis in ("t_x_um", "t_y_um"))
        for column in columns
    ]
    origin = ["fitted", *["= W_a"] * 4, "predicted"]
    head = ["", *(column["name"].replace("W_a_", "W_a ") for column in columns)]
    return markdown(head, [["origin", *origin], *rows, ["peak t_x, t_y [µm]", *peaks]])


CANDIDATES = {
    "lost_strut": "strut 1 locked, nothing else",
    "resonance": "damping 0.015, roll-off 40 Hz",
    "floor_office": "floor vibration 400 µm/s",
    "off_centre": "locked at -110 µm",
    "saturation": "amplifier limit 0.105 A",
    "retuned": "locked at -125 µm, loops and spiral retuned",
    "retuned_settled": "the same, 2 s to settle",
    "limit_clockwise": "demand limit 95 µrad, spiral clockwise",
    "limit_speed": "demand limit 117.5 µrad, spiral of constant speed",
}
"""Labels of the explanations of Table I's last column that the page shows."""


def uncorrected() -> str:
    """Return the explanations of Table I's last column."""
    result = study("uncorrected")
    rows = {row["name"]: row for row in result["candidates"]}
    runs = {row["candidate"]: row for row in result["runs"] if row["column"] == "W_d"}
    cells = []
    for name, differs in CANDIDATES.items():
        row, known = rows[name], runs[name]
        satisfied = {"ratios": row["meets_ratios"], "W_a": row["meets_w_a"]}
        satisfied["W_d, W_e"] = row["meets_corrected"]
        missed = ", ".join(name for name, value in satisfied.items() if not value)
        ratios = "{alpha_ratio:.2f}, {beta_ratio:.2f}".format(**row)
        errors = "{alpha_rms_urad:.1f}, {beta_rms_urad:.1f}".format(**known)
        cells.append([differs, ratios, errors, f"misses {missed}" if missed else "**meets all**"])
    return markdown(["what differs", "ratios", "W_d", "Table I"], cells)


def jacobian() -> str:
    """Return the change of the Jacobian over the stroke, its bound, and the paper's values."""
    norms = study("jacobian")["variation"]
    rows = {"largest value found": "value", "part linear in the displacements": "linear"}
    rows |= {"certified upper bound": "certified_upper_bound"}
    cells = [[label, *(f"{norm[key]:.5f}" for norm in norms)] for label, key in rows.items()]
    cells.append(["paper", *(f"{norm['paper']:g}" for norm in norms)])
    return markdown(["e", "Frobenius", "2-norm"], cells)


def force() -> str:
    """Return the largest errors of simulated static forces."""
    kinds = {None: "healthy", "locked": "locked", "free": "free", "loose": "loose"}
    theorems = study("force")["theorems"]
    rows = []
    for kind, label in kinds.items():
        errors = {
            quantity: max(row[f"{quantity}_percent"] for row in theorems if row["kind"] == kind)
            for quantity in ("pressed_major_off", "pressed_off", "held_off", "moved")
        }
        cells = [f"{value:.2g}" for value in errors.values()]
        rows.append([label, *(["not determined", *cells[1:]] if kind == "locked" else cells)])
    head = ["strut", "major force, pressing", "wrench, pressing"]
    return markdown([*head, "strut forces, holding", "displacement, holding"], rows)


GOALS = {
    "reliability": "hottest coil, °C",
    "stroke": "least stroke left, µm",
    "obstacle": "least clearance, µm",
    "singularity": "largest condition number",
}
"""Labels of the measures, by secondary goal."""


def goals() -> str:
    """Return extremes of the measures of secondary goals, and changes of the pointing."""
    result = study("goals")
    seeds = {row["goal"]: row["difference_rms_urad"] for row in result["another_seed"]}
    worst = {(row["goal"], row["name"]): row["worst"] for row in result["runs"]}
    changes: dict[tuple[str, str], float] = {}
    for angle in result["angles"]:
        key = angle["goal"], angle["name"]
        changes[key] = max(changes.get(key, 0.0), angle["difference_rms_urad"])
    styles = ("pursued", *(f"pseudo_inverse_{weight}" for weight in (1, 10, 100)))
    rows = []
    for goal, label in GOALS.items():
        moved = [*(changes[goal, style] for style in styles), seeds[goal]]
        rows.append(
            [
                label,
                *(f"{round(worst[goal, style], 1) + 0.0:.1f}" for style in ("pursued", "nothing")),
                *(f"{change:.0f}" if change > 100 else f"{change:.2g}" for change in moved),
            ]
        )
    head = ["measure", "pursued", "not pursued", "pointing change [µrad]: pursued"]
    return markdown([*head, *(f"w = {weight}" for weight in (1, 10, 100)), "other seed"], rows)


STRATEGIES = {
    "strict": "strict",
    "clipping": "clipping",
    "clipping_tracking_10": "clipping, tracking time x10",
    "redistributed": "redistributed pseudo-inverse",
    "weighted_0.3": "weighted, w = 0.3",
    "weighted_3": "weighted, w = 3",
    "unlimited": "three times the stroke and current",
}
"""Strategies of the study of limits that the page shows."""


def limits() -> str:
    """Return RMS errors of strategies when actuators reach their limits."""
    spirals = {run["name"]: run["rms_urad"] for run in study("limits")["spirals"]}
    conditions = {"healthy": "no failure", "stuck": "strut 1 stuck"}
    rows = [
        [label, *(f"{spirals[f'{condition}_{name}']:.0f}" for condition in conditions)]
        for name, label in STRATEGIES.items()
    ]
    return markdown(["", *conditions.values()], rows)


def recovered() -> str:
    """Return errors with locked, free and weak struts and all mismatches."""
    result = study("recover")
    size = 1e6 * result["path_size_rad"]
    rows = []
    for who in ("supervised", "informed", "unaware"):
        for when in ("during", "after"):
            cells = [
                "/".join(f"{size * kind[f'{what}_{who}_{when}']:.1f}" for what in ("rms", "peak"))
                for kind in result["by_kind"]
            ]
            rows.append([f"{who}, {'first 0.5 s' if when == 'during' else 'later'}", *cells])
    head = ["RMS/peak error, µrad", *(kind["kind"] for kind in result["by_kind"])]
    return markdown(head, [row for row in rows if row[0] != "unaware, first 0.5 s"])


SIZES = {
    "gain": "gains",
    "stiffness": "springs",
    "delay_ticks": "delay",
    "floor_um_per_s": "floor",
    "hysteresis": "hysteresis",
}
"""Mismatches whose size the page varies."""


def mismatch_sizes() -> str:
    """Return identification results for mismatches larger than the stated sizes."""
    groups = study("recover")["by_mismatch"]
    by_size = {(group["mismatch"], group["factor"]): group for group in groups}
    rows = []
    for name, label in SIZES.items():
        cells = []
        for factor in (3.0, 10.0, 30.0):
            group = by_size[name, factor]
            median = group["named_median_s"]
            parts = [f"{group['right_count']}/{group['runs']}"]
            parts += [] if median is None else [f"{1e3 * median:.0f} ms"]
            for key, word in {"alarm_before": "false", "healthy_named": "healthy"}.items():
                count = group[f"{key}_count"]
                parts += [f"{count} {word}"] if count else []
            cells.append(", ".join(parts))
        rows.append([label, *cells])
    return markdown(["mismatch", "x3", "x10", "x30"], rows)


def recover_events() -> str:
    """Return the events in which diagnosis changes the error of the hexapod or of the hand."""
    cells = []
    for event in rows("events", "by_event"):
        name, hand = event["event"], row("hand_events", "by_event", event=event["event"])
        if is_shown(name):
            identified = str(event["right_count"]) if event["right_cases"] else "-"
            ratios = event["over_unaware_since_median"], event["counted_worst"]
            wrong = str(event["healthy_named_count"])
            worst = f"{hand['counted_worst']:.2f}"
            cells.append([name, *(f"{ratio:.2f}" for ratio in ratios), identified, wrong, worst])
    head = ["event", "median", "worst", "identified", "healthy", "hand, worst"]
    return markdown(head, cells)


ROBOTS = {
    "platform": "platform, x, y",
    "hand": "hand, x, y",
    "arm": "arm, rx, ry",
    "arms": "two arms, x, y, z",
} | {
    f"{name}_{step}ms": f"{label}, {step} ms"
    for name, label in {"panda": "Panda", "ur5e": "UR5e", "xarm7": "xArm7"}.items()
    for step in (1, 2, 5)
}
"""Robots whose failures are simulated, by result."""


def other_robots() -> str:
    """Return identified failures, errors and false diagnoses of other robots, with encoders."""
    cells = []
    for name, label in ROBOTS.items():
        kinds = [row(name, "by_kind", sense="joints", kind=k) for k in ("locked", "free", "weak")]
        wrong = pooled(rows(name, "healthy"), "healthy_named")
        ratio = max(kind["over_informed_after_worst"] or 0.0 for kind in kinds)
        wrongly = sum(kind["healthy_named_count"] for kind in kinds)
        identified = [count(kind, "right").replace(" of ", "/") for kind in kinds]
        false = count(wrong, "healthy_named").replace(" of ", "/")
        false += f" (≤ {100 * wrong['healthy_named_high']:.0f} %)"
        cells.append(
            [
                label,
                *identified,
                str(wrongly),
                f"{ratio:.2f}" if ratio < 10 else f"{ratio:.0f}",
                false,
            ]
        )
    head = ["robot", "locked", "free", "weak", "wrong", "RMS", "without failure"]
    return markdown(head, cells)


def loops() -> str:
    """Return the times of a control tick over that of its physics."""
    cells = []
    for name in ("hexapod", "arm", "hand", "arms", "platform"):
        pair = rows("bench", "ratios", question=f"loop_{name}")
        ratios = [f"{group[key]:.3g}" for group in pair for key in ("ratio", "goal")]
        cells.append([name, f"{pair[0]['beside']:.3g}", *ratios])
    head = ["robot", "physics [µs]", "with control", "goal", "with diagnosis", "goal"]
    return markdown(head, cells)


def solvers() -> str:
    """Return the times of single ticks and problems, here and by other libraries."""
    cells = [
        [group["compared"], *map(_short, (group[key] for key in ("us", "beside", "ratio", "goal")))]
        for group in study("bench")["ratios"]
        if not group["question"].startswith("loop_")
    ]
    return markdown(["compared", "here [µs]", "other [µs]", "ratio", "goal"], cells)


def _short(number: float | None) -> str:
    return "" if number is None else f"{number:.3g}"


def origin(*names: str) -> str:
    """Return commit, date, computer, versions, seeds and numbers of runs of some results."""
    sources = study("origin")
    lines = {
        "Commit {commit:.7}, {finished:.10}".format(**sources[name]): sources[name]
        for name in names
    }
    runs = [f"{_runs(name):,} runs of `{name}`" for name in names if _runs(name)]
    first = sources["table1"]
    machine = f"{first['machine']['processor']}, {first['machine']['cores']} cores"
    packages = ", ".join(f"{k} {first['versions'][k]}" for k in ("python", "mujoco", "numpy"))
    parts = [*lines, machine, packages, f"seed {first['seed']}", *runs]
    return f"*{'; '.join(parts)}.*"


def _runs(name: str) -> int:
    """Return the number of runs of a result; 0 of one without a list of runs."""
    runs = study(name).get("runs")
    return runs if isinstance(runs, int) else 0


def robots() -> str:
    """Return the totals of the public robots."""
    result = study("robots")
    outcomes = {
        key: result.get(key, 0) for key in ("completed", "refused", "timeout_s", "traceback")
    }
    errors = [
        f"{label}: {result[f'{key}_models']} models, largest relative error "
        f"{result[f'{key}_largest_error']:.1e}."
        for key, label in {"jacobians": "Jacobians", "power": "Power"}.items()
    ]
    lines = [
        "{models} models: {completed} completed both runs, {refused} were refused, {timeout_s} "
        "exceeded the time limit, {traceback} crashed.".format(models=result["models"], **outcomes),
        " ".join(errors),
        f"RMS error within 20 % of the prediction: {count(result, 'healthy_close')} runs without "
        f"failure and {count(result, 'lock_close')} after the lock; "
        f"{result['healthy_without_prediction']} and {result['lock_without_prediction']} have no "
        f"prediction. Beyond 20 % without a warning that says why: "
        f"{result['healthy_off_without_warning'] + result['lock_off_without_warning']}.",
        f"The lock was identified in {count(result, 'lock_named')} runs (95 % interval: "
        f"{interval(result, 'lock_named')}). Something was diagnosed in "
        f"{count(result, 'healthy_wrong')} runs without failure "
        f"({interval(result, 'healthy_wrong')}).",
    ]
    return "\n".join(f"- {line}" for line in lines)


def events() -> str:
    """Return the events of `fjh track --event`, their effects and their correct diagnoses."""
    rows = [
        [f"`{name}`", kind.of, kind.sentence, ", ".join(kind.correct_kinds) or kind.cause or "none"]
        for name, kind in EVENTS.items()
    ]
    return markdown(["event", "of", "what happens", "correct diagnosis"], rows)


VALUES = values.VALUES | values_diagnosis.VALUES
TABLES: dict[str, Callable[..., str]] = {
    table.__name__: table
    for table in (
        *(table1, uncorrected, jacobian, force, goals, limits),
        *(recovered, mismatch_sizes, recover_events, events),
        *(other_robots, robots, loops, solvers, origin),
    )
}


def written(text: str) -> str:
    """Return the text of a page with up-to-date tables and numbers.

    Raises:
        ValueError: A line begins with a number: Markdown would read it as a block of HTML.
    """
    if line := re.search(r"^\s*(- )?<!--[\w.]+-->.*", text, re.MULTILINE):
        raise ValueError(f"a line begins with a number: {line[0]}")
    block = re.compile(r"(<!-- table (\w+)([ \w]*) -->\n).*?(?=<!-- end -->)", re.DOTALL)
    text = block.sub(lambda match: f"{match[1]}{TABLES[match[2]](*match[3].split())}\n", text)
    number = re.compile(r"(<!--([\w.]+)-->).*?(?=<!--/-->)", re.DOTALL)
    return number.sub(lambda match: f"{match[1]}{VALUES[match[2]]()}", text)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Update the tables of each page that Sphinx reads."""

    def read(_app: "Sphinx", _name: str, source: list[str]) -> None:
        source[0] = written(source[0])

    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def main(check: bool) -> int:
    """Write the pages, or print those that are not up to date."""
    pages = (DOCS.parent / "README.md", *DOCS.rglob("*.md"))
    outdated = [page for page in pages if written(page.read_text()) != page.read_text()]
    for page in outdated:
        if check:
            print(f"{page}: a table or number differs from docs/data; run make tables")
        else:
            page.write_text(written(page.read_text()), encoding="utf-8")
    return int(check and bool(outdated))


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
