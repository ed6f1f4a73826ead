"""A run of a sweep, simulated and predicted: a row of numbers and words."""

from collections.abc import Sequence
from functools import cache, lru_cache

import mujoco
import numpy as np
import pyarrow as pa

from experiments.rig.conditions import every_condition
from experiments.rig.hexapod import fault_tolerance
from experiments.rig.hexapod.columns import MAJOR, secondary
from experiments.rig.hexapod.controller import StrutMapping, designed, nominal_plant
from experiments.rig.hexapod.machine import detector_noise_rad
from experiments.rig.hexapod.rig import hexapod_rig, pursuing
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.prediction import MARGINAL, open_loop, pole_radius
from experiments.rig.rig import Rig
from experiments.rig.run import Run, rms
from experiments.rig.verdicts import names_of
from experiments.study.campaign import Row
from experiments.sweep.sweep_run import KINDS, SweepRun
from ftc.control.compensator import Compensator
from ftc.fdi.fault_model import Fault
from prioritized import FailureAtlas, failure_atlas
from sim import NOMINAL, Array, ModelError, SimulationDiverged, hexapod, load_model

ANGLES = ("alpha", "beta")
JACOBIANS = ("constant", "analytic")
"""Of the nominal pose, and of the estimated one at every tick."""
INPUT_RMS = tuple(f"strut_input_rms_percent_{k}" for k in range(1, 7))
INPUT_PEAK = tuple(f"strut_input_peak_percent_{k}" for k in range(1, 7))
PREDICTED = tuple(f"predicted_{angle}_rms_urad" for angle in ANGLES)
MEASURED = (
    *(f"{angle}_{what}_urad" for what in ("rms", "peak", "measured_rms") for angle in ANGLES),
    *INPUT_RMS,
    *INPUT_PEAK,
    *("gamma_peak_urad", "t_x_peak_um", "t_y_peak_um", "t_z_peak_um"),
    "closure_residual_max_m",
)
_NUMBERS = ("diverged_at_s", "dac_step_urad", "predicted_pole_radius")
_TYPES = {
    "integer": pa.int64(),
    "sign": pa.int64(),
    "switch": pa.bool_(),
    "real": pa.float64(),
}

SCHEMA = pa.schema(
    [
        *((name, pa.int64()) for name in ("case", "seed")),
        ("duration_s", pa.float64()),
        *((name, _TYPES.get(kind, pa.string())) for name, kind in KINDS.items() if name != "seed"),
        *((name, pa.string()) for name in ("status", "message")),
        *((name, pa.float64()) for name in (*_NUMBERS, *PREDICTED, *MEASURED)),
    ]
)
"""Columns of a sweep's dataset."""


@cache
def machine() -> mujoco.MjModel:
    """The hexapod, once in each process however many runs it does; plants copy it."""
    return load_model()


@cache
def stiffness() -> Array:
    """Where free struts go, (12, 12)."""
    return fault_tolerance.strut_and_payload_stiffness(machine())


_nominal_plant = cache(lambda: nominal_plant(machine()))


@lru_cache(maxsize=64)
def loops(bench: TestbedConfig) -> tuple[Compensator, Compensator]:
    """The (alpha, beta) compensators for a testbed; `ModelError` if a loop cannot be closed."""
    return designed(*_nominal_plant(), bench)


def row_of(run: SweepRun) -> Row:
    """The row of a run, which is simulated here.

    Returns:
        Its parameters, its `status`, and what was measured, as far as there is any. A run to the
        end has the status of its mapping, "exact" where it meets the pointing task, or "unstable",
        if the linear model's loop is. Others are "diverged": the physics left the finite numbers;
        or "refused": the loops cannot be closed on this bench, or physics not stepped at its rate.
    """
    row = run.parameters()
    try:
        # As it is after the failures, at J_0.
        mapping = StrutMapping(hexapod(machine()), run.reconfigured, "constant", stiffness())
        predicted = _predicted(run)
        status = mapping.at(mapping.nominal).mapping.status
        row |= predicted | {"status": status.name.lower()}
        row["dac_step_urad"] = _dac_step_urad(run, mapping)
        if predicted and PREDICTED[0] not in predicted:
            row["status"] = "unstable"
        return row | measured(simulated(run))
    except SimulationDiverged as diverged:
        found = {"status": "diverged", "message": str(diverged), "diverged_at_s": diverged.time_s}
        return row | found
    except ModelError as refused:
        return row | {"status": "refused", "message": str(refused)}


