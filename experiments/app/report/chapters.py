"""The chapters of the report, in reading order."""

from experiments.app.report.chapter import Chapter
from experiments.goals.command import goals
from experiments.jacobian.command import jacobian
from experiments.recover.command import recover
from experiments.systems.command import systems

CHAPTERS = (
    Chapter(systems),
    Chapter(goals),
    Chapter(jacobian, {"loop": True}),
    Chapter(recover),  # last: it takes as long as all others together
)
