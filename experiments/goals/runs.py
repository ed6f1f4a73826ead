"""All four demonstrations, each with every strategy: secondary goals and the major task."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from experiments.goals import secondary_goals as goal
from experiments.goals.arm import LOOP_GAIN_PER_S, PERIOD_S, TRACKER_NOISE_RAD, sweep
from experiments.goals.control import Reweighing, Seeker, controllers, no_rates
from experiments.goals.demonstration import Demonstration, Outcome, Strategy, strategies
from experiments.rig.arm import smooth_step
from experiments.rig.hexapod.columns import SECONDARY, hexapod_arrays
from experiments.rig.hexapod.controller import Loop, nominal_loops
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.run import Run
from experiments.study.parallel import in_parallel
from ftc.goal import Goal
from sim import Array, Failure, Pose, forward_kinematics, hexapod, load_model

SLEW_S = 3.0
"""From the axis to the target."""
JUDGED_FROM_S = SLEW_S + 0.5
"""The slew's own error has died away by then: twenty time constants of the slower loop."""

STRIDE = 10
"""Ticks from one pose at which the clearance is measured to the next."""
EQUAL = Goal(joint_weight=(1.0,) * 6)

Loops = tuple[Loop, Loop]


def off_axis_path(
    bench: TestbedConfig, target_urad: tuple[float, float], duration_s: float
) -> Array:
    """A slew to the best known position of the target, then the testbed's spiral there, (N, 2)."""
    time_s = bench.time_s(duration_s)
    path = smooth_step(time_s / SLEW_S)[:, None] * 1e-6 * np.array(target_urad)
    searching = time_s >= SLEW_S
    search = replace(bench, duration_s=duration_s - SLEW_S)
    path[searching] += search.desired_rad(time_s[searching] - SLEW_S)
    return path


def run_reliability(strategy: Strategy, duration_s: float, loops: Loops) -> Outcome:
    """One search where two coils become hot."""
    bench = TestbedConfig()
    testbed = Testbed(load_model(), bench, loops)
    controller_for = controllers(testbed, strategy)
    cold, period_s = controller_for(EQUAL), bench.control_period_s
    path = off_axis_path(bench, goal.HOT_TARGET_URAD, duration_s)
    controller = Seeker(cold, no_rates, period_s)
    if strategy.pursues:
        controller = Reweighing(controller_for, goal.COILS, cold.drives, period_s)
    run = hexapod_rig(testbed).fly(controller, path, seed=strategy.seed)
    current_a = cold.drives.current_a(run.inputs)
    temperature_c = goal.COILS.temperatures_c(current_a, period_s)
    return _outcome(run, temperature_c.max(axis=1), temperature_c=temperature_c)


def run_stroke(strategy: Strategy, duration_s: float, loops: Loops) -> Outcome:
    """One search where two struts come to their stops."""
    model, bench = load_model(), TestbedConfig()
    stroke_m = float(model.jnt_range[model.actuator_trnid[0, 0], 1])

    def rates(displacements_m: Array, pose: Pose) -> Array:
        return goal.rates_from_stops(displacements_m, stroke_m)

    testbed = Testbed(model, bench, loops)
    if not strategy.limited:
        testbed = testbed.scaled(stroke=goal.LONGER)
    controller = controllers(testbed, strategy)(EQUAL)
    seeker = Seeker(controller, rates if strategy.pursues else no_rates, bench.control_period_s)
    path = off_axis_path(bench, goal.FAR_TARGET_URAD, duration_s)
    run = hexapod_rig(testbed).fly(seeker, path, seed=strategy.seed)
    margin_m = stroke_m - np.abs(run.displacement).max(axis=1)
    return _outcome(run, 1e6 * margin_m)


def run_obstacle(strategy: Strategy, duration_s: float, loops: Loops) -> Outcome:
    """One search beside an obstacle."""
    bench, obstructed = TestbedConfig(), goal.cluttered()
    model = obstructed if strategy.limited else load_model()
    geometry, clearance = hexapod(model), goal.Clearance(obstructed)
    testbed = Testbed(model, bench, loops)
    controller = controllers(testbed, strategy)(goal.OBSTRUCTED)
    now = controller.mapping.at(controller.mapping.nominal)
    # Strut rates that give the payload v_sd if pointing is left aside: J_s of them is v_sd.
    struts = now.expand @ np.linalg.pinv(now.J[SECONDARY])

    def rates(displacements_m: Array, pose: Pose) -> Array:
        return struts @ goal.retreat(clearance, pose)

    seeker = Seeker(controller, rates if strategy.pursues else no_rates, bench.control_period_s)
    path = off_axis_path(bench, goal.OBSTRUCTED_TARGET_URAD, duration_s)
    failures = [Failure(goal.LOCKED_STRUT, "locked")]
    run = hexapod_rig(testbed).fly(seeker, path, failures=failures, seed=strategy.seed)
    poses = forward_kinematics(geometry, run.displacement[::STRIDE])
    each = zip(poses.rotation, poses.translation_m, strict=True)
    clear_m = [clearance(Pose(*pose))[0] for pose in each]
    return _outcome(run, 1e6 * np.repeat(clear_m, STRIDE)[: len(run.time_s)])


