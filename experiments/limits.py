"""Study `limits`: ways to keep actuators within limits in closed loop; docs/priorities.md."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from math import inf
from types import SimpleNamespace
from typing import Annotated, Any

import mujoco
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from argument_checks.ties import exceeds
from fjh.rig.arm import ARM_MJCF, POINTING, camera_axes, smooth_step
from fjh.rig.arm import SECONDARY as NOT_POINTING
from fjh.rig.checks import CLOSURE_LIMIT_M
from fjh.rig.compromise import Compromise
from fjh.rig.hexapod.amplifier import displacement_limits
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR, SECONDARY
from fjh.rig.hexapod.controller import StrutMapping, sampled
from fjh.rig.hexapod.metrics import plant_constants
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.run import Run, rms
from fjh.study.option import OnProgress, Option, seed_of
from fjh.study.palette import BLACK, BLUE, GREEN, VERMILION
from fjh.study.plotting import PAGE_IN, logarithmic, new_figure, one_legend
from fjh.study.result import Check, Picture, Result, TableView, check, origin
from fjh.study.workers import call, in_parallel
from ftc import Goal, PrioritizedController
from ftc.control import circle_margin
from prioritized import ConstrainedSystem, Kinematics, velocity_mapping, viable_rates
from sim import NOMINAL, Array, Failure, JacobianReader, advance, linearize, load_model
from sim.plant import failed_plant

# The spiral is 40 times larger than that of Table I, and must be within the detector. The numbers
# of this block are design choices.
BENCH = replace(TestbedConfig(), detector_half_width_m=10e-3)
RADIUS_RAD, TURN_S, REST_S, LEAD_IN_S = 4e-3, 4.0, 1.0, 0.5
# Coils 2 and 5 are hot; the others are limited by the stroke.
CURRENT_LIMIT_A = np.array([4.0005, 2.0, 4.0005, 4.0005, 2.0, 4.0005])
STUCK_M, HEAVE_M = 317.5e-6, 250e-6  # strut 1 at half its stroke; all struts longer, on request
LONGER = 3.0  # stroke of the machine without limits, in strokes of the hexapod
SLOWNESS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, inf)  # tracking time times the integrators' gain
WEIGHTS = (0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 1e3)  # [rad] against [m] or [rad]

PERIOD_S, GAIN_PER_S = 0.02, 2.0  # of the arm's controller
RANGE_RAD, RATE_RAD_PER_S, ACCELERATION_RAD_PER_S2 = 0.8, 0.6, 5.0  # of each of its joints
TILT_RAD, CIRCLE_S, EASE_S, LOCKED = 0.9, 10.0, 5.0, 3  # its line of sight; the elbow locks

# A run has recovered when its pointing is this close to that of the machine without limits.
RECOVERED_RAD, AT_LIMIT_M, AT_LIMIT_RAD = 25e-6, 0.1e-6, 1e-6
DEMANDS, FARTHEST_RAD, LEAST_RAD = 300, 2.5 * RADIUS_RAD, 0.1e-3  # out of reach, a condition

Limits = tuple[Array, Array]


@dataclass(frozen=True)
class Strategy:
    """Strategy to keep limits; `kind` is a key of :data:`ALLOCATIONS`, or "unlimited"."""

    kind: str
    weight: float | None = None  # of the major task in the weighted problem
    slowness: float = 1.0  # tracking time times the integrators' gain; inf: no anti-windup

    @property
    def name(self) -> str:
        """Name in `limits.json`."""
        weight = "" if self.weight is None else f"_{self.weight:g}"
        slow = {1.0: "", inf: "_winding_up"}.get(self.slowness, f"_tracking_{self.slowness:g}")
        return f"{self.kind}{weight}{slow}"


def strategies(*, quick: bool, loop: bool) -> list[Strategy]:
    """Return the strategies for the hexapod's loop, or for the arm, which has no integrator."""
    slowness = ((1.0, 10.0) if quick else SLOWNESS) if loop else (1.0,)
    weights = ((10.0,) if loop else ()) if quick else WEIGHTS
    return [
        Strategy("strict"),
        *([Strategy("strict", slowness=inf)] if loop else []),
        *([] if quick else [Strategy("scaled")]),
        *(Strategy("clipping", slowness=factor) for factor in slowness),
        Strategy("redistributed"),
        *(Strategy("weighted", weight) for weight in weights),
        Strategy("unlimited"),
    ]


