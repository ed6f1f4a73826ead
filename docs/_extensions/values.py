"""Numbers in sentences of the pages, by name; the results in docs/data have them."""

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from results import ANGLES, duration, row, rows, study

from experiments.app.report import STUDIES

# docs/table1.md


def _column(name: str) -> dict[str, Any]:
    return row("table1", "columns", name=name)


def _off(columns: Iterable[dict[str, Any]], expected: str) -> float:
    """Return the largest difference of RMS errors from the expected ones, in percent."""
    pairs = [
        (column[f"{angle}_rms_urad"], column[f"{expected}_{angle}_rms_urad"])
        for column in columns
        for angle in ANGLES
    ]
    return 100 * max(abs(here / there - 1) for here, there in pairs)


def _best_constant() -> str:
    """Return the least largest deviation of one constant per angle from the paper, in percent."""
    known = study("table1")["columns"][:-1]
    paper = [[column[f"paper_{angle}_rms_urad"] for column in known] for angle in ANGLES]
    deviations = [(max(errors) - min(errors)) / (max(errors) + min(errors)) for errors in paper]
    return f"{100 * max(deviations):.1f}"


def _lock(angle: str) -> str:
    uncorrected, healthy = (
        _column(name)[f"{angle}_rms_urad"] for name in ("W_a_uncorrected", "W_a")
    )
    return f"{uncorrected / healthy:.2f}"


def _translation_ratios() -> str:
    free, small = (_column(name)["secondary_peak"] for name in ("W_d", "W_e"))
    return " and ".join(f"{free[axis] / small[axis]:.0f}" for axis in ("t_x_um", "t_y_um"))


def _limited() -> dict[str, Any]:
    """Return the uncorrected run with a limit on the demand, and the paper's errors."""
    where = {"candidate": "limit_clockwise", "column": "W_a_uncorrected"}
    paper = {key: value for key, value in _column("W_a_uncorrected").items() if "paper" in key}
    return row("uncorrected", "runs", **where) | paper


def _mismatched() -> str:
    further = row("table1", "further_runs", runs="mismatched")
    return f"{100 * further['largest_relative_difference']:.1f}"


# docs/testbed.md


def _modes() -> str:
    *others, last = (f"{mode:.1f}" for mode in study("figures")["modes_hz"])
    return f"{', '.join(others)} and {last}"


def _margins(angle: str) -> str:
    loop = row("table1", "loops", angle=angle)
    return f"{loop['gain_margin_db']:.1f} dB and {loop['phase_margin_deg']:.0f}°"


def _gap() -> str:
    """Return the largest gap of the loops in Table I and with a free strut, in nm."""
    runs = study("table1")["columns"] + rows("release", "spirals", kind="free")
    return f"{1e9 * max(run['closure_residual_max_m'] for run in runs):.2g}"


def _size(name: str, factor: float) -> str:
    return f"{factor * study('table1')['mismatch'][name]:.3g}"


# docs/jacobian.md

VARIANTS = ("constant", "analytic", "incremental", "relinearized")


def _variation(norm: str) -> str:
    return f"{row('jacobian', 'variation', norm=norm)['value']:.5f}"


def _bound(norm: str) -> str:
    """Return the certified bound, rounded up."""
    bound = row("jacobian", "variation", norm=norm)["certified_upper_bound"]
    return f"{math.ceil(1e5 * bound) / 1e5:.5f}"


def _constant_jacobian() -> str:
    further = row("table1", "further_runs", runs="other Jacobian")
    return f"{further['largest_rms_difference_urad']:.1e}".replace("e-0", "e-")


def _harmful_spiral() -> str:
    cost = row("jacobian", "costs", cost="static_extra_percent", percent=1.0)
    return f"{cost['spiral_factor']:.0f}"


