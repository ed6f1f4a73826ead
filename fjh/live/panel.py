"""Panel of the live page: buttons, and text on the machines."""

from collections import deque
from collections.abc import Callable
from html import escape

import numpy as np
import viser
from viser.uplot import Legend, Series

from fjh.live.gate import NOW
from fjh.live.live_run import Kind
from fjh.live.reference_path import PATHS
from fjh.live.session import Session
from fjh.live.stage import COLORS, NAMES, Stage
from fjh.rig.events import EVENTS
from fjh.rig.run import HEALTHY, rms
from fjh.rig.units import norms_text
from sim import Array

_KINDS: dict[str, Kind] = {"healthy": HEALTHY, "lock": "locked", "free": "free", "weak": "weak"}
LASTING = {"hum": "Hum", "stuck": "Stuck sensor", "sag": "Low supply voltage"}
_PLOTTED = 250
"""Number of frames in the plot of errors."""
_WEIGHTS = 0.1, 10.0
_TEXT = "padding:0 1em;font-size:0.875em;height:15em;overflow-y:auto"
"""Style of the text, with a fixed height so that buttons do not move."""


class Panel:
    """Panel next to the machines, with plot, text and buttons.

    Attributes:
        message: Text on the effect of the last click.
    """

    def __init__(
        self, server: viser.ViserServer, session: Session, stage: Stage,
        do: Callable[..., None], save: Callable[[], None],
    ) -> None:  # fmt: skip
        """Make all elements; `do` executes a click between ticks, `save` writes a recording."""
        self._session, self._do, gui = session, do, server.gui
        self._html = gui.add_html("")
        lines = [Series(label=n, stroke=c, width=2) for n, c in zip(NAMES, COLORS, strict=True)]
        self._plot = gui.add_uplot(
            (np.zeros(2), *[np.zeros(2)] * len(NAMES)), (Series(label="s"), *lines),
            scales={"x": {"time": False}}, axes=({}, {}), title="Error, % of the path's radius",
            height=170, legend=Legend(live=False),
        )  # fmt: skip
        self._add_failures(gui)
        self._add_control(gui)
        view = gui.add_slider("Magnification", 1, 10 * stage.factor, 1, stage.factor)
        view.on_update(lambda _: setattr(stage, "factor", view.value))
        gui.add_button("Save the last minute").on_click(lambda _: do(save))
        gui.add_button("New machines").on_click(lambda _: do(self._restart))
        self.reset("")

    def _add_failures(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._groups = list[viser.GuiButtonGroupHandle]()
        with gui.add_folder("Failures of actuators"):
            for k, name in enumerate(session.rig.actuators):
                group = gui.add_button_group(name, list(_KINDS))
                self._groups.append(group)
                group.on_click(
                    lambda event, k=k: self._do(session.make, k, _KINDS[event.target.value])
                )
        with gui.add_folder("Disturbances"):
            bump = gui.add_button("Bump", hint=EVENTS["bump"].sentence)
            bump.on_click(lambda _: self._do(self._bump))
            self._lasting = {}
            for name, label in LASTING.items():
                box = gui.add_checkbox(label, False, hint=EVENTS[name].sentence)
                box.on_update(
                    lambda event, name=name: self._do(session.disturb, name, event.target.value)
                )
                self._lasting[name] = box

    def _add_control(self, gui: viser.GuiApi) -> None:
        session, names = self._session, self._session.rig.actuators
        with gui.add_folder("Controller"):
            box = gui.add_checkbox("Diagnosis", True)
            box.on_update(lambda event: self._do(session.diagnose, event.target.value))
            path = gui.add_dropdown("Path", PATHS)
            path.on_update(lambda event: self._do(session.follow, event.target.value))
        weights = np.clip(session.goal.joint_weight or np.ones(len(names)), *_WEIGHTS)
        with gui.add_folder("Weights: cost of motion", expand_by_default=False):
            sliders = [
                gui.add_slider(f"W1 {name}", *_WEIGHTS, _WEIGHTS[0], float(weight))
                for name, weight in zip(names, weights, strict=True)
            ]
        for slider in sliders:
            slider.on_update(lambda _: self._do(lambda: session.weigh([s.value for s in sliders])))

    def _bump(self) -> None:
        self._session.disturb("bump")
        self.message = f"Bumped: {EVENTS['bump'].sentence}."

    def _restart(self) -> None:
        self._session.restart()
        self.reset("New machines, healthy and at rest.")

    def reset(self, message: str) -> None:
        """Clear plot and disturbances after a restart, and set the message."""
        self.message = message
        self._times = deque[float](maxlen=_PLOTTED)
        self._errors = [deque[float](maxlen=_PLOTTED) for _ in NAMES]
        for box in self._lasting.values():
            box.value = False

    def add_errors(self, done: int) -> None:
        """Append the RMS errors of the last `done` ticks to the plot."""
        if not done:
            return
        session = self._session
        self._times.append(session.tick * session.rig.period_s)
        for errors, error in zip(self._errors, self._rms(done), strict=True):
            errors.append(100.0 * float(np.linalg.norm(error)) / session.rig.size)

    def _rms(self, ticks: int) -> list[Array]:
        now = self._session.tick
        last = slice(max(0, now - ticks), now)
        return [rms(run.error(last)) for run in self._session.runs]

    def show(self, real_time_factor: float) -> None:
        """Update buttons, text and plot."""
        session, rig = self._session, self._session.rig
        for group, state in zip(self._groups, session.states, strict=True):
            now = tuple(f"{NOW}{w}" if kind == state else w for w, kind in _KINDS.items())
            if group.options != now:
                group.options = now
        second = round(1.0 / rig.period_s)
        failed = [f"{n} {s}" for n, s in zip(rig.actuators, session.states, strict=True)
                  if s != HEALTHY]  # fmt: skip
        active = [*failed, *(EVENTS[name].sentence for name in sorted(session.going_on))]
        rows = [
            f"<b style='color:{color}'>{name}</b> {norms_text(error, rig.row_units)} RMS<br>"
            f"{escape(run.diagnosis_text)}"
            for name, color, error, run in zip(
                NAMES, COLORS, self._rms(second), session.runs, strict=True
            )
        ]
        head = f"{session.tick * rig.period_s:.1f} s, {real_time_factor:.2f} of real time"
        state = escape(", ".join(active) or "all actuators are healthy")
        text = [head, f"<b>State:</b> {state}", *rows]
        if self.message:
            text.append(f"<i>{escape(self.message)}</i>")
        body = "".join(f"<div style='margin-bottom:0.5em'>{line}</div>" for line in text)
        self._html.content = f"<div style='{_TEXT}'>{body}</div>"
        if len(self._times) > 1:
            self._plot.data = (np.array(self._times), *map(np.array, self._errors))