def run_singularity(strategy: Strategy, duration_s: float, loops: Loops) -> Outcome:
    """One sweep of the arm's camera."""
    return sweep(
        axis_rad=np.deg2rad(goal.AXIS_DEG),
        angle_rad=goal.ANGLE_RAD,
        duration_s=duration_s,
        locked=goal.SHOULDER if strategy.limited else (),
        rates=goal.rates_from_singularity if strategy.pursues else None,
        major_weight=strategy.major_weight,
        seed=strategy.seed,
    )


def _outcome(run: Run, measure: Array, **arrays: Array) -> Outcome:
    """A run of the hexapod with its secondary measure (N,), and further arrays to keep."""
    return Outcome(
        time_s=run.time_s,
        error_rad=run.error,
        measure=measure,
        closure_residual_max_m=run.closure_max_m,
        arrays={name: each for name, each in hexapod_arrays(run).items() if name != "time_s"}
        | arrays,
    )


DEMONSTRATIONS = (
    Demonstration(
        name="reliability",
        title="Reliability on the fly",
        run=run_reliability,
        measure="hottest_coil_c",
        limit=goal.LIMIT_C,
        keeps_below=True,
        durations_s=(16.0, 8.0),
        judged_from_s=JUDGED_FROM_S,
        settings=goal.SETTINGS["reliability"],
    ),
    Demonstration(
        name="stroke",
        title="Stroke limits of the struts",
        run=run_stroke,
        measure="stroke_margin_um",
        limit=goal.REACHED_UM,
        keeps_below=False,
        durations_s=(10.0, 5.0),
        judged_from_s=JUDGED_FROM_S,
        settings=goal.SETTINGS["stroke"],
    ),
    Demonstration(
        name="obstacle",
        title="An obstacle beside the payload",
        run=run_obstacle,
        measure="clearance_um",
        limit=goal.TOUCHED_UM,
        keeps_below=False,
        durations_s=(10.0, 5.0),
        judged_from_s=JUDGED_FROM_S,
        settings=goal.SETTINGS["obstacle"],
    ),
    Demonstration(
        name="singularity",
        title="A singularity of the serial arm",
        run=run_singularity,
        machine="arm",
        angles=("along", "across"),
        measure="condition_number",
        limit=goal.CONDITION,
        keeps_below=True,
        durations_s=(12.0, 8.0),
        settings=goal.SETTINGS["singularity"]
        | {
            "period_s": PERIOD_S,
            "loop_gain_per_s": LOOP_GAIN_PER_S,
            "tracker_noise_rad": TRACKER_NOISE_RAD,
        },
    ),
)


@dataclass(frozen=True)
class Goals:
    """All runs: the seed of the sensor noise, and outcomes by demonstration and strategy."""

    seed: int
    strategies: tuple[Strategy, ...]
    outcomes: dict[str, dict[str, Outcome]]


def run_goals(
    *, seed: int, quick: bool, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> Goals:
    """Run every demonstration with every strategy, in parallel on the machine's cores.

    Raises:
        sim.SimulationDiverged: The physics left the finite numbers.
    """
    loops, chosen = nominal_loops(load_model(), TestbedConfig()), strategies(seed, quick)
    calls = [
        {"one": one, "strategy": strategy, "duration_s": one.durations_s[quick], "loops": loops}
        for one in DEMONSTRATIONS
        for strategy in chosen
    ]
    found = iter(in_parallel(_run, calls, on_progress))
    names = [strategy.name for strategy in chosen]
    outcomes = {one.name: {name: next(found) for name in names} for one in DEMONSTRATIONS}
    return Goals(seed, chosen, outcomes)


def _run(one: Demonstration, strategy: Strategy, duration_s: float, loops: Loops) -> Outcome:
    return one.run(strategy, duration_s, loops)