def _largest_entry() -> str:
    reading = row("jacobian", "tried", reading="twist; largest entry of the change")
    size = math.hypot(*(entry for entries in study("jacobian")["J0"] for entry in entries))
    return f"{size * reading['frobenius']:.6f}"


def _looped(quantity: str, variant: str, factor: int = 100) -> float:
    """Return a quantity of the run under W_e with stroke and spiral of this size."""
    result = study("jacobian")
    where = {"column": "W_e", "variant": variant, "seed": result["seed"]}
    sizes = {"stroke_factor": factor, "spiral_factor": factor}
    return row("jacobian", "runs", **where, **sizes)[quantity]


def _extra(variant: str) -> str:
    return f"{_looped('extra_percent', variant):.2f}"


def _nominal_extra() -> str:
    extra = [_looped("extra_percent", variant, 1) for variant in VARIANTS]
    return f"{min(extra):.2f} to {max(extra):.2f}"


# docs/reproduce.md


def _possible(*verdicts: str) -> str:
    return str(sum(row("figures", "verdicts", verdict=one)["conditions"] for one in verdicts))


def _lost(*failures: int) -> str:
    """Return in how many conditions with these numbers of failures pointing is not possible."""
    conditions = {
        verdict["verdict"]: sum(verdict[f"failures_{k}"] for k in failures)
        for verdict in study("figures")["verdicts"]
    }
    possible = conditions["rigid"] + conditions["springs"]
    total = sum(conditions.values())
    return f"{total - possible} of {total}"


def _paper_over_ours() -> str:
    column = _column("W_a_uncorrected")
    return f"{column['paper_alpha_rms_urad'] / column['alpha_rms_urad']:.1f}"


def _origin(key: str) -> Any:
    return study("origin")["table1"][key]


def _version(package: str) -> str:
    return ".".join(_origin("versions")[package].split(".")[:2])


# docs/force.md


def _errors(key: str, table: str = "theorems", **where: Any) -> list[float]:
    return [one[key] for one in rows("force", table, **where)]


def _exact() -> str:
    """Return the largest error of major forces that the torques determine, in percent."""
    kinds = (None, "free", "loose")
    errors = [_errors("pressed_major_off_percent", kind=kind) for kind in kinds]
    return f"{max(map(max, errors)):.2g}"


def _locked() -> str:
    errors = _errors("pressed_major_off_percent", kind="locked")
    return f"{min(errors):.0f} to {max(errors):.0f}"


def _torques() -> list[float]:
    return _errors("weighed_over_mapping", "tradeoff", way="others")


def _pseudo_inverses() -> str:
    weights = ({"way": "pseudo_inverse", "major_weight_per_n_m": weight} for weight in (1, 10, 100))
    *others, last = (
        f"{row('force', 'tradeoff', **weight)['major_off_percent']:.2g}" for weight in weights
    )
    return f"{', '.join(others)} and {last}"


def _free(key: str, mapping: str) -> str:
    where = {"condition": "strut 1 free", "load": 1, "mapping": mapping}
    return f"{row('force', 'prescribed', **where)[key]:.2f}"


def _with_and_without(name: str, key: str) -> tuple[float, float]:
    """Return a quantity of the platform with internal force, and without it."""
    used, without = (
        row("force", "internal_force", name=name, internal_force=use)[key]
        for use in ("used", "without")
    )
    return used, without