# Allocations: functions from kinematics, limits of all actuators and task rows to a solver.


def strict(
    kinematics: Kinematics,
    limits: Limits,
    major: Sequence[int],
    secondary: Sequence[int],
    when: Any = "least_squares",
) -> Any:
    """Return the library's mapping, with limits before the major task before secondary goals."""
    W1 = np.ones(len(kinematics.actuators))
    return kinematics.velocity_mapping(major, secondary, W1, rate_limits=limits, when_limited=when)


def clipping(
    kinematics: Kinematics, limits: Limits, major: Sequence[int], secondary: Sequence[int]
) -> Any:
    """Return the mapping without limits, with each rate clipped at its limits."""
    mapping = kinematics.velocity_mapping(major, secondary, np.ones(len(kinematics.actuators)))
    bounds = np.array(limits)[:, kinematics.actuators]
    return _solving(lambda *velocities: mapping(*velocities).clip(*bounds))


def redistributed(
    kinematics: Kinematics, limits: Limits, major: Sequence[int], secondary: Sequence[int]
) -> Any:
    """Return the redistributed pseudo-inverse, in which others compensate for saturated actuators.

    Rates beyond their limits are fixed at these, and the other rates are solved again, until all
    are within limits. The result need not be optimal (Virnig and Bodden 1994; Bodson, Evaluation of
    Optimization Methods for Control Allocation, 2002).
    """
    J, (lower, upper) = kinematics.J[major], np.array(limits)[:, kinematics.actuators]

    def rates_for(v: Any, desired: Any = None, _: Any = None) -> Array:
        (m1, n), rates = J.shape, np.zeros(J.shape[1])
        desired, moving = np.zeros(n) if desired is None else desired, np.ones(n, dtype=bool)
        while moving.any():
            remaining = np.asarray(v) - J[:, ~moving] @ rates[~moving]
            mapping = velocity_mapping(J[:, moving], range(m1), joint_weight=np.ones(moving.sum()))
            rates[moving] = mapping(remaining, desired[moving])
            beyond = exceeds(rates, upper) | exceeds(lower, rates)
            rates = rates.clip(lower, upper)
            if not beyond.any():
                break
            moving &= ~beyond
        return rates

    return _solving(rates_for)


def weighted(
    kinematics: Kinematics,
    limits: Limits,
    major: Sequence[int],
    secondary: Sequence[int],
    weight: float,
) -> Any:
    """Return a mapping by one least-squares problem within limits, with a weighted major task."""
    W1, rows = np.ones(len(kinematics.actuators)), [*secondary, *major]
    W2 = np.repeat([0.0, weight], [len(secondary), len(major)])
    equals = kinematics.velocity_mapping([], rows, W1, W2, rate_limits=limits)
    return Compromise(equals, len(secondary))


ALLOCATIONS: dict[str, Callable[..., Any]] = {
    "strict": strict,
    "scaled": partial(strict, when="scaled"),
    "clipping": clipping,
    "redistributed": redistributed,
    "weighted": weighted,
}


def _solving(rates_for: Callable[..., Array]) -> Any:
    """Return a mapping with limits from a function of velocities to rates of working actuators."""
    return SimpleNamespace(solve=lambda *velocities: SimpleNamespace(rates=rates_for(*velocities)))


def allocation(strategy: Strategy) -> Callable[..., Any]:
    """Return the allocation of a strategy, with its weight if it has one."""
    allocate = ALLOCATIONS["strict" if strategy.kind == "unlimited" else strategy.kind]
    return allocate if strategy.weight is None else partial(allocate, weight=strategy.weight)


