"""Numbers in sentences of the pages, by name; the results in docs/data have them."""

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from results import ANGLES, duration, row, rows, study

from experiments.app.report import STUDIES


def _setting(name: str, key: str, form: str = "g", factor: float = 1.0) -> Callable[[], str]:
    return lambda: format(factor * study(name)[key], form)


def _cell(name: str, table: str, key: str, form: str = "g", /, **where: Any) -> Callable[[], str]:
    return lambda: format(row(name, table, **where)[key], form)


def _at_most(value: float, digits: int = 2) -> str:
    """Return an upper bound, rounded up to these significant digits."""
    step = 10.0 ** (math.floor(math.log10(value)) + 1 - digits)
    return f"{math.ceil(value / step) * step:.6g}"


def _span(values: Iterable[float], form: str) -> str:
    """Return the least and the largest value, as "0.33 to 46"."""
    least, *_, largest = sorted(values)
    return f"{least:{form}} to {largest:{form}}"


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


# docs/priorities.md


def _pointing_change(goal: str, run: str) -> float:
    """Return the pointing change in the table of goals."""
    return max(one["difference_rms_urad"] for one in rows("goals", "angles", goal=goal, name=run))


def _not_pursued(goal: str) -> str:
    return f"{_pointing_change(goal, 'nothing'):.0f}"


def _sufficient_weights() -> str:
    """Return the weights of pseudo-inverses that never change pointing more than a seed does."""
    names = {one["name"]: one["major_weight"] for one in rows("goals", "runs") if one["pursues"]}
    sufficient = [
        f"{weight:g}"
        for name, weight in names.items()
        if weight is not None
        and all(
            _pointing_change(one["goal"], name) < one["difference_rms_urad"]
            for one in rows("goals", "another_seed")
        )
    ]
    return " or ".join(sufficient) or "none"


def _tracking_ms() -> str:
    """Return the tracking time, the mean of both loops."""
    return f"{1e3 * row('limits', 'spirals', name='healthy_strict')['tracking_time_s']:.0f}"


def _over_strict(strategy: str) -> list[float]:
    """Return errors over those of strict priority, on the hexapod and the arm."""
    tables = (rows("limits", table, strategy=strategy) for table in ("spirals", "arm"))
    return [one["rms_over_strict"] for runs in tables for one in runs]


def _excess(strategy: str) -> str:
    return _at_most(row("limits", "out_of_reach", strategy=strategy)["excess_largest_percent"], 3)


def _not_saturated() -> int:
    return sum(group["compared"] for group in rows("atlas", "verdicts"))


def _weight_correlation() -> float:
    """Return the largest rank correlation of a weight with an error."""
    weights = [one for one in rows("sweep", "influence") if "_weight_" in one["name"]]
    return max(abs(one[angle]) for one in weights for angle in ANGLES)


# docs/uncorrected.md

LOCK_ALONE = "lost_strut"
"""Name of the candidate with strut 1 locked and nothing else."""


def _candidate(name: str, key: str) -> Callable[[], str]:
    return _cell("uncorrected", "candidates", key, ".0f", name=name)


def _explanations(limited: bool, **where: Any) -> list[dict[str, Any]]:
    """Return the explanations with, or without, a demand limit."""
    return [
        one
        for one in rows("uncorrected", "candidates", **where)
        if one["name"] != LOCK_ALONE and (one["demand_limit_urad"] is not None) == limited
    ]


def _simulated_runs() -> str:
    """Return the number of simulated runs of explanations; others are only predicted."""
    keys = ("alpha_simulated_urad", "diverged_at_s")
    runs = [one for one in rows("uncorrected", "runs") if one["candidate"] != LOCK_ALONE]
    return str(sum(any(one[key] is not None for key in keys) for one in runs))


def _map_ratios(angle: str) -> str:
    ratios = row("uncorrected", "map")
    return _span((ratios[f"{angle}_{side}_ratio"] for side in ("least", "largest")), ".2f")