def simulated(run: SweepRun) -> Run:
    """The run; raises as the simulation does."""
    rig, path = _rig(run), run.bench.spiral_rad(run.duration_s)
    controller = rig.controller()
    if run.known and run.failure_time_s > 0 and run.failures:
        controller = rig.reconfigured(run.goal, run.reconfigured, run.failure_time_s)
    return rig.fly(controller, path, failures=run.failures, seed=run.seed)


def _rig(run: SweepRun) -> Rig:
    """The hexapod with what the mapping knows from the start as goal."""
    goal = run.reconfigured if run.failure_time_s == 0 else run.goal
    return pursuing(_rig_of(run.bench), goal, jacobian=run.jacobian)


@lru_cache(maxsize=8)
def _rig_of(bench: TestbedConfig) -> Rig:
    """The hexapod with these constants, linearized and settled once for all its runs."""
    return hexapod_rig(Testbed(machine(), bench, loops(bench), stiffness()))


def _predicted(run: SweepRun) -> Row:
    """Largest pole of the linear, sampled loop, and the RMS errors if the loop is stable.

    Empty where the plant is not the linear model's: it changes during the run, or a strut falls on
    its stop, as one without its spring does.
    """
    if any(failure.time_s > 0 or failure.kind == "loose" for failure in run.failures):
        return {}
    rig, faults = _rig(run), [Fault.of(failure) for failure in run.failures]
    row: Row = {"predicted_pole_radius": pole_radius(open_loop(rig, rig.goal, faults))}
    if row["predicted_pole_radius"] > MARGINAL:
        return row
    path = run.bench.spiral_rad(run.duration_s)
    noise = detector_noise_rad(run.bench, run.seed, len(path))
    found = rig.predict(path, failures=run.failures, told=False, noise=noise)
    return row | dict(zip(PREDICTED, (1e6 * rms(found.error)).tolist(), strict=True))


def _dac_step_urad(run: SweepRun, mapping: StrutMapping) -> float:
    """Pointing moved by one step of one strut's converter: the loops cannot command less."""
    amplifier = run.bench.amplifier(newton_per_m=float(machine().actuator_gainprm[0, 0]))
    step_m = amplifier.displacements(np.eye(6) * 100 / 2 ** (run.bench.dac_bits - 1))
    steps_rad = [mapping.major_motion(strut_m, NOMINAL) for strut_m in step_m]
    return 1e6 * float(np.linalg.norm(steps_rad, axis=1).max())


def measured(run: Run) -> Row:
    """What the row has of a run to the end."""
    values = (
        1e6 * run.rms(),
        1e6 * np.abs(run.error).max(0),
        1e6 * rms(run.desired - run.measured),
        rms(run.inputs),
        np.abs(run.inputs).max(0),
        1e6 * np.abs(secondary(run)).max(0),
        [run.closure_max_m],
    )
    return dict(zip(MEASURED, np.concatenate(values).tolist(), strict=True))


@cache
def classified() -> FailureAtlas:
    """All failure conditions of the hexapod, (alpha, beta) being the major task."""
    return failure_atlas(fault_tolerance.elastic_system(machine()), MAJOR)


def verdict_columns(struts: Sequence[str]) -> dict[str, np.ndarray]:
    """The atlas' own columns: the classification of conditions of the struts."""
    atlas = classified()
    elastic = atlas.elastic
    assert elastic is not None  # the hexapod has springs
    columns = {
        "verdict": names_of(fault_tolerance.pointing_verdicts(atlas)),
        "failures": (atlas.codes != 0).sum(axis=1),
        "rigid_possible": atlas.possible,
        "rigid_unstable_major": atlas.unstable_major,
        "rigid_worst_gain_rad_per_m": atlas.worst_gain,
        "elastic_possible": elastic.possible,
        "elastic_major_rank": elastic.major_rank,
        "elastic_worst_gain_rad_per_m": elastic.worst_gain,
    }
    row = {condition: k for k, condition in enumerate(every_condition(6))}
    rows = [row[each] for each in struts]
    return {name: values[rows] for name, values in columns.items()}
