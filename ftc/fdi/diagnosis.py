"""What a monitor remembers, and what it says."""

from dataclasses import dataclass

from ftc.fdi.fault_model import Fault
from ftc.fdi.hypotheses import BankState, Verdict
from sim import Array


@dataclass(frozen=True)
class Diagnosis:
    """One failure, as far as it is known.

    Attributes:
        fault: Strut and kind.
        strut_confidence: Probability of the strut.
        kind_confidence: Probability of the kind, given the strut.
        displacement_m: Where the strut stands by this diagnosis.
        onset_tick: Most likely time of the failure.
        alarm_tick: When the chart raised the alarm.
        tick: When this was found.
        settled: Whether the time in which it could be revised is over.
    """

    fault: Fault
    strut_confidence: float
    kind_confidence: float
    displacement_m: float
    onset_tick: int
    alarm_tick: int
    tick: int
    settled: bool


@dataclass(frozen=True)
class Moment:
    """One tick of history.

    Attributes:
        tick: Counted from the first.
        x: State of the believed machine, shape (s,).
        sent_m: Strut displacements commanded since the tick before, shape (6,).
        y: Whitened outputs, shape (p,).
    """

    tick: int
    x: Array
    sent_m: Array
    y: Array


@dataclass(frozen=True)
class MonitorState:
    """What a monitor remembers.

    Attributes:
        history: The latest moments, the newest last.
        recent: Latest residuals, for the chart: of the believed machine, and once a strut is named
            of that diagnosis.
        evidence: Of the bank, from an alarm on.
        alarm_ticks: Of all alarms so far, the last of them the one that is looked into.
        verdict: What the evidence says now.
        named_tick: When a strut was first named.
        diagnosis: Of the present failure, from then on.
        unexplained: Whether an alarm was given up once: no single failure after another explained
            the outputs. The watch goes on with what was settled before.
    """

    history: tuple[Moment, ...]
    recent: Array
    evidence: BankState | None = None
    alarm_ticks: tuple[int, ...] = ()
    verdict: Verdict | None = None
    named_tick: int = 0
    diagnosis: Diagnosis | None = None
    unexplained: bool = False
