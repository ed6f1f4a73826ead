"""The chapters of the report, in reading order."""

from experiments.app.report.chapter import Chapter
from experiments.figures.command import figures
from experiments.force.command import force
from experiments.goals.command import goals
from experiments.jacobian.command import jacobian
from experiments.systems.command import systems
from experiments.table1.command import table1
from experiments.uncorrected.command import uncorrected

CHAPTERS = (
    Chapter(table1),
    Chapter(figures),
    Chapter(systems),
    Chapter(force),
    Chapter(goals),
    Chapter(jacobian, {"loop": True}),
    Chapter(uncorrected),
)
