"""Candidate explanations of Table I's last column: what each changes of the bench.

Among them vibration: less damping of the pointing modes, and a floor that moves.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from argument_checks.ties import greatest
from experiments.rig.hexapod.columns import COLUMNS as TABLE_I
from experiments.rig.hexapod.controller import StrutMapping
from experiments.rig.hexapod.machine import floor_acceleration
from experiments.rig.hexapod.paper import TABLE_I_URAD
from experiments.rig.hexapod.rig import hexapod_rig
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.rig.rig import Rig
from sim import Array, Plant, hexapod, linearize

STRUT = 0
"""The strut that locks, strut 1 as in the paper."""

COLUMNS = ("W_a", "W_d", "W_e", "W_a_uncorrected")
"""Columns of Table I that a candidate must reproduce."""
EXPERIMENTS = {column.name: column for column in TABLE_I if column.name in COLUMNS}
W_A = EXPERIMENTS["W_a"].goal
"""The goal of W_a: no failure, equal weights."""

PAPER_RATIOS = np.divide(TABLE_I_URAD["W_a_uncorrected"], TABLE_I_URAD["W_a"])
RATIO_TOLERANCE = 0.15
"""Accepted relative deviation of both ratios and of W_a."""
CORRECTED_TOLERANCE = 0.25
"""Accepted relative deviation of W_d and W_e from the paper's."""

_CHOICES = ("anti_windup", "spiral_exponent", "spiral_direction")
_BENCH = TestbedConfig()
BENCH_DAMPING = 0.106
"""Of the pointing modes in `models/fjh.xml`; `pointing_mode` says so."""


def damped(model: mujoco.MjModel, ratio: float) -> mujoco.MjModel:
    """The machine with all suspension dampers scaled to a damping ratio of the pointing modes.

    Raises:
        ValueError: The ratio is not between 0 and 1.
    """
    if not 0 < ratio < 1:
        raise ValueError(f"ratio must lie between 0 and 1, got {ratio}")
    altered = copy.copy(model)
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    altered.dof_damping[dofs] *= ratio / pointing_mode(model)[1]
    return altered


def pointing_mode(model: mujoco.MjModel) -> tuple[float, float]:
    """Frequency [Hz] and damping ratio of the sound machine's mode that alpha commands move most.

    The largest residue of the transfer from commanded to true alpha.
    """
    sound = Plant(model)
    linear = linearize(sound.model, sound.data)
    drive = linear.B @ StrutMapping(hexapod(model), W_A, "constant").major_gain()[:, 0]
    poles, shapes = np.linalg.eig(linear.A)
    residues = (linear.C_twist[0] @ shapes) * np.linalg.solve(shapes, drive.astype(complex))
    pole = poles[greatest(np.abs(residues))]
    return float(abs(pole) / (2 * np.pi)), float(-pole.real / abs(pole))


