"""Runs as an animation takes them: of the hexapod, and of any robot that `fjh track` flew."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import argument_checks as check
from experiments.recording import Array, drawing
from experiments.recording.keep import NoRunError
from experiments.recording.marks import Mark
from experiments.recording.mechanism import Motion, exaggerated, exaggeration_of, motion_of, stills
from experiments.recording.shown import Shown, magnified, scales_of
from experiments.study.foreign import read_arrays, read_json
from experiments.study.study import WrongInput

_LARGER = 2
"""An animation magnifies so many times as much as a recording, which can be turned and enlarged."""


@dataclass(frozen=True)
class Animated:
    """A run that is to be animated.

    Attributes:
        heading: A few words.
        time_s: (N,).
        desired: (N, m1), the first two of which are drawn, [rad] or [m].
        true: (N, m1).
        unit: Of both.
        model: The machine.
        surface: Of the machine.
        marks: The failures, with the part of the surface that fails.
        factor: By which its motion is to be magnified to be seen.
        motion: Of its bodies at some ticks, magnified by a factor.
    """

    heading: str
    time_s: Array
    desired: Array
    true: Array
    unit: str
    model: mujoco.MjModel
    surface: drawing.Machine
    marks: Sequence[tuple[str | None, Mark]]
    factor: int
    motion: Callable[[Sequence[int], float], Motion]

    @cached_property
    def error(self) -> Array:
        """Distance from where it should be at each tick, shape (N,)."""
        return np.linalg.norm(self.desired - self.true, axis=1)


def of_hexapod(heading: str, model: mujoco.MjModel, shown: Shown) -> Animated:
    """A run of the hexapod, drawn with loops that close however much it is magnified."""
    run = shown.run
    return Animated(
        heading,
        run.time_s,
        run.desired_rad,
        run.true_rad,
        "rad",
        model,
        drawing.machine(model),
        [(f"strut{mark.actuator + 1}", mark) for mark in shown.marks],
        _LARGER * scales_of([run]).factor,
        lambda ticks, factor: drawing.motion_at(model, magnified(run, ticks, factor)),
    )


def of_robot(heading: str, model: mujoco.MjModel, file: Path, model_sha256: str) -> Animated:
    """A run of `fjh track`: its .npz, and track.json beside it.

    Raises:
        NoRunError: It holds something else.
        WrongInput: It, or what is beside it, is not whole, or of another machine; or its task is
            no path in a plane.
    """
    arrays, stated = read_arrays(file), file.with_name("track.json")
    names = ("time_s", "desired", "true", "qpos")
    if missing := [name for name in names if name not in arrays]:
        raise NoRunError(f"{file} is not a run of the hexapod or of fjh track: no {missing[0]}")
    try:
        summary: dict[str, Any] = read_json(stated)
        units, marks = [str(each) for each in summary["units"]], _marks(summary)
        another = summary["model_sha256"] != model_sha256
        time_s, desired, true, qpos = (check.finite(name, arrays[name]) for name in names)
        check.exactly("time_s", time_s, len(time_s))
        check.exactly("desired", desired, len(time_s), len(units))
        check.exactly("true", true, len(time_s), len(units))
        if len(time_s) < 2 or (np.diff(time_s) <= 0).any():
            raise ValueError("time_s must ascend")
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise WrongInput(f"{file} and {stated.name} are not a run: {error}") from None
    if another or qpos.shape != (len(time_s), model.nq):
        raise WrongInput(f"{file} is a run of another machine; --model FILE draws that")
    if len(units) < 2 or len(set(units)) > 1:
        raise WrongInput(f"{file} is no path in a plane: its major rows are in {', '.join(units)}")
    nominal = motion_of(model, qpos[:1])
    return Animated(
        heading,
        time_s,
        desired,
        true,
        units[0],
        model,
        drawing.robot(model),
        marks,
        exaggeration_of(motion_of(model, qpos[stills(time_s)]), nominal),
        lambda ticks, factor: exaggerated(motion_of(model, qpos[list(ticks)]), nominal, factor),
    )


def _marks(summary: dict[str, Any]) -> list[tuple[str | None, Mark]]:
    """Each failure and the first diagnosis of its actuator since, with the body that it moves."""
    marks = []
    for failure in summary["failures"]:
        name, failed_s = failure["actuator"], float(failure["time_s"])
        number = summary["actuators"].index(name)
        mark = Mark(number, failed_s, f"{name} {failure['kind']}")
        for found in summary["diagnoses"]:
            if found["actuator"] == name and found["delay_s"] is not None:
                said = f"found: {name} {found['kind']}"
                mark = Mark(number, failed_s, mark.failure, float(found["time_s"]), said)
                break
        body = summary["bodies"][number]
        marks.append((None if body is None else str(body), mark))
    return marks
