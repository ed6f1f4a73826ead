"""Design of a sweep: the varied quantities, from a TOML file, and the runs."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from itertools import islice, product
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from argument_checks import short_repr
from fjh.rig.conditions import CODE_LETTERS, failures_of
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.testbed import LIMITS as BENCH_LIMITS
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.options import JacobianChoice
from fjh.rig.within import check_within
from fjh.study.errors import WrongInput
from ftc import Goal
from sim import Failure

DEFAULT = Path(__file__).with_name("sweep.toml")
MOST_RUNS = 200_000
"""Largest number of runs, because all rows are in memory."""

ACTIVE = tuple(f"joint_weight_{k}" for k in range(1, 7))
SECONDARY = tuple(f"secondary_weight_{name}" for name in ("t_x", "t_y", "t_z", "gamma"))
"""Names of the factors on the diagonals of W1 and W2, in the order of the paper."""

BENCH = tuple(each.name for each in fields(TestbedConfig) if "duration_s" not in each.name)
"""Names of the testbed's constants that a design can vary."""

_ONES = (1.0,) * 6
WEIGHTS = {each.name: (each.goal.joint_weight, each.goal.secondary_weight) for each in COLUMNS[:5]}
WEIGHTS["both"] = _ONES, _ONES[:4]
"""Diagonals of W1 and W2 by name: the paper's five, and ones in both."""

CHOICES: dict[str, tuple[Any, ...]] = {
    "known": (True, False),
    "weight": tuple(WEIGHTS),
    "jacobian": ("constant", "analytic"),
    "spiral_direction": (1, -1),
    "anti_windup": (True, False),
}
LIMITS: dict[str, tuple[float, float]] = {
    "failure_time_s": (0.0, 3600.0),
    **dict.fromkeys(ACTIVE + SECONDARY, (0.0, 1e6)),
    "seed": (0, 2**32 - 1),
    **{name: BENCH_LIMITS[name] for name in BENCH if name in BENCH_LIMITS},
}
"""Lower and upper bound of each number, which is an integer if its bounds are integers."""

VARIED = ("struts", *CHOICES, *LIMITS)
"""Names of all quantities that can be varied."""

Factor = list[Any] | dict[str, Any]
"""Varied quantity: a list of values, or a range with the keys from, to, log, points (in a grid)."""


@dataclass(frozen=True)
class Design:
    """Design of a sweep; quantities that it does not vary are those of the testbed.

    Attributes:
        layout: "latin-hypercube": each range is divided into as many intervals as there are runs,
            with one run in each; "grid": all combinations of values, the last factor fastest.
        runs: Number of runs; in a grid, of the first ones.
        duration_s: Duration of each run.
        factors: Varied quantities, by name.
    """

    layout: str
    runs: int
    duration_s: float
    factors: dict[str, Factor]


