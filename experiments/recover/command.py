"""The command: the cases that its options ask for, and what is done beside them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import chain, islice
from math import ceil, inf
from pathlib import Path
from typing import Any, get_args

from experiments.recover import CONTROLLER, HEXAPOD_ALONE, HOURS, OTHERS_ALONE, plan, predictions
from experiments.recover.case import BENCH, Case, exact_rig
from experiments.recover.recordings import SHOWN, Kept, fly, kept
from experiments.recover.row import SCHEMA, other_columns, row_of
from experiments.rig.bounds import check_number
from experiments.rig.choices import Sensing
from experiments.rig.dither import option_dither
from experiments.rig.events import EVENTS
from experiments.rig.hexapod.metrics import plant_constants
from experiments.rig.options import RobotOptions
from experiments.rig.reach import check_reach
from experiments.rig.rig import Rig
from experiments.study.basis import sources_of
from experiments.study.campaign import Again, Campaign, Row
from experiments.study.controllers import controller_factory, controller_sha256
from experiments.study.parallel import in_parallel
from experiments.study.resumable import Complete, complete
from experiments.study.study import Interrupted, OnProgress, WrongInput
from ftc.fdi.dither_design import DitherDesign
from sim import model_sha256

SOURCES = sources_of(
    "recover", without=("__init__", "command", "figure", "recordings", "results", "statistics")
)
Cases = Campaign[tuple[Case, ...]]


@dataclass(frozen=True)
class Outcome:
    """What the command simulated and computed.

    Attributes:
        done: The cases; their rows are on disk.
        rigs: The robot as each sensing has it, on its exact plant.
        designs: The dither of each, where it was designed; None is none.
        controller: Somebody else's, package.module:factory.
        others: Columns of its rows.
        kept: Runs that are kept whole.
        predicted: What is computed beside failures of the hexapod, ready for JSON.
    """

    done: Complete[tuple[Case, ...]]
    rigs: Mapping[Sensing, Rig]
    designs: Mapping[Sensing, DitherDesign | None]
    controller: str | None = None
    others: Sequence[Row] = ()
    kept: Sequence[Kept] = ()
    predicted: Mapping[str, Any] = field(default_factory=dict)


@contextmanager
def run(
    *, seed: int, quick: bool, model: Path | None, on_progress: OnProgress, **options: Any
) -> Iterator[Outcome | dict[str, Any]]:
    """All cases, on the workers there are, kept as they finish; within the context all is known.

    What is beside the cases takes minutes, and is done again by a command that goes on.

    Args:
        seed: Of all that is drawn, and of all noise.
        quick: A small set.
        model: Another robot's file; None is the hexapod.
        on_progress: Called with finished and total number of cases and other jobs.
        options: The others of the command; `folder`, `workers`, `scheduler` and `resume` as of
            :func:`experiments.study.resumable.complete`.

    Raises:
        WrongInput: An option is given that is for other cases; something that the robot does not
            have or cannot do; no such controller; or as `complete`.
        sim.ModelError: The file, or what it says.
    """
    events, controller = options.pop("events"), options["controller"]
    for option in OTHERS_ALONE if model is None else HEXAPOD_ALONE:
        if options[option.name] not in (option.default, None):
            for_whom = "needs" if model is None else "does not go with"
            raise WrongInput(f"--{option.name.replace('_', '-')} {for_whom} --model")
    for option in (HOURS, CONTROLLER) if events else ():
        if options[option.name] != option.default:
            raise WrongInput(f"--{option.name} does not go with --events")
    rigs: dict[Sensing, Rig] = {}
    designs: dict[Sensing, DitherDesign | None] = {}
    if model is not None:
        campaign, rigs, designs = _of_robot(model, options, seed, quick, events)
    elif events:
        names, each = (plan.QUICK_EVENTS, 1) if quick else (tuple(EVENTS), plan.EVENTS_EACH)
        campaign = events_of(names, each, 2.0 if quick else 3600.0, seed)
    else:
        if controller is not None:
            controller_factory(controller)  # a wrong name is refused before anything runs
        blocks = plan.QUICK if quick else plan.WHOLE
        healthy = (1, 2.0) if quick else (hours_of(options["hours"]), BENCH.duration_s)
        campaign = failures_of(blocks, *healthy, seed, controller)
    how = {name: options[name] for name in ("folder", "workers", "scheduler", "resume")}
    jobs = _jobs(campaign.runs, controller, seed, quick) if model is None and not events else {}
    cases, total = len(campaign.runs), len(campaign.runs) + sum(map(len, jobs.values()))
    with complete(
        "recover", campaign, on_progress=lambda done, _: on_progress(done, total), **how
    ) as done:
        if not isinstance(done, Complete):
            yield done
            return
        try:
            beside = _done(jobs, lambda k, _: on_progress(cases + k, total)) if jobs else {}
        except KeyboardInterrupt:
            raise Interrupted(
                f"interrupted: all {cases} runs are kept; --resume continues"
            ) from None
        rigs = rigs or {"task": exact_rig()}
        others, whole = beside.pop("others", []), beside.pop("kept", [])
        yield Outcome(done, rigs, designs, controller, others, whole, _published(beside))


def hours_of(hours: float) -> int:
    """How many runs without failures last at least so many hours.

    Raises:
        WrongInput: The hours are not positive and finite.
    """
    if not 0 < hours < inf:
        raise WrongInput(f"--hours must be positive and finite, got {hours:g}")
    return ceil(round(hours * 3600 / BENCH.duration_s, 6))


def failures_of(
    blocks: Sequence[plan.Block],
    healthy: int,
    healthy_s: float,
    seed: int,
    controller: str | None = None,
) -> Cases:
    """Failures of the hexapod, and healthy runs, of which more can be simulated later.

    Another controller changes no row, but what is published: its name and module count as well.
    """
    drawn_from: dict[str, Any] = {"blocks": blocks, "healthy_s": healthy_s}
    drawn_from = {"flights": drawn_from | {"controller": controller}, "seed": seed}
    if controller is not None:
        drawn_from["controller_sha256"] = controller_sha256(controller)
    cases = plan.hexapod_failures(blocks, healthy, healthy_s, seed)
    return Campaign(cases, row_of, SCHEMA, SOURCES, drawn_from)


def events_of(names: Sequence[str], each: int, healthy_s: float, seed: int) -> Cases:
    """Events of the hexapod."""
    drawn_from = {"events": {"names": names, "each": each, "healthy_s": healthy_s}, "seed": seed}
    cases = plan.hexapod_events(names, each, healthy_s, seed)
    return Campaign(cases, row_of, SCHEMA, SOURCES, drawn_from)


def _of_robot(
    model: Path, options: dict[str, Any], seed: int, quick: bool, events: bool
) -> tuple[Cases, dict[Sensing, Rig], dict[Sensing, DitherDesign | None]]:
    """Failures or events of any robot, and the robot and its dither by what the diagnosis sees."""
    turn_s, dither, file = options["turn"], options["dither"], model.resolve()
    check_number("turn", turn_s)
    of_robot = {each.name for each in fields(RobotOptions)} & options.keys()
    robot = RobotOptions(**{name: options[name] for name in of_robot})
    senses: tuple[Sensing, ...] = ("both",) if quick or events else get_args(Sensing)
    seen = {sense: replace(robot, sense=sense) for sense in senses}
    rigs = {sense: exact_rig(file, each) for sense, each in seen.items()}
    designs = {sense: option_dither(rig, dither) for sense, rig in rigs.items()}
    drawn_from = {"seed": seed, "robot": asdict(robot), "robot_sha256": model_sha256(file)}
    drawn_from |= {"turn_s": turn_s, "dither": dither}
    if events:
        each = 1 if quick else plan.ROBOT_EVENTS_EACH
        names = plan.QUICK_ROBOT_EVENTS if quick else tuple(EVENTS)
        drawn_from["events"] = {"names": names, "each": each}
        how = {"names": names, "each": each, "turn_s": turn_s, "seed": seed}
        cases = plan.robot_events(file, seen["both"], designs["both"], **how)
    else:
        drawn_from["quick"] = quick
        cases = plan.robot_failures(file, seen, designs, turn_s=turn_s, seed=seed, quick=quick)
    paths = {(case.options, case.course, case.duration_s): case for case in cases}
    for case in paths.values():
        rig = exact_rig(file, case.options)
        check_reach(rig, case.path(rig))
    return Campaign(cases, row_of, SCHEMA, SOURCES, drawn_from), rigs, designs


Jobs = dict[str, list[tuple[Callable[..., Any], tuple[Any, ...]]]]
"""Calls of functions with their arguments, by what they are for."""


def _jobs(cases: Sequence[Case], controller: str | None, seed: int, quick: bool) -> Jobs:
    """What is done beside failures of the hexapod, with --quick a little of it."""
    struts, names = range(1 if quick else 6), [*SHOWN][: 1 if quick else None]
    mixed = [case for case in cases if (case.sort, case.mismatch) == ("failure", "all")]
    controllers, others = [None, *([controller] if controller else [])], mixed if controller else []
    p = predictions
    settings, late = p.SETTINGS[: 1 if quick else None], p.INFORMED_LATE[: 0 if quick else None]
    return {
        "kept": [(kept, (name, seed, quick, each)) for each in controllers for name in names],
        "others": [(other_columns, (case, controller)) for case in others],
        "dither_design": [] if quick else [(p.dither_design, (struts[:3], p.FREQUENCIES_HZ))],
        "ambiguity": [(p.lookalikes, (setting, struts)) for setting in settings],
        "informed_late": [(p.informed_late, (case,)) for case in late],
        "dither_cost": [(p.dither_cost, (cases[0], 1.0 if quick else BENCH.duration_s))],
        "beliefs": [(p.beliefs, (struts,))],
    }


def _done(jobs: Jobs, on_progress: OnProgress) -> dict[str, list[Any]]:
    """Results of all calls, in parallel, by what they are for."""
    calls = [{"job": job, "given": given} for own in jobs.values() for job, given in own]
    found = iter(in_parallel(_call, calls, on_progress))
    return {name: list(islice(found, len(own))) for name, own in jobs.items()}


def _call(job: Callable[..., Any], given: tuple[Any, ...]) -> Any:
    return job(*given)


def _published(beside: dict[str, list[Any]]) -> dict[str, Any]:
    """What was computed beside failures of the hexapod, ready for JSON."""
    if not beside:
        return {}
    lists = {name: list(chain(*beside[name])) for name in ("dither_design", "informed_late")}
    alike = {"alike_below": predictions.ALIKE, "evidence_s": predictions.EVIDENCE_S}
    return lists | {
        "ambiguity": alike | {"failures": list(chain(*beside["ambiguity"]))},
        **{name: beside[name][0] for name in ("dither_cost", "beliefs")},
        "bench": asdict(BENCH) | plant_constants(exact_rig().model),
        "jacobian": "constant",
    }


def again(summary: dict[str, Any]) -> Again:
    """The runs that a `recover.json` is of.

    Another controller is not run again: its columns are not among those of the dataset.

    Raises:
        WrongInput: They are of another robot, whose file its results do not have.
    """
    basis = summary["basis"]
    if "robot" in basis:
        raise WrongInput("runs of another robot cannot be repeated without its file")
    if "events" in basis:
        return Again(events_of(**basis["events"], seed=basis["seed"]), fly)
    blocks, healthy_s = (basis["flights"][name] for name in ("blocks", "healthy_s"))
    return Again(failures_of(blocks, summary["sorts"]["healthy"], healthy_s, basis["seed"]), fly)