# The hexapod on a spiral beyond the limits of stroke and coil current.


@dataclass(frozen=True)
class Condition:
    """Condition: whether strut 1 is stuck off centre (known), and whether the payload is raised."""

    stuck: bool
    heave: bool

    @property
    def name(self) -> str:
        """Name in `limits.json`."""
        return f"{'stuck' if self.stuck else 'healthy'}{'_heave' if self.heave else ''}"

    @property
    def locked_at(self) -> dict[int, float]:
        """Displacements of locked struts [m] by number, as in :class:`ftc.Goal`."""
        return {0: STUCK_M} if self.stuck else {}

    @property
    def failures(self) -> list[Failure]:
        """Failures of the plant."""
        return [Failure(strut, "locked") for strut in self.locked_at]

    @property
    def raised_m(self) -> Array:
        """Secondary reference of the struts [m], shape (6,)."""
        return np.full(6, HEAVE_M if self.heave else 0.0)


def spiral_rad(duration_s: float, turn_s: float) -> Array:
    """Return desired (alpha, beta), shape (N, 2), [rad]: a spiral outwards and back, then rest."""
    time_s = BENCH.time_s(duration_s)
    radius = RADIUS_RAD * np.sin(np.pi * (time_s / (duration_s - REST_S)).clip(0, 1)) ** 2
    turned = 2 * np.pi * time_s / turn_s
    return np.stack([radius * np.cos(turned), radius * np.sin(turned)], axis=1)


def limits_of(testbed: Testbed) -> Limits:
    """Return the limits of the strut displacements [m] by stroke and current."""
    return displacement_limits(testbed.model, testbed.amplifier(), CURRENT_LIMIT_A)


def outline(testbed: Testbed, condition: Condition) -> Array:
    """Return the corners of the attainable pointing [rad], shape (k, 2)."""
    box = np.array(limits_of(testbed))
    for strut, position_m in condition.locked_at.items():
        box[:, strut] = position_m
    J = np.linalg.inv(hexapod(testbed.model).inverse_jacobian(NOMINAL))
    kinematics = ConstrainedSystem(J, None, range(6)).kinematics()
    return kinematics.attainable(MAJOR, tuple(box)).vertices


def strut_mapping(testbed: Testbed, condition: Condition, strategy: Strategy) -> StrutMapping:
    """Return the strut mapping with equal weights, and limits treated by the strategy."""
    goal = Goal(joint_weight=(1.0,) * 6, locked_at=condition.locked_at)
    limits, solve_rates = None, None
    if strategy.kind != "unlimited":
        limits, arguments = limits_of(testbed), {"major": MAJOR, "secondary": SECONDARY}
        solve_rates = partial(allocation(strategy), limits=limits, **arguments)
    geometry = hexapod(testbed.model)
    return StrutMapping(geometry, goal, "constant", limits=limits, allocate=solve_rates)


def simulate(
    testbed: Testbed, condition: Condition, strategy: Strategy, path_rad: Array, seed: int
) -> Run:
    """Simulate a spiral; "unlimited" uses a machine with longer strokes and cool coils.

    Raises:
        sim.SimulationDiverged: The state is not finite.
    """
    if strategy.kind == "unlimited":
        testbed = testbed.scaled(stroke=LONGER)
    controller = PrioritizedController(
        testbed.loops,
        strut_mapping(testbed, condition, strategy),
        testbed.amplifier(),
        testbed.bench.handover_s,
        anti_windup=strategy.slowness < inf,
        tracking_slowness=strategy.slowness if strategy.slowness < inf else 1.0,
    )
    raising = partial(controller.step, secondary_reference=condition.raised_m)
    start_m = [condition.locked_at.get(strut, 0.0) for strut in range(6)]
    raised = SimpleNamespace(start=controller.start, step=raising)
    rig, failures = hexapod_rig(testbed, start_m=np.array(start_m)), condition.failures
    return rig.fly(raised, path_rad, failures=failures, seed=seed, lead_in_s=LEAD_IN_S)