VALUES: dict[str, Callable[[], str]] = {
    **{f"time.{name}": partial(duration, name) for name in STUDIES},
    "time.report": lambda: duration(*STUDIES),
    "table1.off": lambda: f"{_off(study('table1')['columns'][:-1], 'paper'):.1f}",
    "table1.constant": _best_constant,
    "table1.t_x_t_y": _translation_ratios,
    "table1.alpha": lambda: _lock("alpha"),
    "table1.beta": lambda: _lock("beta"),
    "table1.limit": lambda: f"{_off([_limited()], 'paper'):.1f}",
    "table1.mismatched": _mismatched,
    "testbed.modes": _modes,
    "testbed.gap": _gap,
    "testbed.alpha": lambda: _margins("alpha"),
    "testbed.beta": lambda: _margins("beta"),
    "testbed.linear": lambda: f"{_off(study('table1')['columns'], 'predicted'):.2f}",
    "testbed.gain": lambda: _size("gain", 100),
    "testbed.stiffness": lambda: _size("stiffness", 100),
    "testbed.damping": lambda: _size("damping", 100),
    "testbed.inertia": lambda: _size("inertia", 100),
    "testbed.delay": lambda: _size("delay_ticks", 1),
    "testbed.floor": lambda: _size("floor_um_per_s", 1),
    "testbed.drift": lambda: _size("drift_urad_per_s", 1),
    "testbed.gain_drift": lambda: _size("gain_drift_per_s", 100),
    "testbed.hysteresis": lambda: _size("hysteresis", 100),
    "testbed.step": lambda: _size("timestep_s", 1e6),
    "jacobian.frobenius": lambda: _variation("frobenius"),
    "jacobian.two": lambda: _variation("two"),
    "jacobian.frobenius_bound": lambda: _bound("frobenius"),
    "jacobian.two_bound": lambda: _bound("two"),
    "jacobian.rms": _constant_jacobian,
    "jacobian.spiral": _harmful_spiral,
    "jacobian.entry": _largest_entry,
    "jacobian.nominal": _nominal_extra,
    **{f"jacobian.{variant}": partial(_extra, variant) for variant in VARIANTS},
    "jacobian.rms_large": lambda: f"{abs(_looped('pointing_cost_percent', 'constant')):.2g}",
    "jacobian.gamma": lambda: f"{_looped('gamma_drift_urad', 'incremental'):.0f}",
    "jacobian.gamma_nominal": lambda: f"{_looped('gamma_drift_urad', 'incremental', 1):.2g}",
    "reproduce.rigid": lambda: _possible("rigid"),
    "reproduce.springs": lambda: _possible("rigid", "springs"),
    "reproduce.lost_1_3": lambda: _lost(1, 2, 3),
    "reproduce.lost_4": lambda: _lost(4),
    "reproduce.lost_5": lambda: _lost(5),
    "reproduce.alpha": _paper_over_ours,
    "reproduce.seed": lambda: str(_origin("seed")),
    "reproduce.python": lambda: _version("python"),
    "reproduce.mujoco": lambda: _version("mujoco"),
    "reproduce.processor": lambda: _origin("machine")["processor"],
    "reproduce.cores": lambda: str(_origin("machine")["cores"]),
    "force.exact": _exact,
    "force.locked": _locked,
    "force.minimal": lambda: f"{max(map(abs, _errors('cost_excess'))):.0e}",
    "force.torques": lambda: str(len(_torques())),
    "force.larger": lambda: f"{min(_torques()):.3f} to {max(_torques()):.2f}",
    "force.pseudo": _pseudo_inverses,
    "force.lost": lambda: _free("lacking_force_n", "rigid"),
    "force.moved": lambda: _free("simulated_translation_um", "rigid"),
    "force.predicted": lambda: _free("predicted_translation_um", "rigid"),
    "force.elastic_lost": lambda: _free("lacking_force_n", "elastic"),
    "force.elastic_moved": lambda: _free("simulated_translation_um", "elastic"),
    "force.elastic_tilt": lambda: _free("simulated_pointing_urad", "elastic"),
    "force.hot": lambda: "{:.1f} instead of {:.1f}".format(
        *_with_and_without("motor 1 hot", "hot_motor_rms_n")
    ),
    "force.least": lambda: "{1:.1f} to {0:.1f}".format(
        *_with_and_without("squeezed", "least_squeeze_n")
    ),
    "force.wrench": lambda: f"{max(_errors('wrench_off_percent', 'internal_force')):.2g}",
}
