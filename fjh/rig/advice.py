"""Advice on command-line options with which the diagnosis isolates a failure."""

from contextlib import suppress
from dataclasses import replace
from itertools import product
from pathlib import Path

from fjh.rig.dither import rig_dither
from fjh.rig.mjcf import rig_of
from fjh.rig.options import RobotOptions
from fjh.rig.rig import Rig
from fjh.study.errors import WrongInput
from sim import Failure


def advice(
    rig: Rig, model: Path | None, options: RobotOptions, dither: str, failure: Failure
) -> str:
    """Return a clause on the options, --sense and --dither, that would isolate a failure."""
    senses = dict.fromkeys([options.sense, *([] if model is None else ["both"])])
    for sense, designed in product(senses, ("default", "designed")):
        same_sensors = sense == options.sense
        if same_sensors and designed == dither:
            continue
        with suppress(WrongInput):
            sensing = rig if same_sensors else rig_of(model, replace(options, sense=sense))
            design = rig_dither(sensing, designed)
            if design and design.separations.isolates(failure.number, failure.kind):
                added = "" if same_sensors else f"--sense {sense} "
                return f"by the linear model {added}--dither {designed} isolates it"
    return "by the linear model no --sense and no designed --dither isolates it"