def spiral_row(
    testbed: Testbed, condition: Condition, strategy: Strategy, run: Run, unlimited: Run
) -> dict[str, Any]:
    """Return the row of a spiral, compared with the run of the machine without limits."""
    period_s, error = testbed.bench.control_period_s, np.linalg.norm(run.error, axis=1)
    deviation = np.linalg.norm(run.true - unlimited.true, axis=1)
    attainable = signed_distance(outline(testbed, condition), run.desired) > 0
    working = np.delete(np.arange(6), list(condition.locked_at))
    gains_per_s = [loop.numerator[-1] / loop.denominator[-2] for loop in testbed.loops]
    tracking_s = np.mean(strategy.slowness / np.array(gains_per_s))
    lower, upper = (side[working] for side in limits_of(testbed))
    command_m = testbed.amplifier().displacements(run.inputs)[:, working]
    margin_m = np.minimum(upper - command_m, command_m - lower)
    is_limited = strategy.kind != "unlimited"
    moved_m = run.displacement[:, working] - condition.raised_m[working]
    return {
        "name": f"{condition.name}_{strategy.name}",
        "condition": condition.name,
        "strategy": strategy.name,
        "kind": strategy.kind,
        "major_weight": strategy.weight,
        "tracking_time_s": tracking_s if np.isfinite(tracking_s) else None,
        "rms_urad": 1e6 * rms(error),
        "peak_urad": 1e6 * error.max(),
        "attainable_rms_urad": 1e6 * rms(error[attainable]),
        "recovery_s": longest((deviation > RECOVERED_RAD) & attainable) * period_s,
        "rest_peak_urad": 1e6 * error[-round(0.5 * REST_S / period_s) :].max(),
        "secondary_rms_um": 1e6 * rms(moved_m.ravel()),
        "at_limit_s": (margin_m < AT_LIMIT_M).any(axis=1).sum() * period_s if is_limited else None,
        "beyond_limit_um": -1e6 * margin_m.min() if is_limited else None,
        "closure_residual_max_m": run.closure_max_m,
    }


def condition_row(testbed: Testbed, condition: Condition, path_rad: Array) -> dict[str, Any]:
    """Return the row of a condition, with attainable pointing and stability of the loop."""
    shortfall = -np.minimum(signed_distance(outline(testbed, condition), path_rad), 0.0)
    return {
        "condition": condition.name,
        "least_rms_urad": 1e6 * rms(shortfall),
        "not_attainable_s": (shortfall > 0).sum() * testbed.bench.control_period_s,
        "circle_margin": loop_margin(testbed, condition, anti_windup=True),
        "circle_margin_winding_up": loop_margin(testbed, condition, anti_windup=False),
    }


def loop_margin(testbed: Testbed, condition: Condition, *, anti_windup: bool) -> float:
    """Compute the :func:`.circle_margin` of both loops on the linear model of the plant."""
    plant = failed_plant(testbed.model, condition.failures)
    goal = Goal(joint_weight=(1.0,) * 6, locked_at=dict.fromkeys(condition.locked_at, 0.0))
    gain = StrutMapping(hexapod(testbed.model), goal, "constant").major_gain()
    pointing = sampled(linearize(plant.model, plant.data), gain, testbed.bench.control_period_s)
    return circle_margin(pointing[MAJOR, :], testbed.loops, anti_windup=anti_windup)


