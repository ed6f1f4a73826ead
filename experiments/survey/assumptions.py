"""What the numbers of a survey rest on, in sentences: limits, what was left out, warnings."""

from experiments.survey.survey import Subject, Survey


def assumptions(survey: Survey) -> list[str]:
    """Limits and their source, what was left out, and what the numbers leave out."""
    subject = survey.subject
    return _assumed(subject) + list(survey.left_out) + _warnings(subject)


def _assumed(subject: Subject) -> list[str]:
    """Where limits come from, and what failures of a matrix mean."""
    what = "inputs" if subject.robot is None else "rates"
    said = [f"Limits of the {what}: {subject.rates.source}."]
    if subject.torques is not None:
        said.append(f"Limits of the forces: {subject.torques.source}.")
    if subject.robot is None:
        rest = "zero" if subject.hold is None else "what holds the effects at rest"
        said.append(
            f"A locked input is stuck at its value at rest ({rest}); a free one is zero. Every "
            "effect is the change from rest."
        )
    return said


def _warnings(subject: Subject) -> list[str]:
    return [f"{each[0].upper()}{each[1:].removesuffix('.')}." for each in subject.warnings]
