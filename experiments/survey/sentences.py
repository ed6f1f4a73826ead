"""What a survey found, in sentences for a person."""

from collections.abc import Iterator

import numpy as np

from argument_checks.ties import least
from experiments.rig.conditions import KINDS, LOCKED, counted, in_words, listed
from experiments.rig.examined import LEAST_LEFT, NEARLY_LOST, NO_ROOM
from experiments.survey.cost import Cost
from experiments.survey.quantities import Condition, survived_everywhere
from experiments.survey.survey import Subject, Survey

_FEW = 3
"""Conditions that are named one by one; more are for the tables."""
_NEAR = 10.0
"""Gap of a rank decision below which a verdict is uncertain."""
_WIDE = 1e-3
"""Differences below this part are not worth a word."""


def headline(survey: Survey) -> str:
    """What single failures do to the major task."""
    start = survey.start
    if not start.survived[0]:
        return "Without failures the major task is not possible."
    kept, of = start.survived[start.singles].sum(), start.singles.size
    if kept == of:
        return f"The major task survives each of the {of} single failures."
    return f"The major task survives {kept or 'none'} of {of} single failures."


def sentences(survey: Survey, cost: Cost | None, isolation: list[str]) -> list[str]:
    """In the order in which a reader asks: what is kept, what is left, what goes, what is missing.

    Args:
        survey: What was found.
        cost: Of each actuator; None: there is none.
        isolation: Which failures can be told apart.
    """
    said = [_opening(survey)]
    said += _uncertain(survey)
    if survey.start.survived[0]:
        said += [_singles(survey, kind) for kind in KINDS]
        said += _hollow(survey)
        said += _multiples(survey)
        said += _speed(survey)
        said += _manipulability(survey)
        said += _gain(survey)
        said += _secondary(survey)
    if cost is not None:
        said.append(_costliest(survey, cost))
    said += _workspace(survey)
    return said + isolation


def rows_of(subject: Subject) -> str:
    """The major rows by name."""
    return listed([subject.rows[row] for row in subject.major])


def _opening(survey: Survey) -> str:
    subject = survey.subject
    actuators = counted(len(subject.actuators), "actuator")
    what = f"{subject.title}: {actuators}, major task {rows_of(subject)}"
    if survey.start.survived[0]:
        return " ".join(filter(None, (f"{what}.", subject.instead)))
    advice = "drop major rows (--major)"
    if subject.robot is not None:
        advice += ", take another start (--keyframe), or pin what stands (--pinned)"
    elif survey.start.verdict(0) == NO_ROOM:
        advice = "widen the limits, or hold less"
        if subject.hold is None:
            advice = "where inputs are one-sided, say what they exert at rest (--hold)"
    lost = f"it is not possible even without failures, because {survey.start.reason(0)}"
    return f"{what}; {lost}: {advice}."


def _uncertain(survey: Survey) -> Iterator[str]:
    """Verdicts that other decimals of the model might change."""
    near = survey.start.left.gap < _NEAR
    if near.any():
        yield (
            f"{near.sum():,} of {len(near):,} conditions are near a singular one: with a tolerance "
            f"of ranks changed by less than a factor of {_NEAR:g} some verdict would be another "
            "(rank_gap)."
        )


def _singles(survey: Survey, kind: int) -> str:
    start, names, word = survey.start, survey.subject.actuators, KINDS[kind]
    survived = start.survived[start.singles[:, kind - LOCKED]]
    lost = [name for name, kept in zip(names, survived, strict=True) if not kept]
    n = len(names)
    if not lost:
        return f"Each of the {n} actuators may be {word} alone: the major task is kept."
    if len(lost) == n:
        return f"No actuator may be {word}: the major task is then lost."
    return (
        f"{n - len(lost)} of {n} actuators may be {word} alone; the major task is lost with "
        f"{listed(lost, 'or')} {word}."
    )


def _hollow(survey: Survey) -> Iterator[str]:
    """Conditions that leave too little of every direction to be survived."""
    start, names = survey.start, survey.subject.actuators
    rows = [row for row in range(len(start.codes)) if start.verdict(row) == NEARLY_LOST]
    if not rows:
        return
    what = "effect" if survey.subject.robot is None else "speed or force"
    said = [f"{in_words(start.codes[row], names)} ({start.share[row]:.2%})" for row in rows]
    more = f"; and {len(rows) - _FEW:,} more" if len(rows) > _FEW else ""
    yield (
        f"Less than {LEAST_LEFT:.0%} of the {what} without failures is left in the worst "
        f"direction, which counts as lost: {'; '.join(said[:_FEW])}{more}."
    )


def _multiples(survey: Survey) -> Iterator[str]:
    start, names = survey.start, survey.subject.actuators
    some = [each for each in survey.counts if each.failures > 1 and each.survived]
    if some:
        parts = [f"{each.survived:,} of {each.conditions:,} with {each.failures}" for each in some]
        none = some[-1].failures < survey.counts[-1].failures
        yield (
            f"Of the conditions with more failures survive: {', '.join(parts)}"
            f"{', none with more' if none else ''}."
        )
    elif (pairs := start.failures == 2).any():
        yield f"{start.survived[pairs].sum():,} of {pairs.sum():,} double failures are survived."
    both = (start.failures == 2) & ((start.codes == LOCKED).sum(axis=1) == 2)
    lost = [in_words(start.codes[row], names) for row in np.flatnonzero(both & ~start.survived)]
    if 0 < len(lost) <= _FEW and survived_singles(survey, LOCKED).all():
        yield f"The task is lost with {len(lost)} of the pairs that lock: {'; '.join(lost)}."


