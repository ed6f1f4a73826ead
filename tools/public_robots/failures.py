"""Failures of public robots at several physics steps, as by `fjh paper recover --model`."""

from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import mujoco

from experiments.app.report import run_report
from sim import assemble, load_model
from tools.public_robots.registry import Model
from tools.public_robots.task_frame import task_frame
from tools.public_robots.trial import servo_hz

ROBOTS = ("robosuite/panda-robot", "robosuite/ur5e-robot", "robosuite/xarm7-robot")
"""Arms with torque motors; their files state dry friction of 0, 0.01 and up to 1 N m."""
STEPS_S = (0.001, 0.002, 0.005)


def simulate_failures(models: Iterable[Model], folder: Path) -> dict[str, Any]:
    """Simulate each failure of each arm, and runs without failure; return the report's index.

    Arms and steps with results in the folder are not simulated again.
    """
    files = {model.label: model.xml for model in models if model.label in ROBOTS}
    folder.mkdir(parents=True, exist_ok=True)
    studies: dict[str, tuple[str, dict[str, Any]]] = {}
    for label, step_s in product(ROBOTS, STEPS_S):
        name = f"{label.partition('/')[2].removesuffix('-robot')}_{1e3 * step_s:g}ms"
        spec: Any = mujoco.MjSpec.from_string(files[label])
        spec.option.timestep = step_s
        spec.compile()
        file = folder / f"{name}.xml"
        file.write_text(spec.to_xml())
        model = load_model(file)
        frame, _ = task_frame(model, assemble(model, mujoco.MjData(model)))
        options = {"model": file, "site": frame, "major": (3, 4, 5), "servo": servo_hz(model)}
        studies[name] = ("recover", options)
    return run_report(studies, folder, seed=0, quick=False, show=True)
