"""Functions for surveys of robots and matrices without the command."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fjh.rig.condition_analysis import ConditionAnalysis
from fjh.rig.options import RobotOptions, rows_of
from fjh.survey.conditions import Survey, condition_frame, survey_system
from fjh.survey.system import matrix_system, robot_system


@cache
def of_robot(
    file: Path,
    postures: int = 0,
    seed: int = 0,
    *,
    lower: str | None = None,
    upper: str | None = None,
    site: str = "payload",
    axes: str | None = "base",
    major: str = "0,1",
) -> Survey:
    options = RobotOptions(site=site, axes=axes, major=rows_of("major", major))
    system = robot_system(file, options, lower, upper)
    return survey_system(system, postures, seed, lambda done, total: None)


def of_matrix(file: Path, **options: str | None) -> Survey:
    arguments = dict.fromkeys(("lower", "upper", "major", "hold")) | options
    return survey_system(matrix_system(file, **arguments), 0, 0, lambda done, total: None)


def conditions(survey: Survey) -> pd.DataFrame:
    return condition_frame(survey).set_index("failed")


def speeds(analysis: ConditionAnalysis) -> np.ndarray:
    """Return the worst speeds, asserting that they were computed."""
    assert analysis.classes.worst_speed is not None
    return analysis.classes.worst_speed


def matrix_file(file: Path, B: Any) -> Path:
    np.savetxt(file, B, delimiter=",")
    return file
