"""What each failure changes of the steady outputs while the actuators are driven at one frequency.

The change is that of the outputs' phasor against the one measured while nothing had failed, so
that errors of the model count only as far as they change the difference. It is linear in the
commands as they are sent, which a residual is formed with: the reaction of a closed loop is part of
these. Constant parts, of loads that fall and of actuators locked off centre, are at frequency zero
and not seen here.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import argument_checks as check
from argument_checks import Array
from ftc.control.frequency_response import frequency_response
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import KINDS, Fault, NominalModel, fault_model
from ftc.fdi.uncertainty import CERTAIN, STEP, Uncertainty, perturbed

Complex = NDArray[np.complex128]

HALF = 0.5
"""Effectiveness of a weak actuator whose failure is to be found."""

_SERVO_PARTS = (0.25, 0.5, 0.75, 0.95, 1.0)
"""Parts lost of a servo's force with a response each, in between linear."""


@dataclass(frozen=True)
class FaultResponses:
    """Frequency responses of F frequencies by which each of n failing actuators differs.

    Outputs are in units of their noise ("whitened").

    Attributes:
        frequency_hz: Shape (F,).
        parts: Parts of its force that an actuator has lost, ascending to 1, shape (M,).
        change: Outputs per command, with the actuator locked, and with each of these parts lost,
            minus those of the plant without failures, shape (F, n, 1 + M, p, n).
        errors: Change of `change` by one standard deviation of each of E uncertain parameters,
            shape (F, n, 1 + M, E, p, n).
    """

    frequency_hz: Array
    parts: Array
    change: Complex
    errors: Complex


def single_faults(actuators: int) -> tuple[Fault, ...]:
    """Each actuator locked, free and half weak, in the order of :data:`KINDS`."""
    return tuple(
        Fault(k, kind, HALF * (kind == "weak")) for k in range(actuators) for kind in KINDS
    )


def steady_signatures(nominal: NominalModel, dither: Dither) -> tuple[tuple[Fault, ...], Complex]:
    """Failures, and what each changes of the steady outputs' phasor.

    Args:
        nominal: Without failures.
        dither: With n directions and a frequency below half the control frequency.

    Returns:
        The F = 3 n :func:`single_faults`, and changes in units of the outputs' noise, shape (F, p),
        relative to the dither's own phase.

    Raises:
        ValueError, TypeError: An argument of the wrong shape or size, or an undamped mode at the
            frequency.
    """
    commanded, at = driven(nominal, dither)
    faults = single_faults(nominal.actuators)
    sound = _response(nominal, (), at)
    changes = [(_response(nominal, (each,), at) - sound)[0] @ commanded for each in faults]
    return faults, np.array(changes, dtype=complex)


def fault_responses(
    nominal: NominalModel, frequency_hz: Array, uncertainty: Uncertainty = CERTAIN
) -> FaultResponses:
    """Responses to all failures of one actuator, and their errors to first order."""
    parts = np.array([1.0] if nominal.loses_only_commands else _SERVO_PARTS)
    change = _changes(nominal, parts, frequency_hz)
    errors = [
        (_changes(changed, parts, frequency_hz) - change) / STEP
        for changed in perturbed(nominal, uncertainty)
    ]
    if uncertainty.delay_s:
        turn = 2j * np.pi * frequency_hz * uncertainty.delay_s
        errors.append(-turn[:, None, None, None, None] * change)
    none = np.zeros((*change.shape[:3], 0, *change.shape[3:]), dtype=complex)
    stacked = np.stack(errors, axis=3) if errors else none
    return FaultResponses(frequency_hz, parts, change, stacked)


def driven(nominal: NominalModel, dither: Dither) -> tuple[Array, Array]:
    """Amplitudes (n,) of the commands, and the frequency, shape (1,); checked."""
    check.instance("nominal", nominal, NominalModel)
    check.instance("dither", dither, Dither)
    direction = check.exactly("dither.direction", dither.direction, nominal.actuators)
    hz = check.positive("dither.frequency_hz", dither.frequency_hz)
    commanded = check.exactly("dither", dither.amplitude * direction, nominal.actuators)
    return commanded, checked_frequencies(nominal, "dither.frequency_hz", [hz])


def checked_frequencies(nominal: NominalModel, name: str, value: ArrayLike) -> Array:
    """Frequencies (F,) between zero and half the control frequency."""
    hz = check.real(name, value)
    nyquist_hz = 0.5 / nominal.period_s
    if hz.ndim != 1 or not hz.size or not (hz > 1e-9 * nyquist_hz).all() or hz.max() >= nyquist_hz:
        raise ValueError(
            f"{name} must lie between zero and half the control frequency, {nyquist_hz:g} Hz, got "
            f"{check.shown(value)}"
        )
    return hz


class _Sampled(NamedTuple):
    A: Array
    B: Array
    C: Array
    D: Any
    dt: float


def sound_response(nominal: NominalModel, rows: Array, frequency_hz: Array) -> Complex:
    """What rows per state (m, s) do per command while nothing has failed, shape (F, m, n)."""
    model = fault_model(nominal)
    return _gain(_Sampled(model.A, model.B, rows, 0.0, nominal.period_s), frequency_hz)


def _response(nominal: NominalModel, faults: tuple[Fault, ...], frequency_hz: Array) -> Complex:
    """Whitened outputs per command, shape (F, p, n)."""
    model = fault_model(nominal, faults)
    sampled = _Sampled(model.A, model.B, model.C, 0.0, nominal.period_s)
    return _gain(sampled, frequency_hz)


def _gain(sampled: _Sampled, frequency_hz: Array) -> Complex:
    with np.errstate(all="ignore"):
        G = frequency_response(sampled, 2 * np.pi * frequency_hz).astype(complex, copy=False)
    if not np.isfinite(G).all():
        raise _undamped(frequency_hz)
    return G


def _undamped(frequency_hz: Array) -> ValueError:
    return ValueError(
        "frequency_hz must not be that of an undamped mode, failures included, got "
        f"{check.shown(frequency_hz.tolist())}"
    )


def _changes(nominal: NominalModel, parts: Array, frequency_hz: Array) -> Complex:
    """As of :class:`FaultResponses`, shape (F, n, 1 + M, p, n)."""
    faults = [
        (fault,)
        for k in range(nominal.actuators)
        for fault in (Fault(k, "locked"), *(Fault(k, "weak", 1 - part) for part in parts))
    ]
    sound, *others = (fault_model(nominal, each) for each in ((), *faults))
    z = np.exp(2j * np.pi * frequency_hz * nominal.period_s)[:, None, None, None]
    A, B = (np.array([getattr(each, name) for each in (sound, *others)]) for name in "AB")
    # Few frequencies of many models: solved at once, not each model brought to triangular form.
    try:
        G = sound.C @ np.linalg.solve(z * np.eye(len(A[0])) - A, B.astype(complex))
    except np.linalg.LinAlgError:
        raise _undamped(frequency_hz) from None
    changes = (G[:, 1:] - G[:, :1]).reshape(len(z), nominal.actuators, -1, *G.shape[2:])
    return changes.astype(complex, copy=False)
