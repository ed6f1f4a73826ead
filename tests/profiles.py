"""On how many examples a property is tried: the environment variable `PROPERTIES` says it.

`local` tries the same 20 in every run; `ci`, in force where `CI` is set, 50 others in each, `night`
1,000. An example that fails is printed with the line that repeats it, and is kept in `.hypothesis`.
"""

import os

from hypothesis import HealthCheck, settings
from hypothesis.database import DirectoryBasedExampleDatabase

EXAMPLES = {"local": 20, "ci": 50, "night": 1000}
"""Examples of a property that states no number of its own."""


def register() -> None:
    """Put the profile of the environment in force."""
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
    """A number of examples where others have 100, in proportion to the profile in force."""
    return max(1, usual * settings().max_examples // 100)


def examples(usual: int) -> settings:
    """The decorator of a property that has a number of its own where others have 100."""
    return settings(max_examples=scaled(usual))
