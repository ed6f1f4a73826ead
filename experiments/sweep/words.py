"""What a sweep can take from a range, in words with units, for the labels of figures."""

WORDS = {
    "failure_time_s": "time of the failure, s",
    **{f"joint_weight_{k}": f"weight of strut {k}" for k in range(1, 7)},
    **{f"secondary_weight_t_{axis}": f"weight of $t_{axis}$" for axis in "xyz"},
    "secondary_weight_gamma": "weight of $\\gamma$",
    "seed": "seed of the noise",
    "spiral_radius_urad": "radius of the spiral, µrad",
    "spiral_period_s": "time of one turn, s",
    "alpha_crossover_hz": "crossover of $\\alpha$, Hz",
    "beta_crossover_hz": "crossover of $\\beta$, Hz",
    "roll_off_hz": "roll-off, Hz",
    "roll_off_damping": "damping ratio of the roll-off",
    "control_period_s": "control period, s",
    "focal_length_m": "focal length, m",
    "detector_half_width_m": "half width of the detector, m",
    "detector_noise_m": "noise of the detector, m",
    "dac_bits": "resolution of the converters, bits",
    "dac_full_input_a": "current at full input, A",
    "amplifier_limit_a": "limit of the amplifiers, A",
    "coil_newton_per_a": "force constant of the coils, N/A",
    "settling_s": "time to settle, s",
    "strut_sensor_noise_m": "noise of the strut sensors, m",
    "handover_s": "time of the handover, s",
}
"""By the names of the columns; weights have no unit."""
