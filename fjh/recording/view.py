"""View of a run of any robot for recordings, reviews and animations."""

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
from fjh.recording.motion import BODIES, Mover, displacement, magnification, motion_of, mover
from fjh.recording.signals import Line, Plot
from fjh.rig import Rig, Run
from fjh.rig.run import HEALTHY
from fjh.rig.units import ROWS, quantity_text
from fjh.study.palette import BLACK, FAILED, GREEN, ORANGE
from sim.mjcf import model_sha256

ERROR, INPUT, SECONDARY = "task/error", "actuators/input", "secondary/true"
CLOSURE = "closure/residual"
"""Entity of the closure residual."""
_HEXAPOD_ROWS = ("alpha", "beta", "gamma", "t_x", "t_y", "t_z")
_PERCENT = 100.0
"""Largest input of the hexapod's coils [%]."""
_SOLVER = 0.05
"""Largest variation, in [nm] or relative, with which a closure residual counts as constant."""
_SOON_S = 1e-9


@dataclass(frozen=True)
class Change:
    """Change of an actuator's state or diagnosis (`HEALTHY`: no failure), or another event."""

    actuator: str | None  # name; None for an event without a single actuator
    kind: str  # kind of failure, or name of the event
    time_s: float  # onset [s]


@dataclass(frozen=True)
class Stated:
    """Description of a run that its recording contains: all data of its view except the arrays.

    The robot has n actuators and m1 major rows. Sequences are lists, for JSON.
    """

    robot: str  # name of the robot
    hexapod: bool  # whether loops are closed for drawing, and struts coloured by their inputs
    model_file: str  # MJCF; empty: that of the hexapod
    model_sha256: str
    actuators: list[str]
    actuator_units: list[str]  # units of displacements (n,): "rad", "m"
    input_units: list[str]  # units of inputs (n,): "rad", "m", "%"
    limits: list[list[float | None]]  # lower and upper inputs (2, n); None: unlimited
    bodies: list[list[str]]  # bodies that each actuator moves, (n,)
    rows: list[str]  # names of all six rows of the twist
    major: list[int]  # numbers of the major rows (m1,)
    row_units: list[str]  # units of the major rows (m1,): "rad", "m"
    incidents: list[Change] = field(default_factory=list)  # failures and other events
    diagnoses: list[Change] = field(default_factory=list)
    known: str = ""  # addition to each failure's text, such as whether the controller is informed
    status: str = ""  # sentence on the controller's diagnoses

    def text(self, incident: Change) -> str:
        """Return an incident as text, such as "motor4 locked"."""
        parts = [incident.actuator or "", incident.kind]
        return " ".join(parts).strip() + (f", {self.known}" if self.known else "")