@dataclass(frozen=True)
class Candidate:
    """One explanation: what differs from the bench.

    The spiral's radius is changed where the errors of W_a would no longer be those of Table I.
    """

    name: str
    what: str  # in words, for tables
    constants: dict[str, Any] = field(default_factory=dict)  # of the Bench, by their names
    damping_ratio: float | None = None  # of the sound machine's pointing modes; None: the model's
    floor_velocity_m_per_s: float = 0.0  # one-third-octave RMS
    lock_m: float = 0.0  # where strut 1 is stuck; the corrected mapping knows it
    lead_in_s: float = 0.0  # for the loop to settle before the spiral starts
    simulated: tuple[str, ...] = ("W_a", "W_a_uncorrected")  # others: by the linear model alone

    @property
    def saturates(self) -> bool:
        """Whether the amplifiers are meant to; the linear model then does not apply."""
        return self.bench.amplifier_limit_a < _BENCH.amplifier_limit_a

    @property
    def bench(self) -> TestbedConfig:
        """Around the plant. Less damping needs more rest before the run."""
        ratio = self.damping_ratio or BENCH_DAMPING
        rest_s = _BENCH.settling_s * max(1.0, BENCH_DAMPING / ratio)
        return replace(_BENCH, **self.constants, settling_s=round(rest_s, 1))

    def machine(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """The machine, with its own damping."""
        return model if self.damping_ratio is None else damped(model, self.damping_ratio)

    def differs(self) -> dict[str, Any]:
        """Parameters that differ from the testbed's."""
        own = ("damping_ratio", "floor_velocity_m_per_s", "lock_m", "lead_in_s")
        return {key: getattr(self, key) for key in own if getattr(self, key)} | self.constants

    @property
    def freedom(self) -> tuple[int, int]:
        """Numbers of parameters and of binary choices that differ from the testbed's."""
        choices = sum(key in _CHOICES for key in self.differs())
        return len(self.differs()) - choices, choices

    def rig(self, testbed: Testbed, column: str, seed: int, duration_s: float) -> Rig:
        """The hexapod for a run of this length in one column of Table I, constant Jacobian."""
        goal, lock_m = EXPERIMENTS[column].goal, None
        if EXPERIMENTS[column].failures:
            lock_m = self.lock_m * np.eye(6)[STRUT]
        if goal.locked_at:
            goal = replace(goal, locked_at={STRUT: self.lock_m})
        floor = self._floor(seed, duration_s)
        return hexapod_rig(testbed, goal, start_m=lock_m, floor_m_per_s2=floor)

    def _floor(self, seed: int, duration_s: float) -> Array | None:
        if not self.floor_velocity_m_per_s:
            return None
        bench, velocity = self.bench, self.floor_velocity_m_per_s
        # The detector's noise has another stream.
        ticks = len(bench.time_s(bench.duration_s))
        floor = floor_acceleration(ticks, bench.control_period_s, velocity, [seed, 1])
        return floor[: len(bench.time_s(duration_s))]


BENCH = Candidate("lost_strut", "the testbed of Table I, a strut lost", simulated=COLUMNS)

# Locked mode near crossover: roll-off at the modes, dampers at a seventh.
_RESONANCE = Candidate(
    "resonance",
    "little damping, roll-off above the modes",
    {"roll_off_hz": 40.0},
    damping_ratio=0.015,
    simulated=COLUMNS,
)
_EXCITED = replace(_RESONANCE, simulated=("W_a", "W_a_uncorrected"))

# Found by a search in the linear model, then moved by hand to have both ratios and W_a inside
# their 15 %: docs/uncorrected.md.
_LOOPS = {"alpha_crossover_hz": 15.5, "beta_crossover_hz": 8.6, "roll_off_hz": 32.2}
RETUNED = Candidate(
    "retuned",
    "locked off centre, six parameters fitted",
    _LOOPS | {"spiral_radius_urad": 141.0},
    damping_ratio=0.10,
    lock_m=-125e-6,
    simulated=COLUMNS,
)


def _limited(name: str, what: str, limit_urad: float, **constants: Any) -> Candidate:
    """From the map of docs/uncorrected.md, which a sweep over the limit makes."""
    what = f"limit on the demanded pointing, {what}"
    constants |= {"demand_limit_urad": limit_urad}
    return Candidate(name, what, constants, simulated=COLUMNS)


CLOCKWISE = _limited(
    "limit_clockwise", "testbed's spiral, clockwise", limit_urad=95.0, spiral_direction=-1
)
"""The configuration `demand-limit` of `fjh table1`."""

# At constant speed the radius that meets W_a is 113 urad.
_SPEED = {"spiral_exponent": 0.5, "spiral_radius_urad": 113.0}

CANDIDATES: Sequence[Candidate] = (
    BENCH,
    _RESONANCE,
    replace(
        _EXCITED,
        name="resonance_noise",
        what="the same, five times the noise",
        constants={"roll_off_hz": 40.0, "detector_noise_m": 1.5e-6},
    ),
    replace(
        _EXCITED,
        name="resonance_floor",
        what="the same, floor vibration VC-C",
        floor_velocity_m_per_s=12.5e-6,
    ),
    Candidate(
        "floor_office", "floor vibration of an office, ISO 2631-2", floor_velocity_m_per_s=400e-6
    ),
    Candidate("off_centre", "locked off centre, spiral at once", lock_m=-110e-6),
    Candidate("off_centre_settled", "the same, loop settled first", lock_m=-110e-6, lead_in_s=2.0),
    # W_a needs 16.6 um of every strut, 0.105 A; the uncorrected spiral 24.9 um of strut 4.
    Candidate(
        "saturation",
        "amplifiers limited to the peak current of W_a",
        {"amplifier_limit_a": 0.105},
        simulated=COLUMNS,
    ),
    Candidate(
        "half_bandwidth",
        "half the crossovers, half the spiral",
        {"alpha_crossover_hz": 4.3, "beta_crossover_hz": 3.3, "spiral_radius_urad": 50.0},
    ),
    Candidate(
        "together",
        "smaller changes of all of them together",
        {"alpha_crossover_hz": 6.45, "beta_crossover_hz": 4.95, "roll_off_hz": 30.0}
        | {"spiral_radius_urad": 75.0, "detector_noise_m": 1e-6, "amplifier_limit_a": 0.2},
        damping_ratio=0.03,
        floor_velocity_m_per_s=50e-6,
        lock_m=-40e-6,
        simulated=COLUMNS,
    ),
    RETUNED,
    replace(RETUNED, name="retuned_settled", what="the same, loop settled first", lead_in_s=2.0),
    replace(_limited("limit", "testbed's spiral", 98.0), simulated=("W_a", "W_a_uncorrected")),
    CLOCKWISE,
    _limited("limit_speed", "constant speed", 117.5, **_SPEED),
    _limited(
        "limit_speed_90", "constant speed from 90 degrees", 118.1, **_SPEED, spiral_start_deg=90.0
    ),
    _limited(
        "limit_anti_windup",
        "constant speed, conditional integration",
        106.2,
        **_SPEED,
        spiral_direction=-1,
        anti_windup=True,
    ),
)
