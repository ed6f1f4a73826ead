"""Which hypotheses there are: what may have failed next, and what may be seen that is no failure.

Every hypothesis is a linear model of its own that runs beside the plant, driven by the same
commands, and every one may be wrong in the same unknown parameters. Given the parameters its
residuals, whitened by the spectrum measured before the alarm, are white noise, so that its
likelihood with all parameters integrated out is Gaussian: multiple-model estimation (Magill, IEEE
Trans. Automatic Control 10, 1965) with nuisance parameters, over the time of onset (Willsky and
Jones, IEEE Trans. Automatic Control 21, 1976). Offsets of the sensors, which drift, are parameters
as the others: the decision is decoupled from them. Beside failures there are null models, of what
is as sudden and asks for no other mapping: an actuator that works from another zero, the supply
that all share, the scale that all sensors share.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from argument_checks import Array
from ftc.fdi.fault_model import Fault, FaultKind, NominalModel, fault_model, of_actuators
from ftc.fdi.friction import together
from ftc.fdi.isolation.bank import HypothesisBank
from ftc.fdi.isolation.causes import causes_of, own_drives, seen
from ftc.fdi.isolation.evidence import EXTRA, LOST
from ftc.fdi.uncertainty import (
    CERTAIN,
    FaultModels,
    UncertainModel,
    Uncertainty,
    perturbed,
    uncertain_model,
)

_OTHERWISE: dict[FaultKind, tuple[FaultKind, ...]] = {
    "locked": ("free",),
    "free": ("locked",),
    "loose": ("locked",),
}
"""What a failed actuator may be instead, besides sound again; a weak one counts as working."""


def hypothesis_bank(
    nominal: NominalModel,
    faults: Sequence[Fault] = (),
    uncertainty: Uncertainty = CERTAIN,
    ticks: int = 1,
) -> HypothesisBank:
    """Of a mechanism with these known faults, one more.

    Args:
        nominal: The plant without any.
        faults: Those known; weak actuators may get weaker, lock or lose all.
        uncertainty: Of the model.
        ticks: Of a sample.

    Raises:
        ValueError, TypeError: No actuator is left that could fail, or not faults of these.
    """
    k = nominal.plant.nstates // 2
    push, rows = nominal.plant.B[k:], nominal.displacement[:, :k]
    ways = push / np.einsum("nk,kn->n", rows, push)
    seen = np.linalg.norm(nominal.plant.C[:, :k] @ ways / nominal.noise[:, None], axis=0)
    ways = ways / np.maximum(seen, 1e-12 * np.linalg.norm(ways, axis=0))
    return bank_of(
        partial(fault_model, nominal),
        nominal.actuators,
        faults,
        lock_displacement=np.vstack([ways, np.zeros_like(ways)]).T,
        beside=uncertainty,
        sample_s=ticks * nominal.period_s,
        **_options(nominal, uncertainty, ticks),
    )


def believed_model(
    nominal: NominalModel,
    faults: Sequence[Fault] = (),
    uncertainty: Uncertainty = CERTAIN,
    ticks: int = 1,
) -> UncertainModel:
    """The first model of :func:`hypothesis_bank`, without the others, which take most of the time.

    Arguments and errors as there.
    """
    _left(faults, nominal.actuators)
    plant = partial(fault_model, nominal)
    return uncertain_model(plant, faults, **_options(nominal, uncertainty, ticks))


def _options(nominal: NominalModel, uncertainty: Uncertainty, ticks: int) -> dict[str, Any]:
    return {
        "others": [partial(fault_model, each) for each in perturbed(nominal, uncertainty)],
        "delay_ticks": uncertainty.delay_s / nominal.period_s,
        "friction": uncertainty.friction,
        "ticks": ticks,
    }


def _left(faults: Sequence[Fault], n: int) -> Array:
    """Effectiveness (n,) that actuators with these faults have left."""
    left = np.ones(n)
    for fault in of_actuators(faults, n):
        left[fault.actuator] = fault.effectiveness if fault.kind == "weak" else 0.0
    if not left.any():
        raise ValueError("faults must leave a working actuator, got failures of all of them")
    return left


def bank_of(
    plant: FaultModels,
    n: int,
    faults: Sequence[Fault] = (),
    *,
    lock_displacement: Array | None = None,
    beside: Uncertainty = CERTAIN,
    sample_s: float = 1.0,
    **options: Any,
) -> HypothesisBank:
    """Hypotheses of one more failure of a plant of any kind.

    Args:
        plant: The plant with any faults.
        n: Number of actuators.
        faults: Those known.
        lock_displacement: By how much the state of a plant differs with each actuator locked
            further out, by what an output sees as one standard deviation, shape (n, s).
        beside: What may happen beside failures: its `command`, `supply` and `scale`.
        sample_s: Time of a sample.
        options: Of :func:`ftc.fdi.uncertainty.uncertain_model`.

    Raises:
        ValueError, TypeError: No actuator is left that could fail, or not faults of these.
    """
    left = _left(faults, n)
    one_more = _one_more(faults, left)
    known = [
        [*(each for each in faults if each.actuator != fault.actuator), fault] for fault in one_more
    ]
    models = [uncertain_model(plant, each, **options) for each in ([*faults], *known)]
    believed, causes = models[0], causes_of(left, beside)
    models += [believed] * (len(causes) + 1)
    A, M, C, N, onset = (
        np.array([getattr(model, name) for model in models])
        for name in ("A", "M", "C", "N", "onset")
    )
    inputs = beside.command / np.maximum(seen(believed, n), 1e-12)
    drives = np.zeros((len(models), EXTRA - 1, sum(C.shape[1:]), M.shape[-1]))
    placed, scaled = np.zeros((len(models), A.shape[-1])), np.zeros(len(models))
    for h, fault in enumerate(one_more, 1):
        if fault.kind == "locked" and lock_displacement is not None:
            placed[h] = lock_displacement[fault.actuator]
    for h, cause in enumerate(causes, 1 + len(one_more)):
        drives[h, 1:] = own_drives(believed, cause, inputs, beside, sample_s)
        scaled[h] = beside.scale if cause.kind == "scale" else 0.0
    s = A.shape[-1]
    rubbed = [model.friction for model in models if model.friction is not None]
    return HypothesisBank(
        faults=tuple(one_more),
        causes=tuple(causes),
        effectiveness=left,
        believed=believed,
        A=A,
        M=np.concatenate([M, drives[:, :, :s]], axis=1),
        C=C,
        N=np.concatenate([N, drives[:, :, s:]], axis=1),
        onset=onset,
        placed=placed,
        scaled=scaled,
        friction=together(rubbed) if rubbed else None,
    )


def _one_more(faults: Sequence[Fault], left: Array) -> list[Fault]:
    """What may fail next, in groups of one actuator; then what is known, otherwise."""
    one_more = [
        each
        for k in np.flatnonzero(left).tolist()
        for each in (
            Fault(k, "locked"),
            *(Fault(k, "weak", float(left[k] * (1 - part))) for part in LOST[:-1]),
            Fault(k, "free"),
        )
    ]
    return one_more + [
        other
        for fault in faults
        for other in (
            Fault(fault.actuator, "weak", 1.0),
            *(Fault(fault.actuator, kind) for kind in _OTHERWISE.get(fault.kind, ())),
        )
    ]