def stated_of(
    rig: Rig, run: Run | None = None, *, known: str = "", machine_file: Path | None = None
) -> Stated:
    """Return the description of a run, or of a robot without incidents if the run is None.

    `machine_file` is the MJCF of a rig that has no file; None: that of the hexapod.
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
    """Return failures and other events in the order of time, without duplicates."""
    pairs = [(failure, failure.kind) for failure in run.failures]
    pairs += [(event, event.name) for event in run.events]
    changes = dict[tuple[object, ...], Change]()
    for k, (incident, kind) in enumerate(pairs):
        name = None if incident.actuator is None else rig.actuators[int(incident.actuator)]
        change = Change(name, kind, float(incident.time_s))
        changes.setdefault((k,) if name is None else (name, change.time_s), change)
    return in_order(changes.values())


def _diagnoses(run: Run) -> list[Change]:
    changes = [Change(one.actuator, one.kind, one.time_s) for one in run.diagnoses]
    changes += [
        Change(one.actuator, HEALTHY, one.withdrawn_s)
        for one in run.diagnoses
        if one.withdrawn_s is not None
    ]
    return in_order(changes)


def in_order(changes: Any) -> list[Change]:
    """Return changes in the order of time."""
    return sorted(changes, key=lambda change: change.time_s)


@dataclass(frozen=True)
class RunView:
    """View of a run: N ticks of a robot with n actuators and m1 major rows."""

    stated: Stated
    arrays: Mapping[str, Array]  # arrays with the names of `Run.arrays`; the hexapod needs no qpos
    model: mujoco.MjModel
    extras: Sequence[Plot] = ()  # plots in addition to those of every run

    @property
    def time_s(self) -> Array:
        """Times of the ticks [s], (N,)."""
        return self.arrays["time_s"]

    @property
    def rows(self) -> list[str]:
        """Names of the major rows."""
        return [self.stated.rows[row] for row in self.stated.major]

    @property
    def scales(self) -> tuple[object, ...]:
        """Key that is equal for runs with common scales."""
        stated = self.stated
        return stated.robot, *stated.actuators, *self.rows, *stated.row_units, self.model.nbody

    @property
    def plane_columns(self) -> list[int]:
        """Columns of the major rows that have the unit of the first; two of them span the plane."""
        units = self.stated.row_units
        return [k for k, unit in enumerate(units) if unit == units[0]]

    @cached_property
    def motion(self) -> Mover:
        """Function that magnifies the bodies' motion."""
        return mover(self.model, self.stated.hexapod, self.arrays["qpos"][0])

    @cached_property
    def factor(self) -> int:
        """Magnification factor that makes the motion visible."""
        if self.stated.hexapod:
            return magnification(self.arrays["task"][:, :3], self.arrays["task"][:, 3:])
        ticks = slice(1), stills(self.time_s)
        nominal, seen = (motion_of(self.model, self.arrays["qpos"][at]) for at in ticks)
        return magnification(*displacement(seen, nominal))

    @cached_property
    def error(self) -> Array:
        """Error of the major rows, desired minus true, [rad] or [m], (N, m1)."""
        return self.arrays["desired"] - self.arrays["true"]

    def rms(self, ticks: slice = slice(None)) -> Array:
        """Return the RMS error of each major row over a slice of ticks, [rad] or [m], (m1,)."""
        return np.sqrt((self.error[ticks] ** 2).mean(axis=0))

    @property
    def parts(self) -> dict[str, slice]:
        """Slices of the ticks before and after the first incident, without empty ones."""
        first_s = min((change.time_s for change in self.stated.incidents), default=np.inf)
        cut = int(np.searchsorted(self.time_s, first_s - _SOON_S))
        parts = {"before": slice(cut), "after": slice(cut, None)}
        return {when: part for when, part in parts.items() if len(self.time_s[part])}

    def rms_text(self) -> str:
        """Return the RMS errors as text: "x 2.1 µm before; x 27.8 µm after"."""
        texts = []
        for when, ticks in self.parts.items():
            rows = zip(self.rows, self.rms(ticks), self.stated.row_units, strict=True)
            text = ", ".join(f"{row} {quantity_text(value, unit)}" for row, value, unit in rows)
            texts.append(f"{text} {when}" if self.stated.incidents else text)
        return "; ".join(texts)

    def diagnosis_of(self, incident: Change) -> Change | None:
        """Return the first diagnosis of an incident's actuator since onset, or None."""
        since = (
            change
            for change in self.stated.diagnoses
            if change.actuator == incident.actuator
            and change.time_s >= incident.time_s - _SOON_S
            and change.kind != HEALTHY
        )
        return next(since, None)

    @property
    def failures(self) -> list[Change]:
        """Incidents that are failures of actuators."""
        return [one for one in self.stated.incidents if one.actuator and one.kind != HEALTHY]

    @property
    def failing(self) -> list[Failing]:
        """Bodies of each failed actuator, with labels from its onset and its diagnosis on."""
        marks = list[Failing]()
        for failure in self.failures:
            text, diagnosis = self.stated.text(failure), self.diagnosis_of(failure)
            labels = [(failure.time_s, text)]
            if diagnosis is not None:
                delay_ms = 1e3 * (diagnosis.time_s - failure.time_s)
                diagnosed = f"{text}, diagnosed as {diagnosis.kind} after {delay_ms:.0f} ms"
                labels.append((diagnosis.time_s, diagnosed))
            bodies = self.stated.bodies[self.stated.actuators.index(str(failure.actuator))]
            marks.append((bodies, labels))
        return marks

    @property
    def lines(self) -> list[Line]:
        """Incidents and diagnoses with their colours, in the order of time."""
        lines = [
            Line(one.time_s, self.stated.text(one), FAILED if one.actuator else ORANGE)
            for one in self.stated.incidents
        ] + [
            Line(one.time_s, f"{one.actuator} cleared", GREEN)
            if one.kind == HEALTHY
            else Line(one.time_s, f"diagnosis: {one.actuator} {one.kind}", BLACK)
            for one in self.stated.diagnoses
        ]
        return sorted(lines, key=lambda line: line.time_s)

    @property
    def lanes(self) -> dict[str, list[tuple[float, str]]]:
        """Lanes over time: states, and diagnoses, of each actuator that has incidents or diagnoses.

        Lanes of diagnoses exist only if there is a diagnosis.
        """
        start_s, stated = float(self.time_s[0]), self.stated
        lanes = dict[str, list[tuple[float, str]]]()
        changed = [*stated.incidents, *stated.diagnoses]
        for name in stated.actuators:
            if not any(change.actuator == name for change in changed):
                continue
            for label, history in (("is", stated.incidents), ("taken for", stated.diagnoses)):
                changes = [(one.time_s, one.kind) for one in history if one.actuator == name]
                if changes or (stated.diagnoses and label != "is"):
                    lane = [] if changes and changes[0][0] <= start_s else [(start_s, HEALTHY)]
                    lanes[f"{name} {label}"] = [*lane, *changes]
        return lanes

    @property
    def secondary(self) -> tuple[list[str], Array]:
        """Names with units and values (N, 6 - m1) [urad], [um] of the rows that are not major."""
        rows = [row for row in range(len(ROWS)) if row not in self.stated.major]
        units = ["urad" if row < len(ROWS) // 2 else "um" for row in rows]
        names = [self.stated.rows[row] for row in rows]
        return _with_units(names, units), 1e6 * self.arrays["task"][:, rows]

    @cached_property
    def signals(self) -> list[Plot]:
        """Signals at every tick; those with a panel are in the order of relevance."""
        stated, arrays, um = self.stated, self.arrays, "u" if self.stated.hexapod else ""
        row_units = [f"u{unit}" for unit in stated.row_units]
        rows = _with_units(self.rows, row_units)
        moved = _with_units(stated.actuators, [um + unit for unit in stated.actuator_units])
        scaled = (1e6 if um else 1.0) * arrays["displacement"]
        names, values = self.secondary
        plots = [
            self._plot("task/desired", "Desired", rows, 1e6 * arrays["desired"]),
            self._plot("task/true", "True", rows, 1e6 * arrays["true"]),
            self._plot("task/measured", "Measured", rows, 1e6 * arrays["measured"]),
            *(
                self._plot(entity, title, labels, 1e6 * self.error[:, columns])
                for entity, title, labels, columns in by_unit(ERROR, "Error", self.rows, row_units)
            ),
            *self._inputs(),
            self._plot("actuators/displacement", "Displacements", moved, scaled),
            *self.extras,
            self._plot(SECONDARY, "Secondary [urad, um]", names, values),
        ]
        if (estimated := arrays.get("secondary_estimated")) is not None:
            plots.append(self._plot("secondary/estimated", "Estimated", names, 1e6 * estimated))
        if (gap_m := arrays["closure_residual_m"]).any():
            title, gap_nm = "Closure residual [nm]", 1e9 * gap_m[:, None]
            plots.append(self._plot(CLOSURE, title, ["closure [nm]"], gap_nm, flat=_SOLVER))
        return plots

    @property
    def panels(self) -> list[Plot]:
        """Signals with a view if they are not constant."""
        entities = (ERROR, INPUT, SECONDARY, CLOSURE, *(plot.entity for plot in self.extras))
        return [plot for plot in self.signals if plot.entity.startswith(entities)]

    def _inputs(self) -> list[Plot]:
        """Return plots of the inputs, by unit, with limits and the largest fraction of a limit."""
        stated, inputs, plots = self.stated, self.arrays["inputs"], list[Plot]()
        groups = by_unit(INPUT, "Inputs", stated.actuators, stated.input_units)
        for entity, title, names, columns in groups:
            reached, levels = list[float](), set[float]()
            for k in columns:
                low, high = (side[k] for side in stated.limits)
                if low is not None and high is not None and high > low:
                    off = np.abs(inputs[:, k] - (low + high) / 2).max()
                    reached.append(float(off) / (0.5 * (high - low)))
                    levels |= {low, high}
            note = f"at most {100 * reached[greatest(reached)]:.0f} % of a limit" if reached else ""
            numbers = [(stated.actuators.index(str(f.actuator)), f.time_s) for f in self.failures]
            failed = [(columns.index(k), at_s) for k, at_s in numbers if k in columns]
            marks: dict[str, Any] = {"levels": sorted(levels), "failed": failed, "note": note}
            plots.append(self._plot(entity, title, names, inputs[:, columns], **marks))
        return plots

    def _plot(
        self, entity: str, title: str, names: Sequence[str], values: Array, **how: Any
    ) -> Plot:
        return Plot(entity, title, names, self.time_s, values, **how)


def by_unit(
    entity: str, title: str, names: Sequence[str], units: Sequence[str]
) -> list[tuple[str, str, list[str], list[int]]]:
    """Return entity, title, names with units, and columns of one plot for each unit."""
    plots, distinct = list[tuple[str, str, list[str], list[int]]](), list(dict.fromkeys(units))
    for unit in distinct:
        columns = [k for k, other in enumerate(units) if other == unit]
        path = entity if len(distinct) == 1 else f"{entity}/{unit.removeprefix('u')}"
        labels = _with_units([names[k] for k in columns], [unit] * len(columns))
        plots.append((path, f"{title} [{unit}]", labels, columns))
    return plots


def _with_units(names: Sequence[str], units: Sequence[str]) -> list[str]:
    return [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]


PUBLISHED = {
    "desired": "desired_rad",
    "true": "true_rad",
    "measured": "measured_rad",
    "inputs": "strut_input_percent",
    "displacement": "strut_displacement_m",
}
"""Names of arrays in data files of the hexapod's studies, by their names in `Run.arrays`."""


def as_run_arrays(arrays: Mapping[str, Array]) -> Mapping[str, Array]:
    """Return the arrays of a data file with the names of `Run.arrays`."""
    if PUBLISHED["true"] not in arrays:
        return arrays
    task = np.concatenate([arrays["true_rad"], arrays["secondary"]], axis=1)
    renamed = {name: arrays[published] for name, published in PUBLISHED.items()}
    return {**arrays, **renamed, "task": task, "qpos": np.zeros((len(task), 0))}


def view_of(rig: Rig, run: Run) -> RunView:
    """Return the view of a run, equal to the one read from its recording."""
    return RunView(stated_of(rig, run), run.arrays, rig.model)
