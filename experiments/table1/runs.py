"""The six tracking experiments of section 4.2, in one of two configurations of the bench."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.rig.hexapod.bench import settled
from experiments.rig.hexapod.choices import ConfigurationName, JacobianChoice
from experiments.rig.hexapod.columns import COLUMNS, Column
from experiments.rig.hexapod.controller import Loop, nominal_loops
from experiments.rig.hexapod.metrics import plant_constants, rms
from experiments.rig.hexapod.rig import rig_of
from experiments.rig.hexapod.simulation import (
    SpiralRun,
    Trajectory,
    track_spiral,
    trajectory,
)
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.other_controller import fly_with
from experiments.study.controllers import controller_factory, controller_label
from experiments.study.parallel import in_parallel
from experiments.study.results import Picture
from experiments.study.study import OnProgress
from experiments.table1.robustness import MismatchedRun, measured, mismatched_flights
from sim import Array, ModelError, load_model, model_sha256


@dataclass(frozen=True)
class Configuration:
    """Constants around the plant, and how much of Table I they were fitted to."""

    name: ConfigurationName
    bench: TestbedConfig
    last_column: str  # where the errors of W_a_uncorrected come from
    fit: str  # what was fitted to how many cells, in one sentence

    def origin(self, column: str) -> str:
        """Where the errors of a column come from.

        Constants were fitted to them; they are those of W_a by construction, since the mapping
        meets J_m M = I whatever its weights and the known lock; or nothing was fitted to them.
        """
        return {"W_a": "fitted", "W_a_uncorrected": self.last_column}.get(column, "= W_a")


_LEVELS = (
    "Fitted to the ten entries of W_a to W_e: spiral radius and period, two crossovers, detector "
    "noise. They act on these entries as two numbers, the levels of alpha and beta"
)

CONFIGURATIONS: dict[ConfigurationName, Configuration] = {
    "calibrated": Configuration(
        "calibrated",
        TestbedConfig(),
        "predicted",
        f"{_LEVELS}; nothing was fitted to the two entries of the last column.",
    ),
    # Of the settings that docs/uncorrected.md maps, the one that fits the fewest numbers.
    "demand-limit": Configuration(
        "demand-limit",
        TestbedConfig(spiral_direction=-1, demand_limit_urad=95.0),
        "fitted",
        f"{_LEVELS}. Fitted to the two entries of the last column: the demand limit (a number) "
        "and the direction of the spiral (a binary choice).",
    ),
}


COMPARED = ("W_a", "W_d", "W_a_uncorrected")
"""Columns that another controller is compared with. It is told what is known in them; the weights
of the others differ for the prioritized mapping alone."""


@dataclass(frozen=True)
class Compared:
    """A run with another controller."""

    name: str  # of its column
    column: Column  # of this project's controller
    trajectory: Trajectory
    failure: str | None  # of the controller, a sentence


@dataclass(frozen=True)
class Table1:
    """All runs of the table, by column name where they are many."""

    seed: int
    configuration: Configuration
    machine_file: Path | None  # None is models/fjh.xml
    model_sha256: str
    plant_constants: dict[str, float | list[float]]
    loops: tuple[Loop, Loop]  # alpha, beta
    jacobian: JacobianChoice
    trajectories: dict[str, Trajectory]  # with that Jacobian
    other: dict[str, Trajectory]  # with the other
    reseeded: Trajectory  # W_a with the next seed: how much the noise alone changes an RMS
    predicted_rad: dict[str, Array]  # RMS by the linear model, (2,)
    mismatched: dict[str, MismatchedRun]  # on plants that are not the model
    controller: str | None = None  # another one, package.module:factory
    compared: tuple[Compared, ...] = ()  # its runs
    pictures: tuple[Picture, ...] = ()  # of the trajectories


def other_jacobian(jacobian: JacobianChoice) -> JacobianChoice:
    """The choice that the table is compared with."""
    return "constant" if jacobian == "analytic" else "analytic"


def run_table1(
    *,
    seed: int,
    quick: bool,
    on_progress: OnProgress,
    jacobian: JacobianChoice = "analytic",
    configuration: ConfigurationName = "calibrated",
    model: Path | None = None,
    controller: str | None = None,
) -> Table1:
    """Run the six experiments, each with both Jacobians, in parallel; `jacobian` makes the table.

    Some are flown once more on plants that are not the controller's model. Another `controller`
    runs three of them, too.

    Raises:
        WrongInput: There is no such controller.
        sim.ModelError: A missing, broken or incomplete machine file.
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    compared = []
    if controller is not None:
        controller_factory(controller)  # a wrong name is refused before anything runs
        compared = [column for column in COLUMNS if column.name in COMPARED]
    chosen, machine = CONFIGURATIONS[configuration], load_model(model)
    bench = chosen.bench
    duration_s = bench.quick_duration_s if quick else bench.duration_s
    loops, constants = nominal_loops(machine, bench), plant_constants(machine)
    testbed = settled(Testbed(machine, bench, loops))
    choices: tuple[JacobianChoice, JacobianChoice] = (jacobian, other_jacobian(jacobian))
    asked = [
        SpiralRun(c.goal, c.failures, jacobian=choice, seed=seed, duration_s=duration_s)
        for choice in choices
        for c in COLUMNS
    ]
    asked.append(replace(asked[0], seed=seed + 1))
    calls = [{"testbed": testbed, "run": run, "controller": None} for run in asked]
    calls += [
        {"testbed": testbed, "run": run, "controller": controller}
        for column, run in zip(COLUMNS, asked, strict=False)
        if column in compared
    ]
    names = [column.name for column in COLUMNS]
    by_name = dict(zip(names, asked, strict=False))
    flights = mismatched_flights(testbed, by_name, quick=quick)
    calls += [{"testbed": t, "run": run, "controller": None} for t, run in flights.values()]
    predicted, pictures = dict[str, Array](), list[Picture]()

    def meanwhile(found: list[Any]) -> Iterator[None]:
        predicted.update((name, _predicted_rad(name, testbed, by_name[name])) for name in names)
        yield
        while not all(found[: len(names)]):
            yield
        for picture in _pictures({name: run for name, (run, _) in zip(names, found, strict=False)}):
            pictures.append(replace(picture, printed=picture.files()))
            yield

    done = in_parallel(_track, calls, on_progress, meanwhile)
    runs, others = [run for run, _ in done[: len(asked)]], done[len(asked) :]
    flown = [run for run, _ in others[len(compared) :]]
    return Table1(
        seed=seed,
        configuration=chosen,
        machine_file=model,
        model_sha256=model_sha256(model),
        plant_constants=constants,
        loops=loops,
        jacobian=jacobian,
        trajectories=dict(zip(names, runs[: len(names)], strict=True)),
        other=dict(zip(names, runs[len(names) : -1], strict=True)),
        reseeded=runs[-1],
        predicted_rad=predicted,
        mismatched={
            name: measured(name, *flights[name], run)
            for name, run in zip(flights, flown, strict=True)
        },
        controller=controller,
        compared=tuple(
            Compared(f"{controller_label(controller or '')}_{column.name}", column, *other)
            for column, other in zip(compared, others, strict=False)
        ),
        pictures=tuple(pictures),
    )