def longest(holds: Array) -> int:
    """Return the length of the longest sequence of true samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def signed_distance(corners: Array, points: Array) -> Array:
    """Return the distance (N,) of points (N, 2) from a convex outline, negative outside."""
    along = np.roll(corners, -1, axis=0) - corners
    length, offsets = np.linalg.norm(along, axis=1), points[:, None] - corners
    fraction = ((offsets * along).sum(axis=2) / length**2).clip(0, 1)
    distance = np.linalg.norm(offsets - fraction[..., None] * along, axis=2).min(axis=1)
    inward = (along[:, 0] * offsets[..., 1] - along[:, 1] * offsets[..., 0]) / length
    return np.where((inward >= 0).all(axis=1), distance, -distance)


def excess_row(
    testbed: Testbed, conditions: Sequence[Condition], strategy: Strategy, seed: int
) -> dict[str, Any]:
    """Return the excess of the mapping's pointing error over the minimum, for infeasible demands.

    The minimum is the distance from the outline of attainable pointing, known from geometry.
    """
    excess = []
    for condition in conditions:
        rng, corners = np.random.default_rng(seed), outline(testbed, condition)
        turned = rng.uniform(0, 2 * np.pi, 20 * DEMANDS)
        radius = FARTHEST_RAD * rng.uniform(0, 1, 20 * DEMANDS)
        demands = radius[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
        least = -signed_distance(corners, demands)
        far = np.flatnonzero(least > LEAST_RAD)[:DEMANDS]
        mapping: Any = strut_mapping(testbed, condition, strategy)
        arguments = {"secondary_reference": condition.raised_m}
        errors = [mapping.tick(demand, NOMINAL, **arguments)[1] for demand in demands[far]]
        excess.append(100 * (np.linalg.norm(errors, axis=1) / least[far] - 1.0))
    return {
        "strategy": strategy.name,
        "excess_median_percent": np.median(np.concatenate(excess)),
        "excess_largest_percent": np.max(excess),
    }


# The arm on a long path, without dynamics; its elbow locks halfway.


def line_of_sight(time_s: Array, duration_s: float) -> Array:
    """Return the desired line of sight as unit vectors in base axes, shape (N, 3)."""
    eased = smooth_step(time_s / EASE_S) * smooth_step((duration_s - time_s) / EASE_S)
    tilt, turned = TILT_RAD * eased, 2 * np.pi * time_s / CIRCLE_S
    across = np.sin(tilt)
    return np.stack([across * np.cos(turned), across * np.sin(turned), np.cos(tilt)], axis=1)


def move_arm(strategy: Strategy, duration_s: float) -> dict[str, Array]:
    """Simulate the arm by resolved rates with feedback; return time, error (N,), angles (N, 7)."""
    model = load_model(ARM_MJCF)
    data, reader = mujoco.MjData(model), JacobianReader(model, site="payload", axes="payload")
    system = ConstrainedSystem.of(reader.at(data))
    time_s = np.arange(round(duration_s / PERIOD_S) + 1) * PERIOD_S
    views = line_of_sight(time_s, duration_s)
    range_rad = inf if strategy.kind == "unlimited" else RANGE_RAD
    rates, rows = np.zeros(model.nv), []
    for k, now in enumerate(time_s[:-1]):
        if k == len(time_s) // 2:
            system = system.with_failures(locked=[LOCKED])
        kinematics = system.at(J_T=reader.at(data).J_T).kinematics()
        camera = camera_axes(data)
        axis = np.cross(camera[:, 2], views[k])
        sine = np.linalg.norm(axis)
        turn = axis * (np.arctan2(sine, camera[:, 2] @ views[k]) / sine if sine > 0 else 1.0)
        ahead = np.cross(views[k], views[k + 1] - views[k]) / PERIOD_S
        pointing = (camera.T @ (GAIN_PER_S * turn + ahead))[POINTING]
        box = viable_rates(
            data.qpos,
            rates,
            position_limits=(-range_rad, range_rad),
            rate_limits=(-RATE_RAD_PER_S, RATE_RAD_PER_S),
            acceleration_limits=(-ACCELERATION_RAD_PER_S2, ACCELERATION_RAD_PER_S2),
            period_s=PERIOD_S,
        )
        allocate = allocation(strategy)(kinematics, (box.lower, box.upper), POINTING, NOT_POINTING)
        rates = kinematics.expand(allocate.solve(pointing).rates)
        rows.append((now, np.linalg.norm(turn), data.qpos.copy()))
        data = advance(model, data, rates, PERIOD_S)
    names = "time_s", "error_rad", "joint_rad"
    return dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))


def arm_row(strategy: Strategy, motion: dict[str, Array]) -> dict[str, Any]:
    """Return the row of a motion of the arm."""
    reached = np.abs(motion["joint_rad"]).max(axis=1)
    return {
        "condition": "arm",
        "strategy": strategy.name,
        "kind": strategy.kind,
        "major_weight": strategy.weight,
        "rms_mrad": 1e3 * rms(motion["error_rad"]),
        "peak_mrad": 1e3 * motion["error_rad"].max(),
        "at_limit_s": (reached > RANGE_RAD - AT_LIMIT_RAD).sum() * PERIOD_S,
        "beyond_limit_rad": reached.max() - RANGE_RAD,
    }


# The study.


def limits(
    *,
    seed: Annotated[int, seed_of("the detector noise")] = 0,
    quick: Annotated[
        bool, Option(help="One secondary goal, fewer strategies, shorter spirals and path.")
    ] = False,
    on_progress: OnProgress,
) -> Result:
    """Compare ways to keep actuators within their limits, in the loop.

    The hexapod follows a spiral beyond what stroke and coil current permit, without failure and
    with strut 1 stuck off centre. An arm with limited joints follows a long path, and a joint locks
    halfway. Strict priority is compared with scaling, clipping (seven tracking times), a
    redistributed pseudo-inverse and one weighted problem (eight weights). Takes an estimated 6
    minutes on two cores, 20 s with --quick.

    Writes limits.json, its tables as limits.md and Parquet, a figure, and the data of all runs
    (spirals.npz, arm.npz).

    Example: fjh paper limits --quick --out /tmp/limits
    """
    testbed = nominal_testbed(BENCH)
    duration_s, turn_s, arm_s = (3.0, TURN_S / 2, 16.0) if quick else (9.0, TURN_S, 40.0)
    path_rad, heaves = spiral_rad(duration_s, turn_s), (True,) if quick else (False, True)
    conditions = [Condition(*flags) for flags in product((False, True), heaves)]
    loop, arm = (strategies(quick=quick, loop=in_loop) for in_loop in (True, False))
    cases = list(product(conditions, loop))
    shared = {"work": simulate, "testbed": testbed, "path_rad": path_rad, "seed": seed}
    calls = [{"work": move_arm, "strategy": how, "duration_s": arm_s} for how in arm]
    calls += [shared | {"condition": condition, "strategy": how} for condition, how in cases]
    done = in_parallel(call, calls, on_progress)
    motions = {how.name: motion for how, motion in zip(arm, done, strict=False)}
    runs = dict(zip(cases, done[len(arm) :], strict=True))
    rows = [spiral_row(testbed, *key, run, runs[key[0], loop[-1]]) for key, run in runs.items()]
    limited = [how for how in loop if how.slowness == 1.0 and how.kind != "unlimited"]
    excess = [excess_row(testbed, conditions, how, seed) for how in limited]
    tables = {
        "spirals": over_strict(rows, "rms_urad"),
        "arm": over_strict([arm_row(how, motions[how.name]) for how in arm], "rms_mrad"),
        "conditions": pd.DataFrame([condition_row(testbed, c, path_rad) for c in conditions]),
        "out_of_reach": pd.DataFrame(excess),
    }
    spirals = {"time_s": BENCH.time_s(duration_s), "desired_rad": path_rad}
    for (condition, strategy), run in runs.items():
        name = f"{condition.name}_{strategy.name}"
        spirals |= {f"{name}_true_rad": run.true, f"{name}_strut_input_percent": run.inputs}
    motion = {f"{name}_{key}": A for name, one in motions.items() for key, A in one.items()}
    stuck = Condition(stuck=True, heave=heaves[0])
    plane = outline(testbed, stuck), path_rad, runs[stuck, Strategy("strict")].true
    plot = partial(figure, *plane, tables["spirals"], tables["arm"])
    return Result(
        settings=origin(seed, arm=ARM_MJCF)
        | {
            "bench": asdict(testbed.bench) | plant_constants(load_model()),
            "duration_s": duration_s,
            "turn_s": turn_s,
            "radius_urad": 1e6 * RADIUS_RAD,
            "current_limit_a": CURRENT_LIMIT_A,
            "displacement_limits_um": [1e6 * side for side in limits_of(testbed)],
            "stuck_strut": 1,
            "stuck_um": 1e6 * STUCK_M,
            "heave_um": 1e6 * HEAVE_M,
            "arm_duration_s": arm_s,
            "arm_range_rad": RANGE_RAD,
            "arm_rate_rad_per_s": RATE_RAD_PER_S,
            "arm_acceleration_rad_per_s2": ACCELERATION_RAD_PER_S2,
            "arm_locked_joint": LOCKED + 1,
            "demands": DEMANDS * len(conditions),
            "data": ["spirals.npz", "arm.npz"],
        },
        tables=tables,
        checks=checks(**tables),
        views=printed_tables(**tables),
        pictures=[Picture("limits", CAPTION, ALT, plot)],
        arrays={"spirals.npz": spirals, "arm.npz": motion},
    )


def over_strict(rows: list[dict[str, Any]], size: str) -> pd.DataFrame:
    """Return rows with the error relative to that of strict priority in the same condition."""
    runs = pd.DataFrame(rows)
    strict = runs[runs.strategy == "strict"].set_index("condition")[size]
    return runs.assign(rms_over_strict=runs[size] / runs.condition.map(strict))


def checks(
    spirals: pd.DataFrame, arm: pd.DataFrame, conditions: pd.DataFrame, out_of_reach: pd.DataFrame
) -> list[Check]:
    """Return checks of limits, priority, recovery, stability and closure."""
    by_strategy, arm_runs = spirals.set_index(["condition", "strategy"]), arm.set_index("strategy")
    limited = by_strategy[by_strategy.kind != "unlimited"]
    settled = limited[limited.kind != "weighted"].drop("strict_winding_up", level="strategy")
    winding_up = by_strategy.xs("strict_winding_up", level="strategy").rms_over_strict
    recovery_s = by_strategy.xs("strict", level="strategy").recovery_s
    margin = conditions.set_index("condition").circle_margin
    excess = out_of_reach.set_index("strategy").excess_largest_percent["strict"]
    # The tracking time is the best of each condition, chosen afterwards: impossible in practice.
    tuned = spirals[spirals.kind == "clipping"].groupby("condition").rms_over_strict.min()
    what = "RMS error of strict priority over that of clipping, tuned"
    beyond_rad = arm_runs.beyond_limit_rad.drop("unlimited")
    return [
        *check(what, 1 / tuned, 1.0),
        *check("RMS error with anti-windup over that without", 1 / winding_up, 1.0),
        *check("time from an attainable target to recovered pointing [s]", recovery_s, 0.5),
        *check("margin of the circle criterion below zero", -margin, 0.0),
        *check("closure residual [m]", by_strategy.closure_residual_max_m, CLOSURE_LIMIT_M),
        # The limit is a step of the converter.
        *check("command beyond its limit [um]", limited.beyond_limit_um, 0.02),
        *check("pointing error at rest afterwards [urad]", settled.rest_peak_urad, 5.0),
        *check(what, 1 / arm_runs.rms_over_strict["clipping"], 1.0, "arm"),
        *check("peak error of strict priority [mrad]", arm_runs.peak_mrad["strict"], 10.0, "arm"),
        *check("joint beyond its limit [rad]", beyond_rad, 1e-9, "arm"),
        *check("error of strict priority above the least [%]", excess, 1e-6, "out of reach"),
    ]


def printed_tables(
    spirals: pd.DataFrame, arm: pd.DataFrame, conditions: pd.DataFrame, out_of_reach: pd.DataFrame
) -> list[TableView]:
    """Return the printed tables."""
    columns = "strategy rms_over_strict:.3f rms_urad:.0f peak_urad:.0f "
    columns += "recovery_s=longest_miss_s:.2f attainable_rms_urad:.0f secondary_rms_um:.0f"
    legend = "Longest miss: time for which an attainable target is missed by "
    legend += f"{1e6 * RECOVERED_RAD:.0f} urad more than without limits."
    groups = spirals.groupby("condition", sort=False)
    runs = pd.concat([spirals, arm]).set_index(["strategy", "condition"])
    compared = runs.rms_over_strict.unstack("condition", sort=False)
    return [
        TableView(
            "RMS error divided by that of strict priority: hexapod, and arm",
            compared.reset_index(),
            " ".join(["strategy", *(f"{name}:.3f" for name in compared)]),
            "Stuck: strut 1, off centre. Heave: the payload is raised.",
        ),
        *(TableView(f"Hexapod: {name}", group, columns, legend) for name, group in groups),
        TableView(
            "Attainable pointing in each condition",
            conditions,
            "condition least_rms_urad:.0f not_attainable_s=time_not_attainable_s:.2f "
            "circle_margin=margin_of_circle_criterion:.2f",
            "Least RMS: by the limits alone.",
        ),
        TableView(
            "Arm: angle between desired and true line of sight",
            arm,
            "strategy rms_mrad:.2f peak_mrad:.2f rms_over_strict:.2f at_limit_s=at_a_limit_s:.1f",
        ),
        TableView(
            "Hexapod, infeasible demands: error of the mapping alone above the minimum",
            out_of_reach,
            "strategy excess_median_percent:.2g excess_largest_percent:.2g",
        ),
    ]


CAPTION = (
    "Left: the hexapod with strut 1 stuck on a spiral beyond the limits of stroke and coil "
    "current. Right: the error of each strategy over that of strict priority."
)
ALT = (
    "Strict priority follows the outline of the attainable region. The best weight and the "
    "redistributed pseudo-inverse have the same error, clipping has more with any tracking time, "
    "and too small a weight causes many times the error."
)
LOOKS = {
    "healthy": {"color": BLUE, "marker": "o"},
    "healthy_heave": {"color": BLUE, "marker": "+"},
    "stuck": {"color": VERMILION, "marker": "s"},
    "stuck_heave": {"color": VERMILION, "marker": "x"},
    "arm": {"color": GREEN, "marker": "D"},
}


def figure(
    corners: Array, path_rad: Array, true: Array, spirals: pd.DataFrame, arm: pd.DataFrame
) -> Figure:
    """Plot strict priority with strut 1 stuck, and the errors of all strategies relative to it."""
    figure = new_figure(PAGE_IN, 4.2)
    plane, errors = figure.subplots(1, 2, width_ratios=[0.8, 1])
    plane.fill(*1e3 * corners.T, color=GREEN, alpha=0.2, lw=0, label="attainable")
    plane.plot(*1e3 * path_rad.T, color=BLACK, ls="--", lw=0.8, label="desired")
    plane.plot(*1e3 * true.T, color=VERMILION, label="strict priority, strut 1 stuck")
    plane.set(xlabel="$\\alpha$, mrad", ylabel="$\\beta$, mrad", aspect="equal")
    plane.set_title("Strict priority stays as close as limits allow")
    limited = pd.concat([spirals, arm]).query("kind != 'unlimited'")
    names = list(limited.strategy.unique())
    for condition, group in limited.groupby("condition", sort=False):
        rows, look = group.strategy.map(names.index), LOOKS[str(condition)]
        errors.plot(group.rms_over_strict, rows, ls="", label=condition, **look)
    logarithmic(errors, "x")
    errors.set_yticks(range(len(names)), names)
    errors.invert_yaxis()
    errors.set(title="RMS error over that of strict priority", xlabel="less is better")
    one_legend(figure, 4)
    return figure
