"""Registry of all studies, in reading order.

A study is imported when it is requested, so that the list of commands does not need MuJoCo.
"""

from importlib import import_module

from fjh.study.option import Study

ROBOT = {
    "track": "Track a path with any robot while its actuators fail.",
    "survey": "Report what a robot, or an effectiveness matrix, can still do after each failure.",
}
"""First lines of the help of the studies of a user's robot, by name."""

PAPER = {
    "table1": "Reproduce Table I and Figures 4 to 6 of the paper.",
    "figures": "Compute margins of the control loops, and pointing in each failure condition.",
    "systems": "Compare the classification of four other mechanisms with their simulation.",
    "release": "Simulate a strut without coil force, then without coil force and spring.",
    "force": "Simulate static forces commanded by the force mapping.",
    "goals": "Pursue four secondary goals, and measure whether pointing changes.",
    "limits": "Compare ways to keep actuators within their limits, in the loop.",
    "jacobian": "Compute how much the Jacobian varies over the stroke, eq. (40), with a proof.",
    "uncorrected": "Test explanations for the large error in the last column of Table I.",
    "recover": "Simulate unannounced actuator failures; measure detection, isolation and recovery.",
    "sweep": "Simulate many closed loops with varied weights, failures and constants.",
    "atlas": "Simulate the 138 failure conditions that differ by symmetry; compare them "
    "with theory.",
}
"""First lines of the help of the studies of the paper and its extensions, by name."""

LINES = ROBOT | PAPER

_MODULES = {"atlas": "experiments.sweep", "survey": "fjh.survey.survey", "track": "fjh.track"}


def command_of(name: str) -> list[str]:
    """Return the words of a study's command, without options."""
    return ["fjh", *(["paper"] if name not in ROBOT else []), name]


def study(name: str) -> Study:
    """Import and return the function of a study, which takes up to a second."""
    return getattr(import_module(_MODULES.get(name, f"{__package__}.{name}")), name)
