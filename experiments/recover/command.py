"""The command: the cases that its options ask for, and what is done beside them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from math import ceil, inf
from pathlib import Path
from typing import Any, get_args

from experiments.recover import CONTROLLER, HEXAPOD_ALONE, HOURS, OTHERS_ALONE, plan, simulate
from experiments.recover import predictions as p
from experiments.recover.plan import BENCH, Case, exact_rig
from experiments.recover.recordings import SHOWN, fly, kept
from experiments.recover.row import SCHEMA, other_columns, row_of
from experiments.rig.dither import rig_dither
from experiments.rig.events import EVENTS
from experiments.rig.options import RobotOptions, Sensing
from experiments.rig.reach import check_reach
from experiments.rig.rig import Rig
from experiments.study.basis import sources_of
from experiments.study.campaign import Again, Campaign
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


Sensed = tuple[dict[Sensing, Rig], dict[Sensing, DitherDesign | None]]
"""A robot on its exact plant as each sensing has it, and its dithers, where they are designed."""


@dataclass(frozen=True)
class Outcome:
    """What the command simulated and computed.

    Attributes:
        done: The cases; their rows are on disk.
        sensed: The robot and its dithers.
        controller: Somebody else's, package.module:factory.
        beside: What is done beside failures of the hexapod, lists by what it is for; elsewhere
            empty.
    """

    done: Complete[tuple[Case, ...]]
    sensed: Sensed
    controller: str | None
    beside: Mapping[str, list[Any]]


@contextmanager
def run(
    *, seed: int, quick: bool, model: Path | None, on_progress: OnProgress, **options: Any
) -> Iterator[Outcome | dict[str, Any]]:
    """All cases, on the workers there are, kept as they finish; to be published in the context.

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
    _refuse_others(model, options)
    controller, jobs = options["controller"], list[Job]()
    if model is None:
        campaign, sensed = _of_hexapod(options, seed, quick)
    else:
        campaign, sensed = _of_robot(model, options, seed, quick)
    if "flights" in campaign.drawn_from:
        jobs = _jobs(campaign.runs, controller, seed, quick)
    cases, total = len(campaign.runs), len(campaign.runs) + len(jobs)
    how = {name: options[name] for name in ("folder", "workers", "scheduler", "resume")}
    how["on_progress"] = lambda done, _: on_progress(done, total)
    with complete("recover", campaign, **how) as done:
        if not isinstance(done, Complete):
            yield done
            return
        try:
            beside = _done(jobs, lambda k, _: on_progress(cases + k, total))
        except KeyboardInterrupt:
            said = f"interrupted: all {cases} runs are kept; --resume continues"
            raise Interrupted(said) from None
        yield Outcome(done, sensed, controller, beside)


def _refuse_others(model: Path | None, options: Mapping[str, Any]) -> None:
    """Raise a `WrongInput` if an option is given that is for other cases."""
    for option in OTHERS_ALONE if model is None else HEXAPOD_ALONE:
        if options[option.name] not in (option.usual, None):
            for_whom = "needs" if model is None else "does not go with"
            raise WrongInput(f"--{option.name.replace('_', '-')} {for_whom} --model")
    for option in (HOURS, CONTROLLER) if options["events"] else ():
        if options[option.name] != option.default:
            raise WrongInput(f"--{option.name} does not go with --events")


def _of_hexapod(options: Mapping[str, Any], seed: int, quick: bool) -> tuple[Cases, Sensed]:
    """Failures or events of the hexapod."""
    sensed: Sensed = {"task": exact_rig()}, {}
    if options["events"]:
        names, each = (plan.QUICK_EVENTS, 1) if quick else (tuple(EVENTS), plan.EVENTS_EACH)
        return events_of(names, each, 2.0 if quick else 3600.0, seed), sensed
    if (controller := options["controller"]) is not None:
        controller_factory(controller)  # a wrong name is refused before anything runs
    healthy = (1, 2.0) if quick else (healthy_for(options["hours"]), BENCH.duration_s)
    blocks = plan.QUICK if quick else plan.WHOLE
    return failures_of(blocks, *healthy, seed, controller), sensed


