"""On how many examples a property is tried, and on which: one profile of hypothesis is in force.

The environment variable `PROPERTIES` names it. Unless it is set, it is `ci` where `CI` is set (as
GitHub and `.ci/run` do) and `local` elsewhere.
"""

import os

from hypothesis import HealthCheck, settings
from hypothesis.database import DirectoryBasedExampleDatabase

EXAMPLES = {"local": 20, "ci": 100, "night": 1000}
"""Examples of a property that states no number of its own."""


def register() -> None:
    """Make the three profiles known to hypothesis and put one in force."""
    # Timings are noise on a busy machine, and a run must be one that can be repeated: both profiles
    # try the same examples in every run, `local` the first few of them.
    for name in ("local", "ci"):
        examples = EXAMPLES[name]
        settings.register_profile(name, deadline=None, derandomize=True, max_examples=examples)
    # Other examples every night; those that failed are kept and tried first in the next.
    settings.register_profile(
        "night",
        deadline=None,
        derandomize=False,
        max_examples=EXAMPLES["night"],
        database=DirectoryBasedExampleDatabase(".hypothesis/examples"),
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile(chosen())


def chosen() -> str:
    """The profile in force unless `--hypothesis-profile` names another."""
    return os.environ.get("PROPERTIES") or ("ci" if os.environ.get("CI") else "local")


def scaled(in_ci: int) -> int:
    """A number of examples, in proportion to those of the profile in force; at least one."""
    default = settings.default
    assert default is not None
    return max(1, in_ci * default.max_examples // EXAMPLES["ci"])


def examples(in_ci: int) -> settings:
    """The decorator of a property that has its own number of examples in CI."""
    return settings(max_examples=scaled(in_ci))
