"""A run of any robot as recordings, reviews and animations show it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from argument_checks.ties import greatest
from fjh.recording import Array
from fjh.recording.machine import Failing, stills
from fjh.recording.motion import (
    BODIES,
    Mover,
    displacement,
    magnification,
    motion_of,
    mover,
)
from fjh.recording.signals import Line, Plot
from fjh.rig import Rig, Run
from fjh.rig.run import HEALTHY
from fjh.rig.units import ROWS, quantity_text
from fjh.study.palette import BLACK, FAILED, GREEN, ORANGE
from sim.mjcf import model_sha256

ERROR, INPUT, SECONDARY = "task/error", "actuators/input", "secondary/true"
CLOSURE = "closure/residual"
"""Entities of the signals that have a panel of their own."""
_HEXAPOD_ROWS = ("alpha", "beta", "gamma", "t_x", "t_y", "t_z")
_PERCENT = 100.0
"""Input at which a coil of the hexapod has its largest force."""
_SOLVER = 0.05
"""A gap of the loops that varies by less, in [nm] or of its size, is a constant of the solver's."""
_SOON_S = 1e-9


@dataclass(frozen=True)
class Change:
    """A change of what an actuator is, or is taken for (`SOUND` is healthy); or another event."""

    actuator: str | None  # None is of no single one
    kind: str  # of failure, or the event's name
    time_s: float  # onset


@dataclass(frozen=True)
class Stated:
    """The statement of a run in its recording; with the run's arrays it is all that is shown.

    n actuators, m1 major rows; lists, as JSON has them.
    """

    robot: str  # its name
    hexapod: bool  # drawn with closed loops, its struts coloured by their inputs
    model_file: str  # MJCF; empty is the hexapod's own
    model_sha256: str
    actuators: list[str]
    actuator_units: list[str]  # of displacements (n,): "rad", "m"
    input_units: list[str]  # (n,), or "%"
    limits: list[list[float | None]]  # lower and upper inputs (2, n); None is none
    bodies: list[list[str]]  # that each actuator moves, (n,)
    rows: list[str]  # names of all six rows of the twist
    major: list[int]  # (m1,)
    row_units: list[str]  # of the major ones, (m1,): "rad", "m"
    incidents: list[Change] = field(default_factory=list)  # failures and other events
    diagnoses: list[Change] = field(default_factory=list)
    known: str = ""  # what else is said of a failure, such as whether the controller is informed
    status: str = ""  # what the controller made of the run, one sentence

    def text(self, incident: Change) -> str:
        """An incident in words: "motor4 locked"."""
        words = [incident.actuator or "", incident.kind]
        return " ".join(words).strip() + (f", {self.known}" if self.known else "")


def stated_of(
    rig: Rig, run: Run | None = None, *, known: str = "", machine_file: Path | None = None
) -> Stated:
    """The statement of a run of a robot; None is one in which nothing happens.

    The machine file is given where the rig names none; None is that of the hexapod.
    """
    is_hexapod, n, file = rig.file is None, len(rig.actuators), rig.file or machine_file
    sides = (np.full(n, -np.inf), np.full(n, np.inf)) if rig.limits is None else rig.limits
    if is_hexapod:
        sides = np.full(n, -_PERCENT), np.full(n, _PERCENT)
    return Stated(
        robot=rig.title,
        hexapod=is_hexapod,
        model_file="" if file is None else str(file),
        model_sha256=rig.model_sha256 if machine_file is None else model_sha256(machine_file),
        actuators=list(rig.actuators),
        actuator_units=list(rig.units),
        input_units=["%"] * n if is_hexapod else list(rig.units),
        limits=[[x if np.isfinite(x) else None for x in side.tolist()] for side in sides],
        bodies=[list(pair) for pair in BODIES]
        if is_hexapod
        else [[] if body is None else [body] for body in rig.bodies],
        rows=list(_HEXAPOD_ROWS if is_hexapod else ROWS),
        major=list(rig.major),
        row_units=list(rig.row_units),
        incidents=[] if run is None else _incidents(rig, run),
        diagnoses=[] if run is None else _diagnoses(run),
        known=known,
        status="" if run is None else run.status,
    )


