"""Which of the studies the options of `fjh recover` ask for: the hexapod's two, any robot's."""

from contextlib import AbstractContextManager
from dataclasses import replace
from types import ModuleType
from typing import Any

from experiments.recover import (
    CONTROLLER,
    HEXAPOD_ALONE,
    HOURS,
    OTHERS_ALONE,
    event_results,
    mechanism_event_results,
    mechanism_results,
)
from experiments.recover import results as hexapod_results
from experiments.recover.event_runs import Events, run_events
from experiments.recover.mechanism_events import MechanismEvents, run_mechanism_events
from experiments.recover.mechanisms import Mechanisms, run_mechanisms
from experiments.recover.runs import Recover, run_recover
from experiments.study.results import Check, Results
from experiments.study.study import OnProgress, WrongInput

Outcome = Recover | Events | Mechanisms | MechanismEvents | dict[str, Any]


def run(
    *, seed: int, quick: bool, on_progress: OnProgress, **options: Any
) -> AbstractContextManager[Outcome]:
    """The hexapod on its spiral, or the robot of the option `model`; or either in all events.

    Raises:
        WrongInput: An option is given that is for another one; or as
            :func:`experiments.recover.runs.run_recover`,
            :func:`experiments.recover.event_runs.run_events`,
            :func:`experiments.recover.mechanisms.run_mechanisms` and
            :func:`experiments.recover.mechanism_events.run_mechanism_events`.
    """
    hexapod, events = options["model"] is None, options.pop("events")
    for option in OTHERS_ALONE if hexapod else HEXAPOD_ALONE:
        if options.pop(option.name) not in (option.default, None):
            for_whom = "needs" if hexapod else "does not go with"
            raise WrongInput(f"--{option.name.replace('_', '-')} {for_whom} --model")
    common: dict[str, Any] = {"seed": seed, "quick": quick, "on_progress": on_progress}
    if hexapod:
        del options["model"]
        if events:
            for option in (HOURS, CONTROLLER):
                if options.pop(option.name) != option.default:
                    raise WrongInput(f"--{option.name} does not go with --events")
            return run_events(**common, **options)
        return run_recover(**common, **options)
    return (run_mechanism_events if events else run_mechanisms)(**common, **options)


def results(outcome: Outcome) -> Results:
    """Everything that `fjh recover` publishes."""
    if isinstance(outcome, Mechanisms):
        return mechanism_results.results(outcome)
    if isinstance(outcome, MechanismEvents):
        return mechanism_event_results.results(outcome)
    if isinstance(outcome, Events):
        return event_results.results(outcome)
    if isinstance(outcome, Recover):
        return hexapod_results.results(outcome)
    return replace(_study(outcome).described(outcome), published=True)


def checks(summary: dict[str, Any]) -> list[Check]:
    """The checks of the study, from its `recover.json` alone."""
    return _study(summary).checks(summary)


def _study(summary: dict[str, Any]) -> ModuleType:
    """Whose summary it is."""
    if "robot" in summary:
        return mechanism_event_results if "events" in summary else mechanism_results
    return event_results if "events" in summary else hexapod_results
