"""No hostile argument of `sim` ends in anything but one sentence or finite numbers."""

import pytest

import sim
from tests.hostile import complaints, unattacked
from tests.sim import hostile_hexapod, hostile_mechanisms, hostile_plants, hostile_tasks

TARGETS = (
    hostile_hexapod.TARGETS
    | hostile_mechanisms.TARGETS
    | hostile_plants.TARGETS
    | hostile_tasks.TARGETS
)
TRUSTED = {
    # What the package alone makes, of numbers that are checked.
    *("Drive", "Friction", "Jacobians", "JointPosture", "LinearPlant", "Names"),
    *("Part", "Structure"),
    *("LocatedRates", "LocatedRates.jacobian", "LocatedRates.error", "Near", "Ranges", "Reading"),
    *("JacobianViews"),
    # Attacked as each of its kinds.
    *("TaskFunction", "TaskFunction.checked", "TaskFunction.on"),
    # Of numbers that are checked, at every tick.
    *("Plant.hold", "Plant.observed", "Distances.fits"),
    *("Distances.farthest", "Distances.largest_fraction", "Plant.check_lock"),
}


@pytest.mark.parametrize("target", TARGETS)
def test_a_hostile_argument_ends_in_one_sentence_or_in_finite_numbers(
    target, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log of states that diverge
    calls, wrong = complaints(TARGETS[target])
    assert calls > 25
    assert not wrong, "\n".join(wrong)


def test_every_parameter_is_attacked():
    assert unattacked(sim, TARGETS, TRUSTED) == []
