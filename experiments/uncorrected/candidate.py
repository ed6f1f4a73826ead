"""A candidate explanation of Table I's last column: what it changes of the bench."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import mujoco
import numpy as np

from experiments.hexapod.goal import Goal
from experiments.hexapod.testbed import Bench
from experiments.uncorrected.machine import EQUAL, damped, floor_acceleration
from sim import Array, Failure

STRUT = 0
"""The strut that locks, strut 1 as in the paper."""

COLUMNS = ("W_a", "W_d", "W_e", "W_a_uncorrected")
"""Columns of Table I that a candidate must get right."""

_CHOICES = ("anti_windup", "spiral_exponent", "spiral_direction")
_BENCH = Bench()
BENCH_DAMPING = 0.106
"""Of the pointing modes in `models/fjh.xml`; `pointing_mode` says so."""
_SECONDARY = {"W_d": (1.0, 1.0, 1.0, 1.0), "W_e": (10.0, 10.0, 1.0, 1.0)}


@dataclass(frozen=True)
class Candidate:
    """One explanation: what differs from the bench.

    Attributes:
        name: As in `uncorrected.json`.
        what: In words, for tables.
        damping_ratio: Of the pointing modes of the sound machine; None is the model file's, 0.106.
        alpha_crossover_hz: Gain crossover; `beta_crossover_hz` alike.
        roll_off_hz: Corner of the compensators' low-pass.
        spiral_radius_urad: Recalibrated where W_a would leave Table I.
        detector_noise_m: Of a sample.
        floor_velocity_m_per_s: One-third-octave RMS velocity; 0 is a floor at rest.
        lock_m: Where strut 1 is stuck. The corrected mapping is told.
        lead_in_s: Time for the loop to settle before the spiral starts.
        amplifier_limit_a: Where the amplifier saturates.
        demand_limit_urad: Largest pointing that the compensators may demand; None is no limit.
        anti_windup: Whether their integrators are held there.
        spiral_exponent: 1/2 is a spiral of constant speed; see :class:`Bench`.
        spiral_start_deg: Direction in which it leaves the centre.
        spiral_direction: -1 turns the other way.
        simulated: Columns that run in MuJoCo; the others are the linear model's.
    """

    name: str
    what: str
    damping_ratio: float | None = None
    alpha_crossover_hz: float = _BENCH.alpha_crossover_hz
    beta_crossover_hz: float = _BENCH.beta_crossover_hz
    roll_off_hz: float = _BENCH.roll_off_hz
    spiral_radius_urad: float = _BENCH.spiral_radius_urad
    detector_noise_m: float = _BENCH.detector_noise_m
    floor_velocity_m_per_s: float = 0.0
    lock_m: float = 0.0
    lead_in_s: float = 0.0
    amplifier_limit_a: float = _BENCH.amplifier_limit_a
    demand_limit_urad: float | None = None
    anti_windup: bool = False
    spiral_exponent: float = _BENCH.spiral_exponent
    spiral_start_deg: float = _BENCH.spiral_start_deg
    spiral_direction: int = _BENCH.spiral_direction
    simulated: tuple[str, ...] = ("W_a", "W_a_uncorrected")

    @property
    def saturates(self) -> bool:
        """Whether the amplifiers are meant to; the linear model then has no say."""
        return self.amplifier_limit_a < _BENCH.amplifier_limit_a

    @property
    def bench(self) -> Bench:
        """Around the plant. Less damping needs more rest before the run."""
        ratio = self.damping_ratio or BENCH_DAMPING
        own = {key: getattr(self, key) for key in asdict(_BENCH) if hasattr(self, key)}
        rest_s = _BENCH.settling_s * max(1.0, BENCH_DAMPING / ratio)
        return replace(_BENCH, **own, settling_s=round(rest_s, 1))

    def machine(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """The machine, with its own damping."""
        return model if self.damping_ratio is None else damped(model, self.damping_ratio)

    def differs(self) -> dict[str, Any]:
        """Parameters that are not the bench's."""
        mine, bench = asdict(self), asdict(Candidate("", ""))
        told = ("name", "what", "simulated")
        return {key: mine[key] for key in mine if key not in told and mine[key] != bench[key]}

    @property
    def freedom(self) -> tuple[int, int]:
        """How many numbers, and how many choices between two, are not the bench's."""
        choices = sum(key in _CHOICES for key in self.differs())
        return len(self.differs()) - choices, choices

    def run(self, column: str, seed: int) -> dict[str, Any]:
        """Arguments of `track_spiral` and `predicted_error_rad` for one column of Table I."""
        return {
            "goal": self._goal(column),
            "failures": () if column == "W_a" else (Failure(STRUT, "locked"),),
            "start_m": None if column == "W_a" else self.lock_m * np.eye(6)[STRUT],
            "lead_in_s": self.lead_in_s,
            "floor_m_per_s2": self._floor(seed),
            "seed": seed,
        }

    def _goal(self, column: str) -> Goal:
        if column not in _SECONDARY:
            return EQUAL
        return Goal(secondary_weight=_SECONDARY[column], locked_m={STRUT: self.lock_m})

    def _floor(self, seed: int) -> Array | None:
        if not self.floor_velocity_m_per_s:
            return None
        return floor_acceleration(self.bench, self.floor_velocity_m_per_s, seed)
