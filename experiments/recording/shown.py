"""A flight of any robot as recordings, reviews and animations take it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
import rerun as rr

from argument_checks.ties import greatest
from experiments.recording import Array
from experiments.recording.machine import Motion
from experiments.recording.marks import SOUND, Belief, Mark
from experiments.recording.signals import Line, Plot
from experiments.rig.units import said
from experiments.study.palette import BLACK, FAILED, GREEN, ORANGE

Ticks = slice | Sequence[int]

ERROR, INPUT, SECONDARY = "task/error", "actuators/input", "secondary/true"
"""Entities of those signals that have a panel of their own."""
CLOSURE = "closure/residual"
_SOLVER = 0.05
"""A gap of the loops that varies by less, in [nm] or of its size, is a constant of the solver's."""
_SOON_S = 1e-9


@dataclass(frozen=True)
class Shown:
    """A flight of N ticks of a robot with n actuators and m1 major rows.

    Attributes:
        robot: Its name.
        model: Of it.
        time_s: (N,).
        rows: Names of the major rows.
        row_units: Of them, "rad" or "m".
        desired: (N, m1).
        true: (N, m1).
        measured: (N, m1).
        actuators: Their names.
        input_units: Of their inputs: "rad", "m" or "%".
        inputs: (N, n).
        limits: Lower and upper inputs (n,), infinite where there is none.
        units: Of their displacements, "rad" or "m".
        displacement: (N, n).
        bodies: That each of them moves; empty of what moves none.
        secondary: The other rows of the task frame, names with units and values [urad], [um].
        estimated: The same as the controller has it; None where it is not kept.
        closure_m: (N,) largest gap of a closed loop.
        motion: Of its bodies at some ticks, magnified by a factor.
        factor: By which the motion is to be magnified to be seen.
        marks: Failures, in the order of time.
        beliefs: What the diagnosis took actuators for.
        happenings: What else happened: times and words.
        status: What the pilot made of the flight, one sentence; empty where nobody says.
        extras: Plots beside those that every flight has.
        colored: Whether the bodies of actuators are coloured by their inputs.
        fixtures: What else is drawn on bodies, by entities below them.
    """

    robot: str
    model: mujoco.MjModel
    time_s: Array
    rows: tuple[str, ...]
    row_units: tuple[str, ...]
    desired: Array
    true: Array
    measured: Array
    actuators: tuple[str, ...]
    input_units: tuple[str, ...]
    inputs: Array
    limits: tuple[Array, Array]
    units: tuple[str, ...]
    displacement: Array
    bodies: tuple[tuple[str, ...], ...]
    secondary: tuple[Sequence[str], Array]
    estimated: Array | None
    closure_m: Array
    motion: Callable[[Ticks, float], Motion]
    factor: int
    marks: Sequence[Mark] = ()
    beliefs: Sequence[Belief] = ()
    happenings: Sequence[tuple[float, str]] = ()
    status: str = ""
    extras: Sequence[Plot] = ()
    colored: bool = False
    fixtures: tuple[tuple[str, rr.AsComponents], ...] = ()

    @property
    def kind(self) -> tuple[object, ...]:
        """What runs have in common that can be drawn on the same scales."""
        return self.robot, self.actuators, self.rows, self.row_units, self.model.nbody

    @property
    def drawn(self) -> list[int]:
        """Columns of the major rows in the unit of the first; two of them are a plane."""
        return [k for k, unit in enumerate(self.row_units) if unit == self.row_units[0]]

    @cached_property
    def error(self) -> Array:
        """Desired minus true, (N, m1)."""
        return self.desired - self.true

    def rms(self, ticks: slice = slice(None)) -> Array:
        """RMS error of each major row over some ticks, (m1,)."""
        return np.sqrt((self.error[ticks] ** 2).mean(axis=0))

    @property
    def parts(self) -> dict[str, slice]:
        """Ticks before and after something happened, of those that there are."""
        cut, parts = self.first_tick, dict[str, slice]()
        if cut:
            parts["before"] = slice(cut)
        if cut < len(self.time_s):
            parts["after"] = slice(cut, None)
        return parts

    def rms_said(self) -> str:
        """The RMS errors as of `fjh track`: "x 2.1 µm before; x 27.8 µm after"."""
        found = []
        for when, ticks in self.parts.items():
            named = zip(self.rows, self.rms(ticks), self.row_units, strict=True)
            each = ", ".join(f"{row} {said(value, unit)}" for row, value, unit in named)
            found.append(f"{each} {when}" if self.happened else each)
        return "; ".join(found)

    @property
    def happened(self) -> list[tuple[float, str]]:
        """Failures and other events, in the order of time."""
        failures = [(mark.failed_s, mark.failure) for mark in self.marks]
        return sorted([*failures, *self.happenings], key=lambda one: one[0])

    @property
    def first_tick(self) -> int:
        """From which on something has happened; N where nothing does."""
        first_s = min((at_s for at_s, _ in self.happened), default=np.inf)
        return int(np.searchsorted(self.time_s, first_s - _SOON_S))

    @property
    def lines(self) -> list[Line]:
        """All events with their colours, in the order of time."""
        failures = [Line(mark.failed_s, mark.failure, FAILED) for mark in self.marks]
        others = [Line(at_s, text, ORANGE) for at_s, text in self.happenings]
        named = [Line(b.time_s, self._said(b), BLACK) for b in self.beliefs if b.kind != SOUND]
        back = [Line(b.time_s, self._said(b), GREEN) for b in self.beliefs if b.kind == SOUND]
        return sorted([*failures, *others, *named, *back], key=lambda line: line.time_s)

    def _said(self, belief: Belief) -> str:
        name = self.actuators[belief.actuator]
        return f"{name} cleared" if belief.kind == SOUND else f"{name} named {belief.kind}"

    @property
    def lanes(self) -> dict[str, list[tuple[float, str]]]:
        """Of each actuator that fails or is named: its state over time, and what it is taken for.

        Without a diagnosis there are no lanes of what it is taken for.
        """
        begin_s, lanes = float(self.time_s[0]), dict[str, list[tuple[float, str]]]()
        for number in sorted({each.actuator for each in (*self.marks, *self.beliefs)}):
            fails = [(m.failed_s, m.kind or "failed") for m in self.marks if m.actuator == number]
            taken = [(b.time_s, b.kind) for b in self.beliefs if b.actuator == number]
            for words, changes in (("is", fails), ("taken for", taken)):
                if changes or (self.beliefs and words != "is"):
                    lane = [] if changes and changes[0][0] <= begin_s else [(begin_s, SOUND)]
                    lanes[f"{self.actuators[number]} {words}"] = [*lane, *changes]
        return lanes

    @property
    def sentences(self) -> list[tuple[float, str]]:
        """What is known of the flight from each time on, and its status at the end."""
        begin_s = float(self.time_s[0])
        found = {begin_s: "Nothing has happened."}
        for at_s, text in self.happened:
            told = ", and the diagnosis names nothing so far" if self.beliefs else ""
            found[max(begin_s, at_s)] = f"{text} at {at_s:.3f} s{told}."
        for belief in self.beliefs:
            since = [m.failed_s for m in self.marks if m.actuator == belief.actuator]
            after = [1e3 * (belief.time_s - at_s) for at_s in since if at_s <= belief.time_s]
            delay = f", {after[-1]:.0f} ms after it failed" if after else ""
            found[belief.time_s] = f"{self._said(belief)} at {belief.time_s:.3f} s{delay}."
        if self.status:
            found[float(self.time_s[-1])] = self.status
        return sorted(found.items())

    @cached_property
    def signals(self) -> list[Plot]:
        """All that is logged, at every tick."""
        names = _named(self.rows, [f"u{unit}" for unit in self.row_units])
        moved = 1e6 if self.colored else 1.0
        of_units = [f"u{unit}" if self.colored else unit for unit in self.units]
        plots = [
            self._plot("task/desired", "Desired", names, 1e6 * self.desired),
            self._plot("task/true", "True", names, 1e6 * self.true),
            self._plot("task/measured", "Measured", names, 1e6 * self.measured),
            *self._by_unit(ERROR, "Error", self.rows, "u", self.row_units,
                           1e6 * self.error),
            *self._inputs(),
            self._plot("actuators/displacement", "Displacements", _named(self.actuators, of_units),
                       moved * self.displacement),
            self._plot(SECONDARY, "Secondary [urad, um]", *self.secondary),
        ]  # fmt: skip
        if self.estimated is not None:
            estimated = self.secondary[0], self.estimated
            plots.append(self._plot("secondary/estimated", "Estimated", *estimated))
        if self.closure_m.any():
            gap_nm = 1e9 * self.closure_m[:, None]
            plot = self._plot(CLOSURE, "Closure residual [nm]", ["closure [nm]"], gap_nm)
            plots.append(replace(plot, flat=_SOLVER))
        return [*plots, *self.extras]

    def _inputs(self) -> list[Plot]:
        """With their limits, and how near they come to them."""
        plots, (lower, upper) = [], self.limits
        reached = {
            k: float(np.abs(self.inputs[:, k] - (lower[k] + upper[k]) / 2).max())
            / (0.5 * (upper[k] - lower[k]))
            for k in range(len(self.actuators))
            if np.isfinite(upper[k] - lower[k]) and upper[k] > lower[k]
        }
        for plot in self._by_unit(
            INPUT, "Inputs", self.actuators, "", self.input_units, self.inputs
        ):
            own = [k for k, unit in enumerate(self.input_units) if plot.title.endswith(f"[{unit}]")]
            limited, note = [k for k in own if k in reached], ""
            if limited:
                most = limited[greatest([reached[k] for k in limited])]
                note = f"at most {100 * reached[most]:.0f} % of a limit"
            plots.append(
                replace(
                    plot,
                    note=note,
                    levels=sorted({float(each[k]) for each in self.limits for k in limited}),
                    failed=[(own.index(m.actuator), m.failed_s) for m in self.marks
                            if m.actuator in own],
                )
            )  # fmt: skip
        return plots

    def _plot(self, entity: str, title: str, names: Sequence[str], values: Array) -> Plot:
        return Plot(entity, title, names, self.time_s, values)

    def _by_unit(
        self,
        entity: str,
        title: str,
        names: Sequence[str],
        prefix: str,
        units: Sequence[str],
        values: Array,
    ) -> list[Plot]:
        """One plot for each unit, as one axis has one."""
        each = list(dict.fromkeys(units))
        plots = []
        for unit in each:
            own = [k for k, other in enumerate(units) if other == unit]
            called = _named([names[k] for k in own], [prefix + unit] * len(own))
            where = entity if len(each) == 1 else f"{entity}/{unit}"
            plots.append(self._plot(where, f"{title} [{prefix}{unit}]", called, values[:, own]))
        return plots


def _named(names: Sequence[str], units: Sequence[str]) -> list[str]:
    return [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
