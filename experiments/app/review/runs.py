"""Finding the runs that are to be put side by side, and what to say of them."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from experiments.app.review.told import check_told, told_in
from experiments.hexapod import paper
from experiments.hexapod.metrics import closure_residual_max_m, pointing_rms_urad
from experiments.hexapod.recording.keep import Kept, NoRunError, read_run
from experiments.hexapod.recording.shown import constants
from experiments.hexapod.testbed import Bench
from experiments.output.recording.file import About
from experiments.output.study import WrongInput


def find_runs(places: Sequence[Path], model_sha256: str) -> dict[str, Kept]:
    """Single runs and the runs in folders, by name.

    In a folder they are in the order in which its JSON speaks of them; files of something else are
    passed over there. What JSON beside a run says of it must agree with its data.

    Args:
        places: Folders and files.
        model_sha256: Of the machine that is going to be drawn.

    Raises:
        WrongInput: There is no run of the hexapod in one of the places, one is named twice, is
            not whole, was flown on another machine, or is not what the JSON beside it says.
    """
    found: dict[Path, Kept] = {}
    for place in places:
        told = told_in(place if place.is_dir() else place.parent)
        runs = _runs_in(place, told) if place.is_dir() else {place: read_run(place)}
        if not runs:
            raise WrongInput(f"{place} holds no run of the hexapod as `fjh table1` writes them")
        for file, run in runs.items():
            if file.resolve() in found:
                raise WrongInput(f"{file} is named twice")
            if run.properties.get("model_sha256", model_sha256) != model_sha256:
                raise WrongInput(f"{file} was flown on another machine; --model FILE draws that")
            check_told(file.name, run.shown.run, told)
            found[file.resolve()] = run
    stems = [file.stem for file in found]
    return {
        file.stem if stems.count(file.stem) == 1 else f"{file.parent.name}/{file.stem}": run
        for file, run in found.items()
    }


def _runs_in(folder: Path, told: dict[str, Any]) -> dict[Path, Kept]:
    words, found = json.dumps(told), {}
    for file in sorted(folder.glob("*.npz"), key=lambda file: words.find(json.dumps(file.stem))):
        with suppress(NoRunError):
            found[file] = read_run(file)
    return found


def about_runs(runs: Mapping[str, Kept]) -> About:
    """What a recording of several runs says of itself: their numbers in a table, the paper's too.

    Its properties are what the runs have in common.
    """
    first, *others = (one.properties for one in runs.values())
    common = {
        name: value
        for name, value in first.items()
        if all(name in other and other[name] == value for other in others)
    }
    table = [
        "| run | alpha, urad RMS | beta | paper, alpha | beta | largest strut input, % "
        "| largest t_x, um | t_y | t_z | gamma, urad | closure, nm |",
        "| --- |" + " --- |" * 10,
        *(_row(name, run) for name, run in runs.items()),
    ]
    colors = (
        "On the detector, beta over alpha, what is desired is orange, what is measured blue. "
        "Struts are blue for negative and red for positive input; a failed one wears a yellow "
        "collar."
    )
    shared = ["What all runs have in common:", "", *constants(common)]
    notes = ["# Side by side", "", *table, "", colors, "", *shared]
    return About("review", "review", "\n".join(notes), common)


def _row(name: str, one: Kept) -> str:
    run = one.shown.run
    alpha, beta = pointing_rms_urad(run)
    # The paper's numbers are of the whole spiral.
    is_whole = len(run.time_s) == len(Bench().time_s(Bench().duration_s))
    is_the_papers = one.experiment == "table1" and is_whole
    paper_rms = paper.TABLE_I_URAD.get(name) if is_the_papers else None
    gamma, *translation = 1e6 * np.abs(run.secondary).max(axis=0)
    cells = [name, f"{alpha:.4f}", f"{beta:.4f}"]
    cells += [f"{value:.4f}" for value in paper_rms] if paper_rms else ["", ""]
    cells += [f"{np.abs(run.strut_input_percent).max():.2f}"]
    cells += [f"{value:.3f}" for value in (*translation, gamma)]
    cells += [f"{1e9 * closure_residual_max_m(run):.2f}"]
    return "| " + " | ".join(cells) + " |"