def _incidents(rig: Rig, run: Run) -> list[Change]:
    """Failures and other events in the order of time; an event that is a failure, once."""
    pairs = [(each, each.kind) for each in run.failures]
    pairs += [(each, each.name) for each in run.events]
    found = dict[tuple[object, ...], Change]()
    for k, (each, kind) in enumerate(pairs):
        name = None if each.actuator is None else rig.actuators[int(each.actuator)]
        change = Change(name, kind, float(each.time_s))
        found.setdefault((k,) if name is None else (name, change.time_s), change)
    return in_order(found.values())


def _diagnoses(run: Run) -> list[Change]:
    found = [Change(each.actuator, each.kind, each.time_s) for each in run.diagnoses]
    found += [
        Change(each.actuator, HEALTHY, each.withdrawn_s)
        for each in run.diagnoses
        if each.withdrawn_s is not None
    ]
    return in_order(found)


def in_order(changes: Any) -> list[Change]:
    """Changes in the order of time."""
    return sorted(changes, key=lambda change: change.time_s)


@dataclass(frozen=True)
class RunView:
    """A run of N ticks of a robot with n actuators and m1 major rows, as it is shown."""

    stated: Stated
    arrays: Mapping[str, Array]  # as of `Run.arrays`; of the hexapod `qpos` is not used
    model: mujoco.MjModel
    extras: Sequence[Plot] = ()  # besides the plots that every run has

    @property
    def time_s(self) -> Array:
        """Times of the ticks, (N,)."""
        return self.arrays["time_s"]

    @property
    def rows(self) -> list[str]:
        """Names of the major rows."""
        return [self.stated.rows[row] for row in self.stated.major]

    @property
    def scales(self) -> tuple[object, ...]:
        """A key that is the same for runs that can be drawn on the same scales."""
        its = self.stated
        return its.robot, *its.actuators, *self.rows, *its.row_units, self.model.nbody

    @property
    def drawn(self) -> list[int]:
        """Columns of the major rows in the unit of the first; two of them are a plane."""
        units = self.stated.row_units
        return [k for k, unit in enumerate(units) if unit == units[0]]

    @cached_property
    def motion(self) -> Mover:
        """The magnified motion of its bodies."""
        return mover(self.model, self.stated.hexapod, self.arrays["qpos"][0])

    @cached_property
    def factor(self) -> int:
        """A factor by which its motion is magnified to be seen."""
        if self.stated.hexapod:
            return magnification(self.arrays["task"][:, :3], self.arrays["task"][:, 3:])
        nominal, seen = (self.arrays["qpos"][at] for at in (slice(1), stills(self.time_s)))
        return magnification(
            *displacement(motion_of(self.model, seen), motion_of(self.model, nominal))
        )

    @cached_property
    def error(self) -> Array:
        """Desired minus true, (N, m1)."""
        return self.arrays["desired"] - self.arrays["true"]

    def rms(self, ticks: slice = slice(None)) -> Array:
        """RMS error of each major row over some ticks, (m1,)."""
        return np.sqrt((self.error[ticks] ** 2).mean(axis=0))

    @property
    def parts(self) -> dict[str, slice]:
        """Ticks before and after something happened, of those that there are."""
        first_s = min((each.time_s for each in self.stated.incidents), default=np.inf)
        cut = int(np.searchsorted(self.time_s, first_s - _SOON_S))
        parts = {"before": slice(cut), "after": slice(cut, None)}
        return {when: part for when, part in parts.items() if len(self.time_s[part])}

    def rms_text(self) -> str:
        """The RMS errors as of `fjh track`: "x 2.1 µm before; x 27.8 µm after"."""
        found = []
        for when, ticks in self.parts.items():
            named = zip(self.rows, self.rms(ticks), self.stated.row_units, strict=True)
            each = ", ".join(f"{row} {quantity_text(value, unit)}" for row, value, unit in named)
            found.append(f"{each} {when}" if self.stated.incidents else each)
        return "; ".join(found)

    def diagnosis_of(self, incident: Change) -> Change | None:
        """The first diagnosis of the actuator of an incident since then."""
        since = (
            each
            for each in self.stated.diagnoses
            if each.actuator == incident.actuator
            and each.time_s >= incident.time_s - _SOON_S
            and each.kind != HEALTHY
        )
        return next(since, None)

    @property
    def failures(self) -> list[Change]:
        """Incidents of actuators, but for repairs."""
        return [each for each in self.stated.incidents if each.actuator and each.kind != HEALTHY]

    @property
    def failing(self) -> list[Failing]:
        """Bodies of each actuator that fails; words on it from its failure, and diagnosis, on."""
        found = list[Failing]()
        for each in self.failures:
            words, diagnosis = [(each.time_s, self.stated.text(each))], self.diagnosis_of(each)
            if diagnosis is not None:
                after_ms = 1e3 * (diagnosis.time_s - each.time_s)
                known = f"{words[0][1]}, diagnosed as {diagnosis.kind} after {after_ms:.0f} ms"
                words.append((diagnosis.time_s, known))
            bodies = self.stated.bodies[self.stated.actuators.index(str(each.actuator))]
            found.append((bodies, words))
        return found

    @property
    def lines(self) -> list[Line]:
        """All events and diagnoses with their colours, in the order of time."""
        happened, found = self.stated.incidents, self.stated.diagnoses
        lines = [
            Line(each.time_s, self.stated.text(each), FAILED if each.actuator else ORANGE)
            for each in happened
        ] + [
            Line(each.time_s, f"{each.actuator} cleared", GREEN)
            if each.kind == HEALTHY
            else Line(each.time_s, f"diagnosis: {each.actuator} {each.kind}", BLACK)
            for each in found
        ]
        return sorted(lines, key=lambda line: line.time_s)

    @property
    def lanes(self) -> dict[str, list[tuple[float, str]]]:
        """States over time of each actuator that fails or is diagnosed, and its diagnoses.

        Without any diagnosis there are no lanes of what actuators are taken for.
        """
        begin_s, its = float(self.time_s[0]), self.stated
        lanes, changed = dict[str, list[tuple[float, str]]](), [*its.incidents, *its.diagnoses]
        for name in its.actuators:
            if not any(each.actuator == name for each in changed):
                continue
            for words, history in (("is", its.incidents), ("taken for", its.diagnoses)):
                changes = [(each.time_s, each.kind) for each in history if each.actuator == name]
                if changes or (its.diagnoses and words != "is"):
                    lane = [] if changes and changes[0][0] <= begin_s else [(begin_s, HEALTHY)]
                    lanes[f"{name} {words}"] = [*lane, *changes]
        return lanes

    @property
    def secondary(self) -> tuple[list[str], Array]:
        """The other rows of the task frame: names with units, values (N, 6 - m1) [urad], [um]."""
        rest = [row for row in range(len(ROWS)) if row not in self.stated.major]
        units = ["urad" if row < len(ROWS) // 2 else "um" for row in rest]
        names = [self.stated.rows[row] for row in rest]
        return _with_units(names, units), 1e6 * self.arrays["task"][:, rest]

    @cached_property
    def signals(self) -> list[Plot]:
        """All that is logged, at every tick; what has a panel in the order of what it tells."""
        its, own, um = self.stated, self.arrays, "u" if self.stated.hexapod else ""
        rows = _with_units(self.rows, [f"u{unit}" for unit in its.row_units])
        moved = _with_units(its.actuators, [um + unit for unit in its.actuator_units])
        scaled = (1e6 if um else 1.0) * own["displacement"]
        names, values = self.secondary
        plots = [
            self._plot("task/desired", "Desired", rows, 1e6 * own["desired"]),
            self._plot("task/true", "True", rows, 1e6 * own["true"]),
            self._plot("task/measured", "Measured", rows, 1e6 * own["measured"]),
            *(
                self._plot(entity, title, named, 1e6 * self.error[:, own])
                for entity, title, named, own in by_unit(
                    ERROR, "Error", self.rows, [f"u{unit}" for unit in its.row_units]
                )
            ),
            *self._inputs(),
            self._plot("actuators/displacement", "Displacements", moved, scaled),
            *self.extras,
            self._plot(SECONDARY, "Secondary [urad, um]", names, values),
        ]
        if (estimated := own.get("secondary_estimated")) is not None:
            plots.append(self._plot("secondary/estimated", "Estimated", names, 1e6 * estimated))
        if (gap_m := own["closure_residual_m"]).any():
            title, gap_nm = "Closure residual [nm]", 1e9 * gap_m[:, None]
            plots.append(self._plot(CLOSURE, title, ["closure [nm]"], gap_nm, flat=_SOLVER))
        return plots

    @property
    def panels(self) -> list[Plot]:
        """Signals that are shown, unless nothing changes."""
        shown = (ERROR, INPUT, SECONDARY, CLOSURE, *(plot.entity for plot in self.extras))
        return [plot for plot in self.signals if plot.entity.startswith(shown)]

    def _inputs(self) -> list[Plot]:
        """Inputs with their limits, and how near they come to them."""
        its, inputs, plots = self.stated, self.arrays["inputs"], list[Plot]()
        for entity, title, names, own in by_unit(INPUT, "Inputs", its.actuators, its.input_units):
            reached, levels = list[float](), set[float]()
            for k in own:
                low, high = (side[k] for side in its.limits)
                if low is not None and high is not None and high > low:
                    off = np.abs(inputs[:, k] - (low + high) / 2).max()
                    reached.append(float(off) / (0.5 * (high - low)))
                    levels |= {low, high}
            note = f"at most {100 * reached[greatest(reached)]:.0f} % of a limit" if reached else ""
            numbers = [(its.actuators.index(str(f.actuator)), f.time_s) for f in self.failures]
            failed = [(own.index(k), at_s) for k, at_s in numbers if k in own]
            marks: dict[str, Any] = {"levels": sorted(levels), "failed": failed, "note": note}
            plots.append(self._plot(entity, title, names, inputs[:, own], **marks))
        return plots

    def _plot(
        self, entity: str, title: str, names: Sequence[str], values: Array, **how: Any
    ) -> Plot:
        return Plot(entity, title, names, self.time_s, values, **how)


def by_unit(
    entity: str, title: str, names: Sequence[str], units: Sequence[str]
) -> list[tuple[str, str, list[str], list[int]]]:
    """One plot for each unit, as one axis has one: entity, title, names with units, columns."""
    found, each = list[tuple[str, str, list[str], list[int]]](), list(dict.fromkeys(units))
    for unit in each:
        own = [k for k, other in enumerate(units) if other == unit]
        where = entity if len(each) == 1 else f"{entity}/{unit.removeprefix('u')}"
        named = _with_units([names[k] for k in own], [unit] * len(own))
        found.append((where, f"{title} [{unit}]", named, own))
    return found


def _with_units(names: Sequence[str], units: Sequence[str]) -> list[str]:
    return [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]


PUBLISHED = {
    "desired": "desired_rad",
    "true": "true_rad",
    "measured": "measured_rad",
    "inputs": "strut_input_percent",
    "displacement": "strut_displacement_m",
}
"""Names of arrays in the data files of the hexapod's studies, by those of `Run.arrays`."""


def as_run_arrays(arrays: Mapping[str, Array]) -> Mapping[str, Array]:
    """The arrays of a data file by the names of `Run.arrays`."""
    if PUBLISHED["true"] not in arrays:
        return arrays
    task = np.concatenate([arrays["true_rad"], arrays["secondary"]], axis=1)
    own = {name: arrays[published] for name, published in PUBLISHED.items()}
    return {**arrays, **own, "task": task, "qpos": np.zeros((len(task), 0))}


def view_of(rig: Rig, run: Run) -> RunView:
    """A run as it is shown, and as it would be read back."""
    return RunView(stated_of(rig, run), run.arrays, rig.model)
