"""How often a sound machine is suspected: as flown, and the same flights with fresh noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.stats import chi2

from experiments.hexapod.compensator import Loop
from experiments.hexapod.metrics import pointing_rms_urad
from experiments.hexapod.pilot import NEVER, Informed
from experiments.hexapod.simulation import controller_for, fly
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import DITHER, GOAL, Case
from ftc.fdi.config import RULES
from ftc.fdi.dither import STILL, Dither
from ftc.fdi.fault_model import SoundMachine, failed_machine, sound_machine
from ftc.fdi.residual_test import chart
from ftc.fdi.sensing import sensing
from sim import Array


@dataclass(frozen=True)
class Healthy:
    """Sound flights.

    Attributes:
        hours: Flown, or made of flown ones with fresh noise.
        alarms: Flights with one.
    """

    hours: float
    alarms: int

    @property
    def upper_per_hour(self) -> float:
        """Exact 95 % upper bound on the rate of a Poisson process."""
        return float(chi2.ppf(0.95, 2 * (self.alarms + 1)) / 2 / self.hours)


def together(flights: Sequence[Healthy]) -> Healthy:
    """All of them as one."""
    hours, alarms = sum(each.hours for each in flights), sum(each.alarms for each in flights)
    return Healthy(hours, alarms)


@dataclass(frozen=True)
class DitherCost:
    """What the dither does to the pointing errors of a sound machine, (alpha, beta), [urad].

    Attributes:
        rms_urad: Without it.
        change_urad: Change of the RMS with it, the noise alike.
        reseeded_urad: Change of the RMS with another seed, for comparison.
    """

    rms_urad: tuple[float, float]
    change_urad: tuple[float, float]
    reseeded_urad: tuple[float, float]


def dither_cost(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    case: Case,
    duration_s: float,
) -> DitherCost:
    """The spiral with and without, and without it with the next seed."""
    pilot = controller_for(model, bench, loops, GOAL, jacobian="constant")

    def rms_urad(dither: Dither, seed: int) -> Array:
        flies = Informed(pilot, pilot, NEVER, secondary=case.dither(dither).at)
        return pointing_rms_urad(fly(model, bench, flies, seed=seed, duration_s=duration_s)[0])

    still = rms_urad(STILL, case.seed)
    swinging, reseeded = rms_urad(DITHER, case.seed), rms_urad(STILL, case.seed + 1)
    return DitherCost(*(tuple(row.tolist()) for row in (still, swinging - still, reseeded - still)))


@dataclass(frozen=True)
class HealthyFlight:
    """A flight on which nothing failed.

    Attributes:
        sent_m: Strut displacements commanded from each tick on, shape (N, 6).
        measured: Whitened (alpha, beta), shape (N, 2).
        true: The same without the detector's noise.
    """

    sent_m: Array
    measured: Array
    true: Array


def healthy_flight(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    secondary: Callable[[float], Array],
    seed: int,
    duration_s: float,
    flown: mujoco.MjModel | None = None,
) -> HealthyFlight:
    """The spiral with some desired strut displacements; `flown` is a machine off the model."""
    pilot = controller_for(model, bench, loops, GOAL, jacobian="constant")
    never = Informed(pilot, pilot, NEVER, secondary=secondary)
    machine = model if flown is None else flown
    run, _ = fly(machine, bench, never, seed=seed, duration_s=duration_s)
    noise = sensing(sound_machine(model, bench), bench, strut_sensors=False).noise
    sent_m = pilot.amplifier.displacement_m(run.strut_input_percent)
    return HealthyFlight(sent_m, run.measured_rad / noise, run.true_rad / noise)


def healthy(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    case: Case,
    duration_s: float,
    draws: int,
) -> tuple[Healthy, Healthy, float]:
    """One flight, and the same with fresh noise.

    The residuals of a flight are the detector's noise and what the linear model leaves out. The
    noise is the larger by far and hardly changes the rest, so that the flight with fresh noise
    stands for another flight.

    Args:
        model: The machine.
        bench: Constants around it.
        loops: Compensators.
        case: Posture and seed.
        duration_s: Of the spiral.
        draws: Of fresh noise.

    Returns:
        As flown; with fresh noise; and the largest residual without noise, [urad].
    """
    flight = healthy_flight(model, bench, loops, case.dither(DITHER).at, case.seed, duration_s)
    sound = sound_machine(model, bench)
    seen = sensing(sound, bench, strut_sensors=False)
    expected = expected_outputs(sound, flight.sent_m, seen.C)
    silent = flight.true - expected
    watch = chart(len(seen.C), RULES.false_alarms_per_hour, bench.control_period_s)
    hours = len(silent) * bench.control_period_s / 3600
    rng = np.random.default_rng([case.seed, 3])
    alarms = sum(
        bool(watch.alarms(silent + rng.standard_normal(silent.shape)).any()) for _ in range(draws)
    )
    return (
        Healthy(hours, int(watch.alarms(flight.measured - expected).any())),
        Healthy(draws * hours, alarms),
        float(1e6 * np.abs(silent * seen.noise).max()),
    )


def expected_outputs(sound: SoundMachine, sent_m: Array, C: Array) -> Array:
    """Outputs (N, p) of the sound machine for commands (N, 6) sent from each tick on."""
    machine = failed_machine(sound, ())
    x, outputs = np.zeros(len(machine.A)), []
    for u in sent_m:
        outputs.append(C @ x)
        x = machine.step(x, u)
    return np.array(outputs)
