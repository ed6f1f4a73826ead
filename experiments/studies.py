"""The registry: all studies, in reading order.

Who needs a list of them reads this one. What takes long comes late; the timings come last, when
nothing else runs. The import takes milliseconds: a study names its functions, and imports none of
what they need.
"""

from experiments.benchmark import STUDY as BENCH
from experiments.figures import STUDY as FIGURES
from experiments.force import STUDY as FORCE
from experiments.goals import STUDY as GOALS
from experiments.jacobian import STUDY as JACOBIAN
from experiments.limits import STUDY as LIMITS
from experiments.recover import STUDY as RECOVER
from experiments.release import STUDY as RELEASE
from experiments.survey import STUDY as SURVEY
from experiments.sweep import ATLAS
from experiments.sweep import STUDY as SWEEP
from experiments.systems import STUDY as SYSTEMS
from experiments.table1 import STUDY as TABLE1
from experiments.track import STUDY as TRACK
from experiments.uncorrected import STUDY as UNCORRECTED

STUDIES = (
    TABLE1,
    TRACK,
    SURVEY,
    FIGURES,
    SYSTEMS,
    RELEASE,
    FORCE,
    GOALS,
    LIMITS,
    JACOBIAN,
    UNCORRECTED,
    RECOVER,
    SWEEP,
    ATLAS,
    BENCH,
)
