"""The six tracking experiments of section 4.2, in one of two configurations of the bench."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.rig.hexapod.columns import COLUMNS, Column
from experiments.rig.hexapod.controller import Loop, nominal_loops
from experiments.rig.hexapod.machine import detector_noise_rad
from experiments.rig.hexapod.metrics import plant_constants
from experiments.rig.hexapod.rig import hexapod_rig, pursuing
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.options import JacobianChoice
from experiments.rig.other_controller import fly_with
from experiments.rig.rig import Rig
from experiments.rig.run import Run
from experiments.study.controllers import controller_factory, controller_label
from experiments.study.parallel import in_parallel
from experiments.study.results import Picture
from experiments.study.study import OnProgress
from experiments.table1 import ConfigurationName
from experiments.table1.robustness import MismatchedRun, measured, mismatched_rigs
from sim import Array, Failure, ModelError, load_model, model_sha256


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
    run: Run
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
    runs: dict[str, Run]  # with that Jacobian
    other: dict[str, Run]  # with the other
    reseeded: Run  # W_a with the next seed: how much the noise alone changes an RMS
    predicted_rad: dict[str, Array]  # RMS by the linear model, (2,)
    mismatched: dict[str, MismatchedRun]  # on plants that are not the model
    controller: str | None = None  # another one, package.module:factory
    compared: tuple[Compared, ...] = ()  # its runs
    pictures: tuple[Picture, ...] = ()  # of the runs


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
    loops, constants = nominal_loops(machine, bench), plant_constants(machine)
    testbed, names = Testbed(machine, bench, loops), [column.name for column in COLUMNS]
    path = bench.spiral_rad(bench.quick_duration_s if quick else bench.duration_s)
    rig = hexapod_rig(testbed)
    rigs = {
        (choice, column.name): pursuing(rig, column.goal, jacobian=choice)
        for choice in (jacobian, other_jacobian(jacobian))
        for column in COLUMNS
    }
    _ = rig.machine.rest  # settled once for all processes
    own = {name: rigs[jacobian, name] for name in names}
    mismatched = mismatched_rigs(own, seed, quick=quick)

    def call(rig: Rig, column: Column, seed: int = seed, **how: Any) -> dict[str, Any]:
        return {"rig": rig, "path": path, "failures": column.failures, "seed": seed, **how}

    calls = [
        *(call(rig, BY_NAME[name]) for (_, name), rig in rigs.items()),
        call(own["W_a"], COLUMNS[0], seed + 1),
        *(call(own[column.name], column, controller=controller) for column in compared),
        *(call(rig, BY_NAME[name]) for name, rig in mismatched.items()),
    ]
    predicted, pictures = dict[str, Array](), list[Picture]()

    def meanwhile(found: list[Any]) -> Iterator[None]:
        predicted.update((name, _predicted_rad(own[name], path, name, seed)) for name in names)
        yield
        while not all(found[: len(names)]):
            yield
        for picture in _pictures({name: run for name, (run, _) in zip(names, found, strict=False)}):
            pictures.append(replace(picture, printed=picture.files()))
            yield

    done = iter(in_parallel(_simulated, calls, on_progress, meanwhile))

    def next_runs(names: Iterable[str]) -> dict[str, Run]:
        return {name: next(done)[0] for name in names}

    return Table1(
        seed=seed,
        configuration=chosen,
        machine_file=model,
        model_sha256=model_sha256(model),
        plant_constants=constants,
        loops=loops,
        jacobian=jacobian,
        runs=next_runs(names),
        other=next_runs(names),
        reseeded=next_runs(["W_a"])["W_a"],
        predicted_rad=predicted,
        controller=controller,
        compared=tuple(
            Compared(f"{controller_label(controller or '')}_{column.name}", column, *next(done))
            for column in compared
        ),
        mismatched={
            name: measured(name, rig, BY_NAME[name], next(done)[0], seed)
            for name, rig in mismatched.items()
        },
        pictures=tuple(pictures),
    )


BY_NAME = {column.name: column for column in COLUMNS}


def _simulated(
    rig: Rig, path: Array, failures: Sequence[Failure], seed: int, controller: str | None = None
) -> tuple[Run, str | None]:
    """A run, and the failure of its controller if it is another one."""
    how: dict[str, Any] = {"failures": failures, "seed": seed}
    if controller is not None:
        return fly_with(rig, controller, path, **how)
    return rig.fly(rig.controller(), path, **how), None


def _pictures(runs: dict[str, Run]) -> list[Picture]:
    from experiments.table1.figure import pictures  # late: workers draw nothing

    return pictures(runs)


def _predicted_rad(rig: Rig, path: Array, column: str, seed: int) -> Array:
    """RMS (2,) by the linear model: over all noise; with a limit, which needs one, this seed's."""
    bench, noise = rig.control.testbed.bench, None
    if bench.demand_limit_urad is not None:
        noise = detector_noise_rad(bench, seed, len(path))
    how = {"failures": BY_NAME[column].failures, "told": False}
    found = rig.predict(path, noise=noise, **how)
    if found.leaves is not None:
        raise ModelError(f"the loops of {column} are unstable on this machine")
    return found.rms