def survived_singles(survey: Survey, kind: int) -> np.ndarray:
    """Whether each actuator may fail so alone, shape (n,)."""
    start = survey.start
    return start.survived[start.singles[:, kind - LOCKED]]


def _speed(survey: Survey) -> Iterator[str]:
    start, subject = survey.start, survey.subject
    survived = [row for row in start.singles.ravel() if start.survived[row]]
    if not survived:
        return
    what = "effect" if subject.robot is None else "speed"
    row = survived[least(start.speed_left[survived])]
    if (speed := start.left.worst_speed) is not None and np.isinf(speed[0]):
        yield f"No limit bounds the {what} in the worst direction: rates of norm one are compared."
    yield (
        f"After a single failure that is survived at least {start.speed_left[row]:.0%} of the "
        f"{what} in the worst direction is left ({in_words(start.codes[row], subject.actuators)})."
    )
    force = start.force_left
    if force is not None and np.isfinite(force[survived]).any():
        row = survived[least(force[survived])]
        if force[row] < 1.0 - _WIDE:
            yield (
                f"Of the force in the worst direction at least {force[row]:.0%} is left "
                f"({in_words(start.codes[row], subject.actuators)})."
            )
        else:
            yield "No single failure that is survived reduces the force in the worst direction."


def _manipulability(survey: Survey) -> Iterator[str]:
    start, names = survey.start, survey.subject.actuators
    rows = start.singles[:, 0]
    best, relative = start.best_possible[rows[0]], start.relative_manipulability[rows]
    if not np.isfinite(best) or not np.isfinite(relative).all():
        return
    some = f"{relative.min():.2f}"
    if relative.max() > relative.min() + _WIDE:
        some += f" to {relative.max():.2f}"
    yield (
        f"Locking one actuator leaves {some} of the manipulability; no robot with "
        f"{counted(len(names), 'actuator')} and {counted(len(survey.subject.major), 'major row')} "
        f"keeps more than {best:.2f} whichever locks."
    )


def _gain(survey: Survey) -> Iterator[str]:
    start, names = survey.start, survey.subject.actuators
    survived = [row for row in start.singles.ravel() if start.survived[row]]
    if survived:
        row = survived[least(-start.largest_gain[survived])]
        if (grows := start.largest_gain[row] / start.largest_gain[0]) > 1 + _WIDE:
            yield (
                f"The largest gain from the task to the actuators grows by a factor of up to "
                f"{grows:.3g} ({in_words(start.codes[row], names)})."
            )


def _secondary(survey: Survey) -> Iterator[str]:
    """Single failures by what they cost of the secondary task."""
    start, subject = survey.start, survey.subject
    if not subject.secondary:
        return
    for kind, word in KINDS.items():
        groups = dict[str, list[str]]()
        for name, row in zip(subject.actuators, start.singles[:, kind - LOCKED], strict=True):
            if start.survived[row]:
                lost = Condition(survey, int(row)).lost_in_words or "nothing"
                groups.setdefault(lost, []).append(name)
        nothing = groups.pop("nothing", [])
        for lost, names in list(groups.items())[:_FEW]:
            yield f"With {listed(names, 'or')} {word} the secondary task loses {lost}."
        if len(groups) > _FEW:
            yield f"Other secondary directions go with other actuators {word}: see the table."
        if nothing and not groups:
            yield f"No {word} actuator that may fail alone costs a secondary direction."


def _costliest(survey: Survey, cost: Cost) -> str:
    names = survey.subject.actuators
    if len(cost.equal) == len(names):
        return f"All actuators are alike: {why(survey, cost)}."
    others = [names[k] for k in cost.equal if k != cost.actuator]
    also = f" (and as much: {listed(others)})" if others else ""
    return f"The failure of {names[cost.actuator]} costs most{also}: {why(survey, cost)}."


def why(survey: Survey, cost: Cost) -> str:
    """What the failures of the costliest actuator leave."""
    what = "effect" if survey.subject.robot is None else "speed"
    parts = [
        f"{word}, it leaves {left:.0%} of the {what}"
        if left > 0.0
        else f"{word}, it loses the task"
        for word, left in zip(KINDS.values(), cost.left[cost.actuator], strict=True)
    ]
    if survey.workspace is not None:
        parts.append("in the mean over the postures")
    if (survey.start.failures == 2).any():
        share = cost.doubles[cost.actuator]
        parts.append(f"and {share:.0%} of the double failures with it are survived")
    return ", ".join(parts)


def _workspace(survey: Survey) -> Iterator[str]:
    workspace, names = survey.workspace, survey.subject.actuators
    if workspace is None:
        return
    every = survived_everywhere(survey)
    able = every[every[:, 0]]
    unusable = f"; {workspace.unusable} more could not be closed within the joint ranges"
    yield (
        f"Over the workspace: without failures the task is possible at {len(able)} of "
        f"{len(every)} postures{unusable if workspace.unusable else ''}."
    )
    if not len(able):
        return
    share = able.mean(axis=0)
    for kind, word in KINDS.items():
        rows = survey.start.singles[:, kind - LOCKED]
        partly = [k for k, row in enumerate(rows) if 0.0 < share[row] < 1.0]
        if partly:
            worst = partly[least(share[rows[partly]])]
            yield (
                f"{len(partly)} of {len(names)} actuators may be {word} at some of these postures "
                f"only, {names[worst]} at {share[rows[worst]]:.0%} of them."
            )
        elif (share[rows] == survived_singles(survey, kind)).all():
            yield f"What is said of {word} actuators holds at every posture."