def _limits_over_radius() -> list[float]:
    """Return the demand limits that meet all criteria over the radius of the spiral."""
    radius = study("uncorrected")["bench"]["spiral_radius_urad"]
    return [
        one["demand_limit_urad"] / (one["spiral_radius_urad"] or radius)
        for one in _explanations(limited=True, explains=True)
    ]


def _over_paper(candidate: str, angle: str, *columns: str) -> list[float]:
    """Return RMS errors over the paper's."""
    key = f"{angle}_rms_urad"
    return [
        row("uncorrected", "runs", candidate=candidate, column=column)[key]
        / _column(column)[f"paper_{key}"]
        for column in columns
    ]


def _limit_off() -> str:
    """Return the largest deviation from the paper with a demand limit, in percent."""
    columns = ("W_a", "W_d", "W_e", "W_a_uncorrected")
    ratios = [_over_paper("limit_clockwise", angle, *columns) for angle in ANGLES]
    return _at_most(100 * max(abs(ratio - 1) for angle in ratios for ratio in angle), 3)


# docs/theory.md


def _least_gap() -> str:
    gap = min(atlas["smallest_gap"] for atlas in rows("release", "atlas"))
    return f"{gap:.1e}".replace("e+0", "e")


def _held() -> str:
    """Return how far strut 1 moves at most without coil force, known to the mapping or not."""
    spirals = rows("release", "spirals", kind="free", failure_time_s=0.0)
    return _at_most(max(spiral["strut_1_peak_um"] for spiral in spirals))


def _mismatches(model: str) -> list[float]:
    return [one[f"mismatch_{model}_percent"] for one in rows("release", "sweep")]


def _verdicts(*verdicts: str) -> str:
    return str(sum(one["verdict"] in verdicts for one in rows("systems", "systems")))


