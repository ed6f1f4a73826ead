"""Effects of model errors on the outputs, against plants with these errors."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from ftc.fdi import CERTAIN, KINDS, Fault, NominalModel, fault_model
from ftc.fdi.uncertainty import perturbed, uncertain_model
from tests.ftc.carts import Struts, outputs

SMALL = 1e-5
FAULTS = [None, Fault(1, "locked"), Fault(1, "free"), Fault(1, "weak", 0.4)]
failures = pytest.mark.parametrize("fault", FAULTS, ids=["healthy", *KINDS])
machines = pytest.mark.parametrize(("seed", "servo"), [(0, False), (1, True), (2, True)])


def struts(seed: int, servo: bool) -> Struts:
    """Return struts of a few hertz, with servos stiffer than the structure."""
    rng = np.random.default_rng(seed)
    half, command_gain = rng.normal(size=(3, 3)), rng.uniform(200, 1000, 3)
    return Struts(
        mass=np.eye(3) + 0.2 * half @ half.T,
        along=np.eye(3) + 0.3 * rng.normal(size=(3, 3)),
        structure=np.zeros((3, 3)),
        command_gain=command_gain,
        kp=command_gain * servo,
        kv=0.02 * command_gain * servo,
        spring=0.3 * command_gain if servo else command_gain,
        damper=0.03 * command_gain,
        load=rng.uniform(0.5, 2, 3) * servo,
    )


def measured_model(body: Struts) -> NominalModel:
    """Return the model of a body; its last sensor measures the sum of the positions."""
    C = np.eye(3, 6)
    C[-1, :3] = 1.0
    return body.nominal().measured(C, np.full(3, 1e-3))


def with_error(body: Struts, error: str, size: float, actuator: int) -> Struts:
    """Return the machine with one error."""
    more = 1 + size * (np.arange(3) == actuator)
    if error == "inertia":
        return replace(body, mass=body.mass * (1 + size))
    own = {"gain": ("gain",), "damping": ("damper", "kv"), "stiffness": ("spring",)}
    names = ("kp",) if error == "stiffness" and body.kp.any() else own[error]
    return replace(body, **{name: getattr(body, name) * more for name in names})


SENT = np.cumsum(0.1 * np.random.default_rng(7).standard_normal((100, 3)), axis=0)
"""Commands of the samples, a random walk."""


def predicted(nominal: NominalModel, uncertainty, fault: Fault | None, of: int) -> np.ndarray:
    """Return outputs (N, 1 + J, p) of samples of `of` ticks, and their change by each error."""
    model = uncertain_model(
        partial(fault_model, nominal),
        [fault] if fault else [],
        others=[partial(fault_model, each) for each in perturbed(nominal, uncertainty)],
        delay_ticks=uncertainty.delay_s / nominal.period_s,
        ticks=of,
    )
    X, before, result = np.zeros((len(model.M), len(model.A))), np.zeros(3), []
    for u in SENT:
        Y, X = model.step(X, np.concatenate([u, before, [1.0]]))
        result.append(Y)
        before = u
    return np.array(result)


@machines
@failures
@pytest.mark.parametrize("error", ["gain", "stiffness", "damping", "inertia"])
def test_the_effect_of_an_error_is_the_difference_to_a_plant_with_it(seed, servo, fault, error):
    """Errors are in mass, spring, damper or force; a lost servo loses its stiffness and damping."""
    body = struts(seed, servo)
    result = predicted(measured_model(body), replace(CERTAIN, **{error: 0.01}), fault, 4)
    others = [with_error(body, error, SMALL, k) for k in range(1 if error == "inertia" else 3)]
    assert result.shape[1] == 1 + len(others)
    for j, other in enumerate(others, 1):
        difference = outputs(measured_model(other), 4, SENT, fault) - result[:, 0]
        close = 1e-3 * np.abs(result[:, j]).max() + 1e-8 * np.abs(result[:, 0]).max()
        np.testing.assert_allclose(result[:, j], difference * 0.01 / SMALL, atol=close)


@machines
@pytest.mark.parametrize(
    ("fault", "of", "close"), [*((f, 1, 1e-9) for f in FAULTS), (None, 4, 0.1)]
)
def test_a_delay_acts_as_commands_one_tick_later(seed, servo, fault, of, close):
    """The previous command applies for a quarter of a sample of four ticks."""
    nominal, sent = measured_model(struts(seed, servo)), np.repeat(SENT, of, axis=0)
    late = np.vstack([np.zeros(3), sent[:-1]])
    result = predicted(nominal, replace(CERTAIN, delay_s=2e-3), fault, of)[:, 1]
    ticks = outputs(nominal, 1, late, fault) - outputs(nominal, 1, sent, fault)
    expected = ticks.reshape(-1, of, 3).mean(axis=1)
    np.testing.assert_allclose(result, expected, atol=close * np.abs(expected).max())
