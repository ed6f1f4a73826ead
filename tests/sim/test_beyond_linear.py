"""Effects outside the linear model are named where a file has them, and nowhere else."""

import mujoco
import pytest

from sim import Body
from sim.mjcf import located
from sim.mjcf.part import task_part
from sim.plant import Met, beyond_linear

PAIR = """
<mujoco>
  <option {option}/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 0.44"/>
    <body name="left" pos="0 0 0.5">
      <joint name="a" axis="0 1 0" {joint}/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0" mass="1"/>
    </body>
    <body name="right" pos="0 0.3 0.5">
      <joint name="b" axis="0 1 0"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0" mass="1"/>
    </body>
  </worldbody>
  <tendon><fixed name="cord" {tendon}><joint joint="a" coef="1"/></fixed></tendon>
  <equality><joint name="gear" joint1="a" joint2="b" {equality}/></equality>
  <actuator><motor name="m" joint="a" forcerange="-1 1" {actuator}/></actuator>
</mujoco>
"""
PLAIN = {"option": "", "joint": "", "tendon": "", "equality": "", "actuator": ""}


def pair(**parts: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Two arms that a gear couples."""
    model = mujoco.MjModel.from_xml_string(PAIR.format(**PLAIN | parts))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"joint": 'frictionloss="0.1"'}, "dry friction of a:"),
        ({"tendon": 'frictionloss="0.1"'}, "dry friction of cord:"),
        ({"joint": 'damping="1 0.5"'}, "damping of a is not linear"),
        ({"tendon": 'damping="1 0.5"'}, "damping of cord is not linear"),
        ({"joint": 'stiffness="1 0.5"'}, "stiffness of a is not linear"),
        ({"equality": 'solref="0.2 1"'}, '"gear" is soft'),
        ({"equality": 'solref="-100 -10"'}, '"gear" is soft'),
        ({"equality": 'solimp="0 0.95 0.01"'}, '"gear" is soft'),
        ({"option": 'density="1.2"'}, "drag of a medium of density 1.2"),
    ],
)
def test_each_effect_is_named_once(parts, words):
    """By the name of what has it."""
    (sentence,) = beyond_linear(*pair(**parts))
    assert words in sentence.replace("equality ", "")


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"joint": 'damping="1" stiffness="2"'},
        {"option": 'viscosity="0.1"'},
        {"equality": 'active="false" solref="0.2 1"'},
        {"equality": 'solref="0.03 1"'},
        {"equality": 'solref="-5000 -100"'},
    ],
)
def test_what_is_linear_is_not_named(parts):
    """Viscous drag and stiff equalities are in the linear model, or nearly."""
    assert beyond_linear(*pair(**parts)) == ()


def test_a_run_names_what_it_met():
    """The arm stands on the floor, beyond its limit, its motor at full force; nothing at first."""
    model, data = pair(joint='range="-1 1" limited="true"')
    data.eq_active[:] = 0
    met = Met(model)
    mujoco.mj_step(model, data)
    met.plant(0, model, data)
    assert not met.sentences
    data.ctrl[:], data.qpos[0] = 2.0, 1.1
    mujoco.mj_step(model, data)
    met.plant(1, model, data)
    met.plant(2, model, data)
    assert set(met.sentences) == {
        '"left" touched "world"',
        'joint "a" reached its limit',
        'the force of "a" reached its limit',
    }


def test_what_lies_beside_a_task_is_not_met():
    """A cup on the floor touches it in every flight, and that is no news of the arm."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
        <body name="cup" pos="0 0 .049"><freejoint/><geom size=".05"/></body>
        <body name="arm" pos=".5 0 .5"><joint name="j" axis="0 1 0"/><geom size=".05"/></body>
        </worldbody><actuator><position joint="j"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    part = task_part(model, [located(model, "site", Body("arm"))], ())
    everything, of_task = Met(model), Met(model, part)
    for met in (everything, of_task):
        met.plant(0, model, data)
    assert list(everything.sentences) == ['"cup" touched "world"']
    assert not of_task.sentences
