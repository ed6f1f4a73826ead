"""Number of examples of each property, by the environment variable `PROPERTIES`.

`local` uses the same 20 in every run, `ci` (set by `CI`) 50 others in each run, `night` 1,000.
A failing example is printed with the line that repeats it, and saved in `.hypothesis`.
"""

import os

from hypothesis import HealthCheck, settings
from hypothesis.database import DirectoryBasedExampleDatabase

EXAMPLES = {"local": 20, "ci": 50, "night": 1000}
"""Number of examples of a property without its own number."""


def register() -> None:
    """Load the profile of the environment."""
    name = os.environ.get("PROPERTIES") or ("ci" if os.environ.get("CI") else "local")
    settings.register_profile(
        name,
        deadline=None,  # timings are noise on a busy machine
        derandomize=name == "local",
        max_examples=EXAMPLES[name],
        database=None if name == "local" else DirectoryBasedExampleDatabase(".hypothesis/examples"),
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile(name)


def scaled(usual: int) -> int:
    """Return the number of examples by the profile, where others have 100."""
    return max(1, usual * settings().max_examples // 100)


def examples(usual: int) -> settings:
    """Return the decorator of a property with its own number, where others have 100."""
    return settings(max_examples=scaled(usual))
