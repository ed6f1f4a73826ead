"""State of a monitor: what it has seen, what it suspects, and what it has named."""

from dataclasses import dataclass

from argument_checks import Array
from ftc.fdi.detection.watch import Moment, WatchState
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.isolation.causes import Cause
from ftc.fdi.isolation.evidence import Evidence
from ftc.fdi.isolation.verdict import Verdict


@dataclass(frozen=True)
class MonitorState:
    """State of a monitor.

    Attributes:
        ticks: So far.
        commanded: Displacements of the ticks of the sample that is not complete, (n,) each.
        outputs: Likewise, in units of their noise, (p,) each; None where nothing was measured.
        last_commanded: Mean of the sample before, shape (n,).
        watch: State of the believed model.
        history: The latest samples, the newest last.
        recent: Latest residuals, for their test.
        evidence: Of the hypotheses, from an alarm on.
        alarm_ticks: Of all alarms so far, the last of them the one that is looked into.
        verdict: What the evidence says now.
        named_tick: When an actuator was first named.
        diagnosis: Of the present failure, from then on.
        unexplained: Whether an alarm was given up once: no single failure after another explained
            the outputs. The monitor goes on with what was confirmed before.
        begun_tick: When the present evidence began.
        cleared: Sample up to which nothing had failed, or nothing that was understood.
        causes: What explained the alarms that were dismissed, in order; None is something slow.
        relearns: For so many more samples what is seen is taken for the machine as it is.
    """

    ticks: int
    commanded: tuple[Array, ...]
    outputs: tuple[Array | None, ...]
    last_commanded: Array
    watch: WatchState
    history: tuple[Moment, ...]
    recent: Array
    evidence: Evidence | None = None
    alarm_ticks: tuple[int, ...] = ()
    verdict: Verdict | None = None
    named_tick: int = 0
    diagnosis: Diagnosis | None = None
    unexplained: bool = False
    begun_tick: int = 0
    cleared: int = 0
    causes: tuple[Cause | None, ...] = ()
    relearns: int = 0
