"""Tables of the pages, written from the results in docs/data when the site is built.

A page has `<!-- table NAME -->` where a table begins and `<!-- end -->` where it ends. Who reads it
on GitHub sees what `python docs/_extensions/tables.py` wrote last (`make tables`; with `--check` it
writes nothing and ends with 1 where a page is not up to date).
"""

import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco

from fjh.rig.events import EVENTS
from sim import MODELS, load_model

if TYPE_CHECKING:
    from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
NORMS = ("frobenius", "two")


def study(name: str) -> dict[str, Any]:
    """The results of a study at full length."""
    return json.loads((DOCS / "data" / f"{name}.json").read_text(encoding="utf-8"))


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; of the widths of its columns nobody cares."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(re.sub(r" +", " ", f"| {' | '.join(cells)} |") for cells in lines)


def table1() -> str:
    """RMS errors beside those of the paper, and peaks of the secondary motion."""
    columns = study("table1")["columns"]
    rows = []
    for angle in ("alpha", "beta"):
        paper = [f"{each[f'paper_{angle}_rms_urad']:.4f}" for each in columns]
        here = [f"{each[f'{angle}_rms_urad']:.3f}" for each in columns]
        rows += [[f"{angle}, here", *here], [f"{angle}, paper", *paper[:-1], f"**{paper[-1]}**"]]
    peaks = [
        ", ".join(f"{each['secondary_peak'][axis]:.3g}" for axis in ("t_x_um", "t_y_um"))
        for each in columns
    ]
    origin = ["fitted", *["= W_a"] * 4, "predicted"]
    head = ["", *(each["name"].replace("W_a_", "W_a ") for each in columns)]
    return markdown(head, [["origin", *origin], *rows, ["peak t_x, t_y [µm]", *peaks]])


def rest_positions() -> str:
    """Where the payload rests without the coil of a strut, over the stiffness that it keeps."""
    sweep = study("release")["sweep"]
    head = "suspension / own swing stiffness"
    locked = "error of the payload motion predicted for a locked strut, %"
    rows = {
        "alpha for 100 µrad commanded, simulated": ("alpha_simulated_urad", ".2f"),
        "alpha, elastic mapping": ("alpha_elastic_urad", ".2f"),
        locked: ("mismatch_as_if_locked_percent", ".2g"),
    }
    return markdown(
        [head, *(f"{each['suspension_over_swing']:g}" for each in sweep)],
        [[name, *(f"{each[key]:{form}}" for each in sweep)] for name, (key, form) in rows.items()],
    )


def loose_strut() -> str:
    """Spirals with a strut that has neither coil force nor spring."""
    spirals = {each["name"]: each for each in study("release")["spirals"]}
    names = {
        "no failure": ("sound", "sound"),
        "failure unknown to the mapping": ("uncorrected",) * 2,
        "known, mapped by the springs' statics": ("corrected",) * 2,
        "known, mapped as locked": ("as_locked",) * 2,
    }
    rows = []
    for label, (start, flight) in names.items():
        whole = spirals.get(start) or spirals[f"loose_from_start_{start}"]
        switched = spirals.get(flight) or spirals[f"loose_in_flight_{flight}"]
        rows.append(
            [
                label,
                *(f"{whole[f'{angle}_rms_urad']:.2f}" for angle in ("alpha", "beta")),
                f"{switched['alpha_peak_urad']:.1f}",
                f"{switched['sensitivity_peak']:.2f}",
            ]
        )
    head = ["strut 1 without coil force and spring", "alpha", "beta"]
    return markdown([*head, "peak alpha, failure at 8 s", "peak sensitivity"], rows)


MECHANISMS = {
    "arm": ("7-joint serial arm, pointing", 7),
    "hand": ("planar two-finger hand, placing an object", 3),
    "arms": ("two cooperating arms, carrying a load", 6),
    "platform": ("planar platform on four legs, positioning", 3),
}
"""What they are, and how many independent motions their loops leave them."""