def _systems_off(key: str, **where: Any) -> str:
    return _at_most(100 * max(one[key] for one in rows("systems", "systems", **where)))


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
    "goals.weights": _sufficient_weights,
    **{
        f"goals.{goal}": partial(_not_pursued, goal)
        for goal in ("stroke", "obstacle", "singularity")
    },
    "limits.tracking": _tracking_ms,
    **{
        f"limits.{condition}.{name}": _cell("limits", "conditions", key, form, condition=condition)
        for condition in ("healthy", "stuck")
        for name, key, form in (
            ("unreachable", "not_attainable_s", ".2f"),
            ("least", "least_rms_urad", ".0f"),
        )
    },
    **{
        f"limits.arm.{strategy}": _cell("limits", "arm", "rms_mrad", ".2f", strategy=strategy)
        for strategy in ("strict", "clipping", "redistributed", "weighted_10", "unlimited")
    },
    "limits.heaviest": lambda: _at_most(
        max(100 * abs(ratio - 1) for ratio in _over_strict("weighted_1000"))
    ),
    "limits.demands": _setting("limits", "demands"),
    "limits.excess.clipping": lambda: _excess("clipping"),
    "limits.excess.redistributed": lambda: _excess("redistributed"),
    "limits.circle": lambda: (
        f"{min(one['circle_margin'] for one in rows('limits', 'conditions')):.2f}"
    ),
    "limits.windup": lambda: _span(_over_strict("strict_winding_up"), ".1f"),
    "atlas.conditions": _setting("atlas", "conditions"),
    "atlas.duration": _setting("atlas", "duration_s"),
    "atlas.weights": lambda: str(len(study("atlas")["weights"])),
    "atlas.runs": _setting("atlas", "runs"),
    "atlas.linear": lambda: str(_not_saturated()),
    "atlas.off": lambda: _at_most(
        max(group["largest_off_percent"] for group in rows("atlas", "verdicts"))
    ),
    "atlas.others": lambda: str(study("atlas")["runs"] - _not_saturated()),
    "atlas.singular": lambda: str(
        len({run["struts"] for run in rows("atlas", "disagreements", explained=True)})
    ),
    "sweep.runs": _setting("sweep", "runs"),
    "sweep.exact": _cell("sweep", "status", "runs", status="exact"),
    "sweep.compared": _cell("sweep", "prediction", "compared"),
    "sweep.median": _cell("sweep", "prediction", "median_percent", ".2g"),
    "sweep.off": lambda: _at_most(row("sweep", "prediction")["largest_percent"]),
    "sweep.weights": lambda: _at_most(_weight_correlation()),
    "uncorrected.tried": lambda: str(sum(len(_explanations(which)) for which in (False, True))),
    "uncorrected.runs": _simulated_runs,
    "uncorrected.limits": lambda: str(len(_explanations(limited=True))),
    "uncorrected.limits.met": lambda: str(len(_explanations(limited=True, explains=True))),
    "uncorrected.others": lambda: str(len(_explanations(limited=False))),
    "uncorrected.others.met": lambda: str(len(_explanations(limited=False, explains=True))),
    "uncorrected.within": _setting("uncorrected", "ratio_tolerance", factor=100),
    "uncorrected.within_known": _setting("uncorrected", "corrected_tolerance", factor=100),
    "uncorrected.fitted": _candidate("limit_clockwise", "demand_limit_urad"),
    "uncorrected.map": _cell("uncorrected", "map", "points"),
    "uncorrected.map.met": _cell("uncorrected", "map", "points_within_tolerance"),
    "uncorrected.map.alpha": lambda: _map_ratios("alpha"),
    "uncorrected.map.beta": lambda: _map_ratios("beta"),
    "uncorrected.fast.alpha": _setting("uncorrected", "alpha_fast_loop_ratio", ".3f"),
    "uncorrected.fast.beta": _setting("uncorrected", "beta_fast_loop_ratio", ".3f"),
    "uncorrected.limit.alpha": lambda: f"{_limited()['alpha_rms_urad']:.2f}",
    "uncorrected.limit.beta": lambda: f"{_limited()['beta_rms_urad']:.2f}",
    "uncorrected.retuned": lambda: _span(_over_paper("retuned", "alpha", "W_d", "W_e"), ".1f"),
    "uncorrected.limit.off": _limit_off,
    "uncorrected.limit.radius": lambda: _span(_limits_over_radius(), ".2f"),
    "uncorrected.limit.reach": lambda: _span(
        (one["alpha_outer_reach_percent"] for one in _explanations(limited=True, explains=True)),
        ".0f",
    ),
    "uncorrected.retuned.reach": _candidate("retuned", "alpha_outer_reach_percent"),
    "release.gap": _least_gap,
    "release.held": _held,
    "release.healthy": _cell("release", "spirals", "strut_1_peak_um", ".0f", name="healthy"),
    "release.elastic": lambda: _at_most(max(_mismatches("elastic"))),
    "release.locked": lambda: _span(_mismatches("as_if_locked"), ".2g"),
    "release.flexures": lambda: f"{rows('release', 'sweep')[0]['swing_n_per_m']:.0f}",
    **{
        f"release.peak.{name}": _cell("release", "spirals", "sensitivity_peak", ".2f", name=spiral)
        for name, spiral in {
            "healthy": "healthy",
            "locked": "loose_from_start_as_locked",
            "elastic": "loose_from_start_corrected",
        }.items()
    },
    "systems.conditions": lambda: str(len(rows("systems", "systems"))),
    "systems.exact": lambda: _verdicts("exact"),
    "systems.drifts": lambda: _verdicts("drifts"),
    "systems.lost": lambda: _verdicts("one_direction", "none"),
    "systems.off": lambda: _systems_off("largest_error"),
    "systems.off_drifts": lambda: _systems_off("major_error", unstable_major=True),
}
