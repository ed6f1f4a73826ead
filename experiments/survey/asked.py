"""What `fjh survey` is asked, refused before anything is imported or compiled."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from experiments.rig.options import RobotOptions
from experiments.rig.spelling import check_robot
from experiments.study.study import WrongInput

MOST_POSTURES = 4096


def check(
    *, model: Path | None, matrix: Path | None, hold: str | None, postures: int, **options: Any
) -> None:
    """Refuse a robot and a matrix at once, options of the one for the other, and wrong names.

    Raises:
        WrongInput: There is one.
    """
    if not 0 <= postures <= MOST_POSTURES:
        raise WrongInput(f"--postures must be from 0 to {MOST_POSTURES}, got {postures}")
    if matrix is None:
        if hold is not None:
            raise WrongInput("--hold is for a matrix: give one with --matrix")
        given = {name: value for name, value in options.items() if value is not None}
        check_robot(model=model, **given)
        return
    if model is not None:
        raise WrongInput(f"{model} and --matrix {matrix}: one of them is surveyed at a time")
    for option in fields(RobotOptions):
        value = options.get(option.name, option.default)
        if option.name != "major" and value != option.default:
            raise WrongInput(f"--{option.name} is for a robot: a matrix has none")
