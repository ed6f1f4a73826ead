"""The chapters of the report, in reading order."""

from experiments.app.report.chapter import Chapter
from experiments.figures.command import figures
from experiments.force.command import force
from experiments.recover.command import recover
from experiments.table1.command import table1
from experiments.uncorrected.command import uncorrected

CHAPTERS = (
    Chapter(table1),
    Chapter(figures),
    Chapter(force),
    Chapter(uncorrected),
    Chapter(recover),  # last: it takes as long as all others together
)