@dataclass(frozen=True)
class SweepRun:
    """Parameters of a run of a sweep, which are sent to workers.

    The weights, diagonals of W1 over struts and W2 over [t_x, t_y, t_z, gamma], are those with the
    name `weight` times their factors; None is zero.
    """

    number: int  # from 0 on; column `case` of the dataset
    duration_s: float  # of the spiral
    joint_weight: tuple[float, ...] | None
    secondary_weight: tuple[float, ...] | None
    bench: TestbedConfig
    seed: int  # of the detector noise
    struts: str = "SSSSSS"  # a letter of `LETTERS` for each: state from `failure_time_s` on
    failure_time_s: float = 0.0
    known: bool = True  # whether the mapping is reconfigured at the failures
    weight: str = "W_a"
    jacobian: JacobianChoice = "analytic"

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Failures of the plant during the run."""
        occur = self.failure_time_s < self.duration_s
        return failures_of(self.struts, self.failure_time_s) if occur else ()

    @property
    def goal(self) -> Goal:
        """Goal of the mapping before the failures."""
        return Goal(joint_weight=self.joint_weight, secondary_weight=self.secondary_weight)

    @property
    def reconfigured(self) -> Goal:
        """Goal of the mapping after the failures, which assumes locked struts at the centre."""
        if not self.known:
            return self.goal
        of = {"locked": [], "free": [], "loose": []}
        for failure in self.failures:
            of[failure.kind].append(failure.actuator)
        locked_at, free = dict.fromkeys(of["locked"], 0.0), tuple(of["free"])
        return replace(self.goal, locked_at=locked_at, free=free, spring_lost=tuple(of["loose"]))

    def parameters(self) -> dict[str, Any]:
        """Return the parameters as columns of the dataset."""
        first = ("seed", "duration_s", "struts", "failure_time_s", "known", "weight")
        bench = asdict(self.bench)
        return {
            "case": self.number,
            **{name: getattr(self, name) for name in first},
            **dict(zip(ACTIVE, self.joint_weight or (None,) * 6, strict=True)),
            **dict(zip(SECONDARY, self.secondary_weight or (None,) * 4, strict=True)),
            "jacobian": self.jacobian,
            **{name: bench[name] for name in BENCH},
        }


def sweep_run(number: int, duration_s: float, varied: Mapping[str, Any]) -> SweepRun:
    """Return a run with these values; by default those of the testbed, W_a, no failures."""
    own = ("seed", "struts", "failure_time_s", "known", "weight", "jacobian")
    options, bench = ({k: varied[k] for k in names if k in varied} for names in (own, BENCH))
    joint, secondary = (
        diagonal and tuple(w * varied.get(k, 1.0) for w, k in zip(diagonal, names, strict=True))
        for diagonal, names in zip(
            WEIGHTS[options.get("weight", "W_a")], (ACTIVE, SECONDARY), strict=True
        )
    )
    return SweepRun(number, duration_s, joint, secondary, TestbedConfig(**bench), **options)


def runs_of(design: Design, seed: int) -> list[SweepRun]:
    """Return the runs of a design, each determined by design, seed and number."""
    factors = design.factors
    if design.layout == "grid":
        points_of_design = islice(product(*map(_grid, factors, factors.values())), design.runs)
    else:
        cube = qmc.LatinHypercube(d=len(factors), rng=np.random.default_rng(seed))
        points = cube.random(design.runs).tolist()
        points_of_design = (list(map(_at, factors, factors.values(), point)) for point in points)
    runs = []
    for number, values in enumerate(points_of_design):
        noise = np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1)
        varied = {"seed": int(noise[0])} | dict(zip(factors, values, strict=True))
        runs.append(sweep_run(number, design.duration_s, varied))
    return runs


def _at(name: str, factor: Factor, u: float) -> Any:
    """Return the value of a factor at u from 0 to 1; values of a list have equal parts."""
    if isinstance(factor, list):
        return factor[int(u * len(factor))]
    low, high = factor["from"], factor["to"]
    if _is_whole(name):
        return int(min(low + u * (high - low + 1), high))
    return low * (high / low) ** u if factor["log"] else low + u * (high - low)


def _grid(name: str, factor: Factor) -> list[Any]:
    if isinstance(factor, list):
        return factor
    return [_at(name, factor, k / (factor["points"] - 1)) for k in range(factor["points"])]


def _is_whole(name: str) -> bool:
    return isinstance(LIMITS[name][0], int)


def read_design(path: Path | None) -> Design:
    """Return the design in a file; None is the default file.

    Raises:
        WrongInput: The file cannot be read, or the design is invalid.
    """
    try:
        return _design(tomllib.loads((path or DEFAULT).read_text(encoding="utf-8")))
    except OSError as error:
        raise WrongInput(f"--design {path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise WrongInput(f"--design {path or DEFAULT.name}: {error}") from None


def _design(content: dict[str, Any]) -> Design:
    _only(content, ("layout", "runs", "duration_s", "vary"))
    layout, runs, vary = map(content.get, ("layout", "runs", "vary"))
    if layout not in ("latin-hypercube", "grid"):
        raise ValueError(f"layout must be latin-hypercube or grid, got {short_repr(layout)}")
    if not isinstance(vary, dict) or not vary:
        raise ValueError(f"[vary] must name at least one quantity, got {short_repr(vary)}")
    _only(vary, VARIED, " to vary")
    grid, bench = layout == "grid", TestbedConfig()
    factors = {name: _factor(name, value, grid) for name, value in vary.items()}
    period_s = factors.get("control_period_s", [bench.control_period_s])
    longest_s = max(period_s) if isinstance(period_s, list) else period_s["to"]
    duration_s = content.get("duration_s", bench.quick_duration_s)
    check_within("duration_s", duration_s, longest_s, bench.duration_s)
    if grid:
        if runs is not None:
            raise ValueError(f"runs must not be given for a grid, got {short_repr(runs)}")
        runs = prod(len(f) if isinstance(f, list) else f["points"] for f in factors.values())
    elif type(runs) is not int or runs < 1:
        raise ValueError(f"runs must be a whole number from 1 on, got {short_repr(runs)}")
    if runs > MOST_RUNS:
        got = f"got {short_repr(runs)}: their rows are in memory"
        raise ValueError(f"there must be at most {MOST_RUNS} runs, {got}")
    return Design(layout, runs, float(duration_s), factors)


def _factor(name: str, value: Any, grid: bool) -> Factor:
    if not isinstance(value, dict):
        values = value if isinstance(value, list) else [value]
        if not values:
            raise ValueError(f"{name} must have at least one value, got none")
        return [_checked(name, item) for item in values]
    if name not in LIMITS:
        raise ValueError(f"{name} must be a list of values, got a range")
    _only(value, ("from", "to", "log", "points"), f" in {name}")
    low, high = (_checked(name, value.get(end)) for end in ("from", "to"))
    log, points = value.get("log", False), value.get("points")
    if not low < high:
        raise ValueError(f"{name} must have from below to, got {low} to {high}")
    if type(log) is not bool or (log and (low <= 0 or _is_whole(name))):
        raise ValueError(f"{name} can have log = true only if it is real and positive")
    if (points is None) == grid or (grid and (type(points) is not int or points < 2)):
        expected = "a number from 2 on in a grid, and omitted otherwise"
        raise ValueError(f"points of {name} must be {expected}, got {short_repr(points)}")
    return {"from": low, "to": high, "log": log} | ({"points": points} if grid else {})


def _checked(name: str, value: Any) -> Any:
    """Return the value of a quantity, after a check of its type and limits."""
    if name in LIMITS:
        check_within(name, value, *LIMITS[name])
        return value if _is_whole(name) else float(value)
    if name == "struts":
        expected = f"six letters out of {CODE_LETTERS}"
        valid = isinstance(value, str) and len(value) == 6 and set(value) <= set(CODE_LETTERS)
    else:
        expected = f"one of {', '.join(map(json.dumps, CHOICES[name]))}"
        valid = (type(value), value) in [(type(choice), choice) for choice in CHOICES[name]]
    if not valid:
        raise ValueError(f"{name} must be {expected}, got {short_repr(value)}")
    return value


def _only(table: dict[str, Any], known: tuple[str, ...], where: str = "") -> None:
    if unknown := sorted(set(table) - set(known)):
        there = f"there are {', '.join(known)}"
        raise ValueError(f"there is no {short_repr(unknown[0])}{where}; {there}")