def _track(
    testbed: Testbed, run: SpiralRun, controller: str | None
) -> tuple[Trajectory, str | None]:
    """A run, and the failure of its controller if it is another one."""
    if controller is None:
        return track_spiral(testbed, run), None
    bench = testbed.bench
    path = bench.desired_rad(bench.time_s(run.duration_s or bench.duration_s))
    flight = {"failures": run.failures, "seed": run.seed}
    flown, failed = fly_with(rig_of(testbed, run.goal), controller, path, **flight)
    return trajectory(flown), failed


def _pictures(runs: dict[str, Trajectory]) -> list[Picture]:
    from experiments.table1.figure import pictures  # late: workers draw nothing

    return pictures(runs)


def _predicted_rad(column: str, testbed: Testbed, run: SpiralRun) -> Array:
    """RMS (2,) by the linear model: over all noise; with a limit, which needs one, this seed's."""
    # Late: workers import this module, and only simulate.
    from experiments.rig.hexapod.prediction import predicted_error_rad, predicted_rms_rad

    if testbed.bench.demand_limit_urad is None:
        return predicted_rms_rad(testbed, run)
    error = predicted_error_rad(testbed, run)
    if error is None:
        raise ModelError(f"the loops of {column} are unstable on this machine")
    return rms(error)