def mechanisms() -> str:
    """Classification and simulation of other mechanisms."""
    found = study("systems")["systems"]
    columns = study("table1")["columns"]
    off = max(
        abs(each[f"{angle}_rms_urad"] / each[f"predicted_{angle}_rms_urad"] - 1)
        for each in columns
        for angle in ("alpha", "beta")
    )
    hexapod = ["flexure-jointed hexapod, pointing", "42, 6, 6", "Table I", "", "", ""]
    rows = [["`fjh.xml`", *hexapod, f"{100 * off:.1f} % (RMS)"]]
    for name, (title, freedoms) in MECHANISMS.items():
        model: mujoco.MjModel = load_model(MODELS / f"{name}.xml")
        ours = [each for each in found if each["mechanism"] == name]
        exact = sum(not each["unmanipulable"] and not each["unstable_major"] for each in ours)
        kinds = [sum(each[key] for each in ours) for key in ("unstable_major", "unmanipulable")]
        counts = map(str, (len(ours), exact, *kinds))
        sizes = f"{model.nv}, {model.nu}, {freedoms}"
        error = 100 * max(each["largest_error"] for each in ours)
        rows.append([f"`{name}.xml`", title, sizes, *counts, f"{error:.2f} %"])
    head = ["file", "mechanism", "velocities, motors, freedoms"]
    return markdown([*head, "conditions", "exact", "drifts", "lost", "largest error"], rows)


def readings(*labels: str, digits: int = 5) -> list[list[str]]:
    """Rows of the sizes of the change of the Jacobian that are read out of eq. (40)."""
    tried = {each["reading"]: each for each in study("jacobian")["tried"]}
    return [[label, *(f"{tried[label][norm]:.{digits}f}" for norm in NORMS)] for label in labels]


def jacobian() -> str:
    """The change of the Jacobian over the stroke, and in other coordinates."""
    found = study("jacobian")["variation"]
    certified = [f"{each['certified_upper_bound']:.5f}" for each in found]
    paper = [f"{each['paper']:g}" for each in found]
    [values] = readings("twist, base axes")
    others = ("twist, payload axes", "Euler rates, R = Rz Ry Rx", "Euler rates, R = Rx Ry Rz")
    rows = [
        ["twist, base axes: found", *values[1:]],
        ["twist, base axes: certified to be at most", *certified],
        ["paper", *paper],
        *readings(*others),
    ]
    return markdown(["J is", "Frobenius", "2-norm"], rows)


def jacobian_bound() -> str:
    """The terms of the certified bound."""
    found = study("jacobian")["variation"]
    rows = {
        **{f"{part}": part for part in ("linear", "quadratic", "cubic", "remainder")},
        **{"certified bound": "certified_upper_bound", "value found": "value"},
    }
    head = [r"part of the bound, over $\lVert J_0 \rVert$", "Frobenius", "2-norm"]
    return markdown(
        head, [[label, *(f"{each[key]:#.4g}" for each in found)] for label, key in rows.items()]
    )


def jacobian_readings() -> str:
    """Other ways to read eq. (40)."""
    rows = readings(
        *("twist; largest entry of the change", "inverse of J", "lengths in mm"),
        *("origin between the top nodes", "twist; one strut at a time"),
        *("twist; struts within a ball", "inverse; largest entry of the change"),
        "inverse; median of random points",
    )
    return markdown(["reading of (40)", "Frobenius", "2-norm"], rows)


def distances() -> str:
    """How far a failure is from the most similar other explanation, for the worst strut."""
    found = study("recover")["ambiguity"]
    kinds = {"locked": "locked", "free": "free", "weak": "half weak"}
    wheres = {"centre": "at its centre", "off centre": "off centre"}
    rows = []
    for kind, word in kinds.items():
        for where, place in wheres.items():
            cells = []
            for key in ("from_other_actuators", "from_other_kinds"):
                for setting in ("angles", "angles, dither"):
                    least = min(
                        each[key]
                        for each in found
                        if (each["setting"], each["kind"], each["where"]) == (setting, kind, where)
                    )
                    cells.append(f"{least:.0f}" if least > 10 else f"{least:.1f}")
            rows.append([f"{word} {place}", *cells])
    head = ["failure", "d from another strut: angles only", "with dither"]
    return markdown([*head, "d from another kind: angles only", "with dither"], rows)


