"""The configurations of the bench that Table I can be run in, and what was fitted in each."""

from dataclasses import dataclass

from experiments.hexapod.choices import ConfigurationName
from experiments.hexapod.testbed import Bench

FITTED, EQUAL, PREDICTED = "fitted", "= W_a", "predicted"
"""Where the errors of a column come from: constants were fitted to them; they are those of W_a by
construction, since the mapping meets J_m M = I whatever its weights and the known lock; or nothing
was fitted to them."""


@dataclass(frozen=True)
class Configuration:
    """Constants around the plant, and how much of Table I they were fitted to.

    Attributes:
        name: As on the command line.
        bench: The constants.
        last_column: Where the errors of W_a_uncorrected come from.
        fit: What was fitted to how many cells, in one sentence.
    """

    name: ConfigurationName
    bench: Bench
    last_column: str
    fit: str

    def origin(self, column: str) -> str:
        """Where the errors of a column come from."""
        return {"W_a": FITTED, "W_a_uncorrected": self.last_column}.get(column, EQUAL)


_LEVELS = (
    "Fitted to the ten entries of W_a to W_e: spiral radius and period, two crossovers, detector "
    "noise. The five numbers act as two, the levels of alpha and beta"
)

CONFIGURATIONS: dict[ConfigurationName, Configuration] = {
    "calibrated": Configuration(
        "calibrated",
        Bench(),
        PREDICTED,
        f"{_LEVELS}; nothing was fitted to the two entries of the last column.",
    ),
    # Of the settings that docs/uncorrected.md maps, the one that fits the fewest numbers.
    "demand-limit": Configuration(
        "demand-limit",
        Bench(spiral_direction=-1, demand_limit_urad=95.0),
        FITTED,
        f"{_LEVELS}. Fitted to the two entries of the last column: the demand limit, one number, "
        "and the direction of the spiral, one of two.",
    ),
}
