"""Before anything is timed, all answers to the same question are compared with each other."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from experiments.output.study import Unsound
from sim import Array


@dataclass(frozen=True)
class Agreement:
    """Answers of several contenders to the same questions.

    Attributes:
        question: For people.
        tolerance: Largest distance from the others, as a fraction of the answer.
        distances: By contender: the largest over the questions.
    """

    question: str
    tolerance: float
    distances: dict[str, float]

    def check(self) -> None:
        """Nothing is worth timing unless all agree.

        Raises:
            Unsound: One is further from the others than the tolerance; the message names it.
        """
        # NaN is no agreement either.
        apart = {name: d for name, d in self.distances.items() if not d <= self.tolerance}
        if apart:
            who = ", ".join(f"{name} by {distance:.1e}" for name, distance in apart.items())
            raise Unsound(
                f"the answers differ, so nothing was timed: {self.question}: {who} of the answer, "
                f"more than {self.tolerance:.0e}"
            )


def compare(question: str, answers: Mapping[str, Array], tolerance: float) -> Agreement:
    """How far each contender's answers (N, n) are from the middle one of all, entry by entry.

    With three contenders or more, one that is wrong does not move the middle.
    """
    middle = np.median(list(answers.values()), axis=0)
    size = np.abs(middle).max(axis=-1)
    distances = {
        name: float((np.abs(each - middle).max(axis=-1) / size).max())
        for name, each in answers.items()
    }
    return Agreement(question, tolerance, distances)
