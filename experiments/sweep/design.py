"""The design of a sweep: what is varied, read from a TOML file, and run k of it."""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.stats import qmc

from experiments.rig.conditions import LETTERS
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.study import WrongInput
from experiments.study.within import check_within
from experiments.sweep import sweep_run as runs_of
from experiments.sweep.sweep_run import KINDS, Choice, Factor, Range, SweepRun
from sim import Array

DEFAULT = Path(__file__).with_name("default.toml")
MOST_RUNS = 10_000_000


@dataclass(frozen=True)
class Design:
    """Which runs a sweep consists of; what is not among the factors is as on the bench.

    "latin-hypercube": each range is cut into as many slices as there are runs, with one run in
    each; "grid": every combination of the factors' values.
    """

    layout: Literal["latin-hypercube", "grid"]
    runs: int
    duration_s: float
    factors: tuple[Factor, ...]

    def as_json(self) -> dict[str, Any]:
        """The same as plain numbers and words."""
        content = asdict(self)
        return content | {"factors": {each.pop("name"): each for each in content["factors"]}}


def grid(duration_s: float, factors: Sequence[Factor]) -> Design:
    """Every combination of the factors' values; the last factor changes fastest."""
    runs = math.prod(factor.count for factor in factors)
    return Design("grid", runs, duration_s, tuple(factors))


class SweepRuns:
    """Runs 0, 1, ... of a design; each is a pure function of design, seed and number."""

    def __init__(self, design: Design, seed: int) -> None:
        """Lay the runs out; of a hypercube this keeps eight bytes for each run and factor."""
        self.design = design
        self.seed = seed
        self._cube: Array | None = None  # points of the unit cube, (runs, factors)
        if design.layout == "latin-hypercube":
            sampler = qmc.LatinHypercube(d=len(design.factors), rng=np.random.default_rng(seed))
            self._cube = sampler.random(design.runs)

    def __len__(self) -> int:
        return self.design.runs

    def __getitem__(self, number: int) -> SweepRun:
        factors = self.design.factors
        if self._cube is None:
            at = np.unravel_index(number, [factor.count for factor in factors])
            varied = {each.name: each.values[k] for each, k in zip(factors, at, strict=True)}
        else:
            row = self._cube[number].tolist()
            varied = {each.name: each.at(u) for each, u in zip(factors, row, strict=True)}
        noise = np.random.SeedSequence(self.seed, spawn_key=(number,)).generate_state(1)
        return runs_of.sweep_run(number, self.design.duration_s, {"seed": int(noise[0])} | varied)


def read_design(path: Path | None) -> Design:
    """The design in a file; None is the default.

    Raises:
        WrongInput: It cannot be read, or asks for what cannot be run.
    """
    try:
        content = tomllib.loads((path or DEFAULT).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise WrongInput(f"--design {path} cannot be read: {why}") from None
    except (ValueError, RecursionError) as error:
        raise WrongInput(f"--design {path} is not TOML: {error}") from None
    try:
        return _design(content)
    except (WrongInput, ValueError) as wrong:
        raise WrongInput(f"--design {path or DEFAULT.name}: {wrong}") from None


def _design(content: dict[str, Any]) -> Design:
    _only(content, {"layout", "runs", "duration_s", "vary"}, "")
    layout, runs, vary = (content.get(name) for name in ("layout", "runs", "vary"))
    duration_s = content.get("duration_s", TestbedConfig().quick_duration_s)
    if layout not in ("latin-hypercube", "grid"):
        raise WrongInput(f'layout must be "latin-hypercube" or "grid", got {layout!r}')
    if not isinstance(vary, dict) or not vary:
        raise WrongInput(f"[vary] must name at least one quantity, got {vary!r}")
    factors = [_factor(name, value, layout) for name, value in vary.items()]
    check_within("duration_s", duration_s, _longest_period_s(factors), TestbedConfig().duration_s)
    if layout == "grid":
        if runs is not None:
            raise WrongInput(f"runs must not be given for a grid, got {runs!r}")
        design = grid(float(duration_s), factors)
    else:
        if type(runs) is not int or runs < 1:
            raise WrongInput(f"runs must be a whole number from 1 on, got {runs!r}")
        design = Design(layout, runs, float(duration_s), tuple(factors))
    if design.runs > MOST_RUNS:
        raise WrongInput(f"there must be at most {MOST_RUNS} runs, got {design.runs}")
    return design


def _factor(name: str, value: Any, layout: str) -> Factor:
    if name not in KINDS:
        raise WrongInput(f"there is no {name!r} to vary; there are {', '.join(KINDS)}")
    if isinstance(value, dict):
        return _range(name, value, layout)
    values = value if isinstance(value, list) else [value]
    if not values:
        raise WrongInput(f"{name} must have at least one value, got none")
    return Choice(name, tuple(_checked(name, each) for each in values))


def _range(name: str, table: dict[str, Any], layout: str) -> Range:
    if KINDS[name] not in ("real", "integer"):
        raise WrongInput(f"{name} must be a list of values, got a range")
    _only(table, {"from", "to", "log", "points"}, f" in {name}")
    low, high = (_checked(name, table.get(end)) for end in ("from", "to"))
    log, points = table.get("log", False), table.get("points")
    if not low < high:
        raise WrongInput(f"{name} must have from below to, got {low} to {high}")
    if type(log) is not bool or (log and (low <= 0 or KINDS[name] == "integer")):
        raise WrongInput(f"{name} can have log = true only if it is real and positive, got {table}")
    if layout == "grid" and (type(points) is not int or points < 2):
        raise WrongInput(f"{name} must have points, the number of grid points, got {points!r}")
    if layout != "grid" and points is not None:
        raise WrongInput(f"{name} must not have points outside a grid, got {points!r}")
    return Range(name, low, high, log, points)


def _checked(name: str, value: Any) -> Any:
    """The value, of the kind that the name asks for, and within its limits."""
    if name in runs_of.LIMITS:
        check_within(name, value, *runs_of.LIMITS[name])
        return float(value) if KINDS[name] == "real" else value
    known, letters = runs_of.NAMES.get(name, ()), LETTERS
    valid, expected = {
        "switch": (type(value) is bool, "true or false"),
        "sign": (type(value) is int and value in (1, -1), "1 or -1"),
        "name": (value in known, f"one of {', '.join(known)}"),
        "struts": (
            isinstance(value, str) and len(value) == 6 and set(value) <= set(letters),
            f"six letters out of {letters}",
        ),
    }[KINDS[name]]
    if not valid:
        raise WrongInput(f"{name} must be {expected}, got {value!r}")
    return value


def _longest_period_s(factors: Sequence[Factor]) -> float:
    """Longest period of the controller in any run: no run is shorter."""
    for each in factors:
        if each.name == "control_period_s":
            return each.high if isinstance(each, Range) else max(map(float, each.values))
    return TestbedConfig().control_period_s


def _only(table: dict[str, Any], known: set[str], where: str) -> None:
    if strange := sorted(set(table) - known):
        raise WrongInput(f"there is no {strange[0]!r}{where}; there are {', '.join(sorted(known))}")
