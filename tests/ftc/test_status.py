"""The supervisor says in one sentence what it believes, does not understand, and does."""

from dataclasses import replace

import pytest

from fjh.rig import Rig
from ftc import Goal
from ftc.fdi import Cause, Diagnosis, Fault

PILOT = Rig.hexapod().supervisor()
NUMBERED = replace(PILOT.monitor, nominal=replace(PILOT.monitor.nominal, names=None))
START = replace(PILOT.start(), monitor=NUMBERED)
LOCKED = Diagnosis.told(Fault(2, "locked"), 1e-6)
CONFIRMED = replace(START, confirmed=(LOCKED,))
NAMED = replace(
    START,
    watch=replace(
        START.watch, diagnosis=replace(LOCKED, confirmed=False, kinds=("locked", "free"))
    ),
)
AGAIN = replace(Diagnosis.told(Fault(2, "weak", 1.0)), confirmed=False)


@pytest.mark.parametrize(
    ("state", "said"),
    [
        (START, "All actuators are believed sound."),
        (CONFIRMED, "Actuator 2 is locked; the other actuators do the task."),
        (
            NAMED,
            "Actuator 2 is locked or free, not yet confirmed; the other actuators do the task.",
        ),
        (
            replace(CONFIRMED, watch=replace(START.watch, diagnosis=AGAIN)),
            "Actuator 2 is locked; actuator 2 seems to work again; the other actuators do the "
            "task.",
        ),
        (
            replace(CONFIRMED, refused=LOCKED),
            "Actuator 2 is locked; the controller goes on as it was, which is expected to cost "
            "less.",
        ),
        (  # when it was first named the others took over, and the confirmation changed nothing
            replace(
                CONFIRMED,
                refused=LOCKED,
                current=Rig.hexapod().controller(Goal(locked_at={2: 0.0})),
            ),
            "Actuator 2 is locked; the other actuators do the task.",
        ),
        (
            replace(CONFIRMED, task_lost=True),
            "Actuator 2 is locked; the major task is lost, and the controller goes on with what it "
            "still reaches.",
        ),
        *(
            (
                replace(START, watch=replace(START.watch, causes=(None, cause))),
                f"All actuators are believed sound; the last alarm is explained by {why}, which is "
                "no failure.",
            )
            for cause, why in (
                (None, "something slow"),
                (Cause("offset", 3), "an offset of actuator 3"),
                (Cause("supply"), "a change of what all commands do"),
                (Cause("scale"), "a change of the sensors' scale"),
            )
        ),
        (
            replace(START, watch=replace(START.watch, relearns=3)),
            "All actuators are believed sound; what no failure explains is learned as part of the "
            "machine.",
        ),
    ],
)
def test_each_belief_and_act_has_its_sentence(state, said):
    assert state.status == said


def test_actuators_are_called_as_a_robot_calls_them():
    named = replace(CONFIRMED, monitor=PILOT.monitor)
    assert named.status == "strut3 is locked; the other actuators do the task."


def test_an_actuator_that_works_again_is_believed_sound():
    again = Diagnosis.told(Fault(2, "weak", 1.0))
    assert replace(START, confirmed=(LOCKED, again)).status == START.status
