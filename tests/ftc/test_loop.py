"""Loops of a controller with a machine, and with a linear plant for several settings."""

from types import SimpleNamespace
from typing import Any

import control
import numpy as np
import pytest

from fjh.rig import Rig
from ftc import Stage, one_tick, run_loop, steps
from ftc.fdi import fault_model
from tests.ftc.carts import carts_with_friction
from tests.ftc.small_stage import Still, stage


@pytest.mark.parametrize("kind", ["controller", "supervisor"])
def test_a_loop_equals_its_single_ticks(kind):
    """The reference is a loop written out here, equal to the bit."""
    rig = Rig.hexapod()
    controller: Any = getattr(rig, kind)()
    reference = rig.path("circle", duration_s=0.04)
    bench, state = rig.bench(np.zeros(len(reference)), (), 1), controller.start()
    measured, inputs = [], []
    for row in reference:
        read = bench.measure()
        state = controller.step(state, row, read)
        bench.apply(state.inputs)
        measured.append(read.output)
        inputs.append(state.inputs)
    looped = run_loop(rig.bench(np.zeros(len(reference)), (), 1), controller, reference)
    np.testing.assert_array_equal(looped.measured, measured)
    np.testing.assert_array_equal(looped.inputs, inputs)


class UserController:
    """Controller of a user without a feedforward argument."""

    def start(self) -> Any:
        return SimpleNamespace(inputs=np.zeros(2))

    def step(self, state, reference, measurement):
        return SimpleNamespace(inputs=reference)


class WithFeedforward(UserController):
    """Controller of a user with a feedforward argument."""

    def step(self, state, reference, measurement, *, feedforward=None):
        return super().step(state, reference if feedforward is None else feedforward, measurement)


def test_feedforward_reaches_the_controllers_that_take_it():
    path, ahead = np.ones((3, 2)), np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(run_loop(Still(), WithFeedforward(), path, ahead).inputs, ahead)
    np.testing.assert_array_equal(run_loop(Still(), WithFeedforward(), path).inputs, path)
    np.testing.assert_array_equal(run_loop(Still(), UserController(), path, ahead).inputs, path)
    state, seen = one_tick(
        Still(), WithFeedforward().step, WithFeedforward().start(), path[0], feedforward=ahead[1]
    )
    np.testing.assert_array_equal(state.inputs, ahead[1])
    np.testing.assert_array_equal(seen, Still().measure().output)
    with pytest.raises(ValueError, match="feedforward must have shape"):
        run_loop(Still(), WithFeedforward(), path, ahead[:2])


@pytest.mark.parametrize("has_friction", [False, True])
def test_a_batch_of_settings_is_each_setting_alone(has_friction):
    """The settings are demand limits, anti-windup and start; the other plant has dry friction."""
    rng, small = np.random.default_rng(0), stage()
    settings: dict[str, Any] = {}
    nominal, disturbance = carts_with_friction(0), None
    if has_friction:
        whole = Stage(fault_model(nominal))
        loops: Any = [control.ss([], [], [], [[0.2]], nominal.period_s)] * 3
        reference = 1e-3 * rng.normal(size=(3, 20, 3)).cumsum(axis=1)
    else:
        nominal, loops = small.nominal, [small.loop] * 2
        whole = Stage(fault_model(nominal), gain=small.mapping().major_gain())
        settings["limit"] = np.array([1e-2, 2e-2, np.inf])
        settings["anti_windup"] = np.array([True, False, True])
        settings["start"] = 1e-4 * rng.normal(size=(3, 6))
        disturbance = 1e-4 * rng.normal(size=(80, 6))
        reference = 3e-2 * rng.normal(size=(3, 80, 2)).cumsum(axis=1)
        reference[:, 40:] *= -1  # away from the limits

    def states(which: Any) -> np.ndarray:
        how = {name: value[which] for name, value in settings.items()}
        C, path = nominal.plant.C, reference[which]
        ticks = steps([whole], C, loops, path, disturbance=disturbance, **how)
        return np.stack([tick.x for tick in ticks], axis=-2)

    many = states(slice(None))
    for k in range(3):
        np.testing.assert_allclose(many[k], states(k), rtol=1e-12, atol=1e-15)
    if has_friction:
        u = 0.2 * (reference[1, 7] - nominal.plant.C @ many[1, 7])
        np.testing.assert_allclose(whole.model.step(many[1, 7], u), many[1, 8], atol=1e-12)