def dither() -> str:
    """What a motion of the payload separates, over its frequency."""
    found = study("recover")["dither_design"]
    rates = sorted({each["frequency_hz"] for each in found})
    rows = {
        name: [
            next(
                each["separation"]
                for each in found
                if (each["direction"], each["frequency_hz"]) == (name, rate)
            )
            for rate in rates
        ]
        for name in ("gamma", "t_x", "t_y", "t_z")
    }
    return markdown(
        ["motion of the payload", *(f"{rate:g} Hz" for rate in rates)],
        [
            [
                name.replace("t_z", "t_z, the heave"),
                *(f"{each:.0f}" if each > 10 else f"{each:.1f}" for each in row),
            ]
            for name, row in rows.items()
        ],
    )


MISMATCHES = {
    "exact": "exact",
    "gain": "gain of each coil ±3 %",
    "stiffness": "stiffness of each spring ±3 %",
    "damping": "damping of each damper ±20 %",
    "inertia": "mass and inertia ±2 %",
    "delay_ticks": "delay 1 ms",
    "floor_um_per_s": "floor at VC-C",
    "drift_urad_per_s": "detector drift ±0.01 µrad/s",
    "gain_drift_per_s": "gain drift ±0.01 %/s",
    "hysteresis": "hysteresis 1 %",
    "timestep_s": "integrator step",
    "all": "**all**",
}


def recovered() -> str:
    """How soon failures are identified on plants that differ from the model, and the error then."""
    found = {each["mismatch"]: each for each in study("recover")["by_mismatch"][::-1]}
    rows = []
    for name, label in MISMATCHES.items():
        each = found[name]
        times = [each[f"named_{part}_s"] for part in ("median", "percentile_95", "largest")]
        named = "/".join(f"{1e3 * one:.0f}" for one in times)
        rows.append([label, named, f"{each['over_informed_after_worst']:.3f}"])
    head = ["mismatch", "named, ms: median/95 %/largest", "RMS, worst flight"]
    return markdown(head, rows)


def events() -> str:
    """Each event that `fjh track --event` takes, what it does, and what diagnoses it correctly."""
    rows = [
        [f"`{name}`", kind.of, kind.sentence, ", ".join(kind.named_as) or kind.cause or "none"]
        for name, kind in EVENTS.items()
    ]
    head = ["event", "of", "what happens", "correct diagnosis"]
    return "\n".join(f"|{'|'.join(cells)}|" for cells in (head, ["-"] * len(head), *rows))


TABLES: dict[str, Callable[[], str]] = {
    made.__name__: made
    for made in (
        *(table1, rest_positions, loose_strut, mechanisms, jacobian, jacobian_bound),
        *(jacobian_readings, distances, dither, recovered, events),
    )
}


def written(text: str) -> str:
    """A page with its tables as they are now."""
    place = re.compile(r"(<!-- table (\w+) -->\n).*?(?=<!-- end -->)", re.DOTALL)
    return place.sub(lambda found: f"{found[1]}{TABLES[found[2]]()}\n", text)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Write the tables of each page that is read."""

    def read(_app: "Sphinx", _name: str, source: list[str]) -> None:
        source[0] = written(source[0])

    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def main(check: bool) -> int:
    """Write the pages, or say which are not up to date."""
    old = [page for page in DOCS.rglob("*.md") if written(page.read_text()) != page.read_text()]
    for page in old:
        if check:
            print(f"docs/{page.relative_to(DOCS)}: a table is not that of docs/data: make tables")
        else:
            page.write_text(written(page.read_text()), encoding="utf-8")
    return int(check and bool(old))


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
