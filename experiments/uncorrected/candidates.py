"""The candidate explanations, one at a time and together."""

from collections.abc import Sequence
from dataclasses import replace

from experiments.uncorrected.candidate import COLUMNS, Candidate

BENCH = Candidate("lost_strut", "the bench of Table I, a strut lost", simulated=COLUMNS)

_RESONANCE = Candidate(
    "resonance",
    "little damping, roll-off above the modes",
    damping_ratio=0.015,
    roll_off_hz=40.0,
    simulated=COLUMNS,
)
"""Locked mode near crossover: roll-off at the modes, dampers at a seventh."""

_EXCITED = replace(_RESONANCE, simulated=("W_a", "W_a_uncorrected"))

# Found by a search in the linear model, then moved by hand to have both ratios and W_a inside
# their 15 %: docs/uncorrected.md.
RETUNED = Candidate(
    "retuned",
    "locked off centre, six parameters fitted",
    damping_ratio=0.10,
    alpha_crossover_hz=15.5,
    beta_crossover_hz=8.6,
    roll_off_hz=32.2,
    spiral_radius_urad=141.0,
    lock_m=-125e-6,
    simulated=COLUMNS,
)

# At constant speed the radius that meets W_a is 113 urad.
_CONSTANT_SPEED = Candidate(
    "limit_speed",
    "limit on the demanded pointing, constant speed",
    spiral_exponent=0.5,
    spiral_radius_urad=113.0,
    demand_limit_urad=117.5,
    simulated=COLUMNS,
)

CLOCKWISE = Candidate(
    "limit_clockwise",
    "limit on the demanded pointing, bench's spiral, clockwise",
    spiral_direction=-1,
    demand_limit_urad=95.0,
    simulated=COLUMNS,
)
"""The configuration `demand-limit` of `fjh table1`."""

DEMAND_LIMITS = (
    Candidate(
        "limit",
        "limit on the demanded pointing, bench's spiral",
        demand_limit_urad=98.0,
    ),
    CLOCKWISE,
    _CONSTANT_SPEED,
    replace(
        _CONSTANT_SPEED,
        name="limit_speed_90",
        what="limit on the demanded pointing, constant speed from 90 degrees",
        spiral_start_deg=90.0,
        demand_limit_urad=118.1,
    ),
    replace(
        _CONSTANT_SPEED,
        name="limit_anti_windup",
        what="limit on the demanded pointing, constant speed, conditional integration",
        spiral_direction=-1,
        demand_limit_urad=106.2,
        anti_windup=True,
    ),
)
"""From the map of :mod:`experiments.uncorrected.limit_map`."""

CANDIDATES: Sequence[Candidate] = (
    BENCH,
    _RESONANCE,
    replace(
        _EXCITED,
        name="resonance_noise",
        what="the same, five times the noise",
        detector_noise_m=1.5e-6,
    ),
    replace(
        _EXCITED,
        name="resonance_floor",
        what="the same, floor VC-C",
        floor_velocity_m_per_s=12.5e-6,
    ),
    Candidate("floor_office", "floor of an office, ISO 2631-2", floor_velocity_m_per_s=400e-6),
    Candidate("off_centre", "locked off centre, spiral at once", lock_m=-110e-6),
    Candidate("off_centre_settled", "the same, loop settled first", lock_m=-110e-6, lead_in_s=2.0),
    # W_a needs 16.6 um of every strut, 0.105 A; the uncorrected spiral 24.9 um of strut 4.
    Candidate(
        "saturation", "amplifiers at what W_a needs", amplifier_limit_a=0.105, simulated=COLUMNS
    ),
    Candidate(
        "half_bandwidth",
        "half the crossovers, half the spiral",
        alpha_crossover_hz=4.3,
        beta_crossover_hz=3.3,
        spiral_radius_urad=50.0,
    ),
    Candidate(
        "together",
        "all of them, each in moderation",
        damping_ratio=0.03,
        alpha_crossover_hz=6.45,
        beta_crossover_hz=4.95,
        roll_off_hz=30.0,
        spiral_radius_urad=75.0,
        detector_noise_m=1e-6,
        floor_velocity_m_per_s=50e-6,
        lock_m=-40e-6,
        amplifier_limit_a=0.2,
        simulated=COLUMNS,
    ),
    RETUNED,
    replace(
        RETUNED,
        name="retuned_settled",
        what="the same, loop settled first",
        lead_in_s=2.0,
    ),
    *DEMAND_LIMITS,
)