def healthy_for(hours: float) -> int:
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
    flights = {"blocks": blocks, "healthy_s": healthy_s, "controller": controller}
    drawn_from: dict[str, Any] = {"flights": flights, "seed": seed}
    if controller is not None:
        drawn_from["controller_sha256"] = controller_sha256(controller)
    cases = plan.hexapod_failures(blocks, healthy, healthy_s, seed)
    return Campaign(cases, row_of, SCHEMA, SOURCES, drawn_from)


def events_of(names: Sequence[str], each: int, healthy_s: float, seed: int) -> Cases:
    """Events of the hexapod, and a healthy run."""
    drawn_from = {"events": {"names": names, "each": each, "healthy_s": healthy_s}, "seed": seed}
    cases = plan.hexapod_events(names, each, healthy_s, seed)
    return Campaign(cases, row_of, SCHEMA, SOURCES, drawn_from)


def _of_robot(
    model: Path, options: Mapping[str, Any], seed: int, quick: bool
) -> tuple[Cases, Sensed]:
    """Failures or events of any robot."""
    own = {each.name for each in fields(RobotOptions)} & options.keys()
    file, robot = model.resolve(), RobotOptions(**{name: options[name] for name in own})
    drawn_from = {"seed": seed, "robot": asdict(robot), "robot_sha256": model_sha256(file)}
    drawn_from |= {"turn_s": options["turn"], "dither": options["dither"], "quick": quick}
    senses: tuple[Sensing, ...] = get_args(Sensing)
    if quick or options["events"]:
        senses = ("both",)
    rigs, designs, cases = dict[Sensing, Rig](), dict[Sensing, DitherDesign | None](), list[Case]()
    for sense in senses:
        of_sense = replace(robot, sense=sense)
        rigs[sense] = rig = exact_rig(file, of_sense)
        designs[sense] = design = rig_dither(rig, options["dither"])
        sort = "event" if options["events"] else "failure"
        first = Case(sort, model=file, options=of_sense)
        first = plan.on_circle(first, options["turn"], design)
        if options["events"]:
            names = plan.QUICK_ROBOT_EVENTS if quick else tuple(EVENTS)
            drawn_from["events"] = names
            each = 1 if quick else plan.ROBOT_EVENTS_EACH
            cases += plan.robot_events(first, names, each, seed)
        else:
            cases += plan.robot_failures(first, design, seed, quick)
    for case in {(case.options, case.course, case.duration_s): case for case in cases}.values():
        check_reach(rig := exact_rig(file, case.options), case.path(rig))
    return Campaign(plan.numbered(cases), row_of, SCHEMA, SOURCES, drawn_from), (rigs, designs)


Job = tuple[str, Callable[..., Any], tuple[Any, ...]]
"""What a call is for, the function, and its arguments."""


def _jobs(cases: Sequence[Case], controller: str | None, seed: int, quick: bool) -> list[Job]:
    """What is done beside failures of the hexapod, with --quick a little of it."""
    struts, names = range(1 if quick else 6), [*SHOWN][: 1 if quick else None]
    mixed = [case for case in cases if (case.sort, case.mismatch) == ("failure", "all")]
    flies = [] if controller is None else [controller]
    late, settings = simulate.INFORMED_LATE, [*p.SETTINGS][: 1 if quick else None]
    design = "dither_design", p.dither_design, (struts[:3], p.FREQUENCIES_HZ)
    cost_s = 1.0 if quick else BENCH.duration_s
    return [
        *(("kept", kept, (n, seed, quick, own)) for own, n in product((None, *flies), names)),
        *(("others", other_columns, (case, own)) for own, case in product(flies, mixed)),
        *([] if quick else [design]),
        *(("ambiguity", p.lookalikes, (setting, struts)) for setting in settings),
        *(("informed_late", simulate.informed_late, (f,)) for f in late[: 0 if quick else None]),
        ("dither_cost", simulate.dither_cost, (cases[0], cost_s)),
        ("beliefs", p.beliefs, (struts,)),
    ]


def _done(jobs: Sequence[Job], on_progress: OnProgress) -> dict[str, list[Any]]:
    """Results of all calls, in parallel, by what they are for."""
    calls = [{"job": job, "given": given} for _, job, given in jobs]
    found, beside = in_parallel(_call, calls, on_progress) if calls else [], dict[str, list[Any]]()
    for (name, *_), result in zip(jobs, found, strict=True):
        beside.setdefault(name, []).append(result)
    return beside


def _call(job: Callable[..., Any], given: tuple[Any, ...]) -> Any:
    return job(*given)


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
