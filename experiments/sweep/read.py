"""A design from its TOML file; whatever is wrong there is said in one sentence."""

import tomllib
from pathlib import Path
from typing import Any

from experiments.hexapod.testbed import Bench, check_within
from experiments.output.study import WrongInput
from experiments.sweep.design import Design, grid
from experiments.sweep.factors import (
    CONDITIONS,
    KINDS,
    LIMITS,
    NAMES,
    Choice,
    Factor,
    Range,
)

DEFAULT = Path(__file__).with_name("default.toml")

MOST_RUNS = 10_000_000


def read_design(path: Path | None) -> Design:
    """The design in a file; None is the default.

    Raises:
        WrongInput: It cannot be read, or says what makes no sense.
    """
    try:
        text = tomllib.loads((path or DEFAULT).read_text(encoding="utf-8"))
    except OSError as error:
        raise WrongInput(f"--design {path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise WrongInput(f"--design {path} cannot be read: {error}") from None
    except (ValueError, RecursionError) as error:
        raise WrongInput(f"--design {path} is not TOML: {error}") from None
    try:
        return _design(text)
    except (WrongInput, ValueError) as wrong:
        raise WrongInput(f"--design {path or DEFAULT.name}: {wrong}") from None


def _design(text: dict[str, Any]) -> Design:
    _only(text, {"layout", "runs", "duration_s", "vary"}, "")
    layout, duration_s = text.get("layout"), text.get("duration_s", Bench().quick_duration_s)
    if layout not in ("latin-hypercube", "grid"):
        raise WrongInput(f'layout must be "latin-hypercube" or "grid", got {layout!r}')
    vary = text.get("vary")
    if not isinstance(vary, dict) or not vary:
        raise WrongInput(f"[vary] must name something to vary, got {vary!r}")
    factors = [_factor(name, value, layout) for name, value in vary.items()]
    check_within("duration_s", duration_s, _longest_period_s(factors), Bench().duration_s)
    runs = text.get("runs")
    if layout == "grid":
        if runs is not None:
            raise WrongInput(f"runs must be left out of a grid, which counts its own, got {runs!r}")
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
        raise WrongInput(f"{name} must go from less to more, got {low} to {high}")
    if type(log) is not bool or (log and (low <= 0 or KINDS[name] == "integer")):
        raise WrongInput(f"{name} can be log = true where it is real and positive, got {table}")
    if layout == "grid" and (type(points) is not int or points < 2):
        raise WrongInput(f"{name} must say in how many points a grid takes it, got {points!r}")
    if layout != "grid" and points is not None:
        raise WrongInput(f"{name} must not have points outside a grid, got {points!r}")
    return Range(name, low, high, log, points)


def _checked(name: str, value: Any) -> Any:
    """The value, of the kind that the name asks for, and within its limits."""
    if name in LIMITS:
        check_within(name, value, *LIMITS[name])
        return float(value) if KINDS[name] == "real" else value
    wanted, said = {
        "switch": (type(value) is bool, "true or false"),
        "name": (value in NAMES.get(name, ()), f"one of {', '.join(NAMES.get(name, ()))}"),
        "struts": (
            isinstance(value, str) and len(value) == 6 and set(value) <= set(CONDITIONS),
            f"six letters out of {''.join(CONDITIONS)}",
        ),
    }[KINDS[name]]
    if not wanted:
        raise WrongInput(f"{name} must be {said}, got {value!r}")
    return value


def _longest_period_s(factors: list[Factor]) -> float:
    """Of the controller, in any run: no run is shorter."""
    for each in factors:
        if each.name == "control_period_s":
            return each.high if isinstance(each, Range) else max(map(float, each.values))
    return Bench().control_period_s


def _only(table: dict[str, Any], known: set[str], where: str) -> None:
    if strange := sorted(set(table) - known):
        raise WrongInput(f"there is no {strange[0]!r}{where}; there are {', '.join(sorted(known))}")
