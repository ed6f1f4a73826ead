"""Every displacement has its unit: from the model's joints to the names of published numbers."""

import mujoco
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.rig import Rig
from experiments.rig.units import by_unit, largest_by_unit, sizes_said
from sim.mjcf.transmission import drives

_ROWS = st.lists(st.tuples(st.sampled_from(["rad", "m"]), st.floats(-1, 1)), min_size=1)


@given(rows=_ROWS)
def test_each_value_is_in_the_entry_of_its_unit_in_order(rows):
    units = [unit for unit, _ in rows]
    entries = by_unit("rms", [value for _, value in rows], units)
    left = {key: iter(own) for key, own in entries.items()}
    assert [next(left[f"rms_{unit}"]) for unit in units] == [value for _, value in rows]
    assert all(list(own) == [] for own in left.values())
    assert by_unit("rms", None, units) == dict.fromkeys(entries)


def test_sentences_name_the_units_that_there_are():
    sizes = by_unit("path_size", 1e-3, ["rad", "m"]) | by_unit("sensor_noise", 1e-6, ["rad", "m"])
    said = sizes_said(sizes | by_unit("encoder_noise", 2e-6, ["rad", "rad"]))
    assert said == (
        "Path of 0.001 rad and 0.001 m, sensors with noise of 1e-06 rad and 1e-06 m, encoders of "
        "2e-06 rad (standard deviation of a sample)."
    )
    assert largest_by_unit([1.0, 3.0, 2.0], ["m", "rad", "rad"]) == "1 m, 3 rad"


TRANSMISSIONS = """
<mujoco>
  <worldbody>
    <site name="ground"/>
    <body><joint name="turn"/><geom size="0.1"/>
      <body><joint name="other" axis="1 0 0"/><geom size="0.1"/>
        <body><joint name="shift" type="slide"/><geom size="0.1"/><site name="tip"/></body>
      </body></body>
  </worldbody>
  <tendon>
    <fixed name="sum"><joint joint="turn" coef="1"/><joint joint="other" coef="2"/></fixed>
    <fixed name="mixed"><joint joint="turn" coef="1"/><joint joint="shift" coef="2"/></fixed>
    <spatial name="cable"><site site="ground"/><site site="tip"/></spatial>
  </tendon>
  <actuator>
    <motor joint="turn"/><motor joint="shift"/>
    <motor tendon="sum"/><motor tendon="mixed"/><motor tendon="cable"/>
  </actuator>
</mujoco>
"""


def test_an_actuator_that_turns_a_joint_moves_by_an_angle_all_others_by_a_length():
    known = drives(mujoco.MjModel.from_xml_string(TRANSMISSIONS))
    assert [drive.unit for drive in known] == ["rad", "m", "rad", "m", "m"]


@pytest.mark.long
def test_the_hexapods_struts_are_lengths_and_its_pointing_is_angles():
    rig = Rig.hexapod()
    assert set(rig.units) == {"m"}
    assert set(rig.row_units) == {"rad"}
