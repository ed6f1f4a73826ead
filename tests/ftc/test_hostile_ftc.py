"""No hostile argument of `ftc` ends in anything but one sentence or finite numbers."""

import pytest

import ftc
from tests.ftc import hostile_fdi, hostile_loop, hostile_models
from tests.hostile import complaints, unattacked

TARGETS = hostile_models.TARGETS | hostile_loop.TARGETS | hostile_fdi.TARGETS

RESULTS = (
    "LoopRun",
    "NestedState",
    "Sensors",
    "Sensors.after",
    "Sensors.sentence",
    "SupervisorState",
)
"""Only loops and controllers make them."""

PARTS = (
    *("Stage", "steps", "one_tick", "mapping_for", "Tracking"),
    *("explanation", "deciding_sentence", "is_possible"),
    *("SensorCheck.start", "SensorCheck.step"),
)
"""`fjh`, or `tracking`, puts a rig together of these, and gives them what it has checked."""

AT_EVERY_TICK = (
    *(f"LocalGeometry.{name}" for name in ("jacobians", "twist", "moved")),
    *(f"MechanismGeometry.{name}" for name in ("jacobians", "twist", "moved")),
    *(
        f"PrioritizedMapping.{name}"
        for name in (
            *("displacements", "tick", "followed", "major_motion", "reached"),
            *("split", "estimate", "at"),
        )
    ),
    "DirectDrive.inputs",
    "DirectDrive.displacements",
)
"""Controllers call these, and give them what they have checked."""


@pytest.mark.long
@pytest.mark.parametrize("target", TARGETS)
def test_a_hostile_argument_ends_in_one_sentence_or_in_finite_numbers(target):
    calls, wrong = complaints(TARGETS[target])
    assert calls > 30
    assert not wrong, "\n".join(wrong)


def test_nothing_public_is_left_out():
    assert unattacked(ftc, TARGETS, (*RESULTS, *PARTS, *AT_EVERY_TICK)) == []
