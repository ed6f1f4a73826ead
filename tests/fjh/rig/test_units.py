"""Every displacement has its unit: from the model's joints to the names of published numbers."""

from pathlib import Path

import mujoco
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig.bodies import model_name
from fjh.rig.units import by_unit, said
from sim.mjcf import drives
from tests.fjh.rigs import rig
from tests.models import model


@given(rows=st.lists(st.tuples(st.sampled_from(["rad", "m"]), st.floats(-1, 1)), min_size=1))
def test_each_value_is_in_the_entry_of_its_unit_in_order(rows):
    units = [unit for unit, _ in rows]
    entries = by_unit("rms", [value for _, value in rows], units)
    left = {key: iter(own) for key, own in entries.items()}
    assert [next(left[f"rms_{unit}"]) for unit in units] == [value for _, value in rows]
    assert all(list(own) == [] for own in left.values())
    assert by_unit("rms", None, units) == dict.fromkeys(entries)


@given(size=st.floats(1e-12, 1e9), sign=st.sampled_from([1, -1]))
def test_a_number_is_read_back_from_its_unit_with_three_digits(size, sign):
    number, unit = said(sign * size, "m").split()
    power = {"m": 0, "mm": -3, "µm": -6, "nm": -9}[unit]
    assert float(number) * 10.0**power == pytest.approx(sign * size, rel=5.1e-3)
    assert unit in ("nm", "m") or 1 <= abs(float(number)) < 1000
    assert size > 9e5 or "e" not in number


@pytest.mark.parametrize(
    ("stated", "name"),
    [(' model="a&#10;b"', "a b"), (' model=" "', "file"), ("", "file"), (' model="x"', "x")],
)
def test_a_model_is_called_as_its_file_says_or_as_its_file(stated, name):
    """In one line, whatever XML can hold; what MuJoCo calls a model without a name is no name."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco{stated}><worldbody/></mujoco>")
    assert model_name(model, Path("some/file.xml")) == name


@pytest.mark.parametrize("name", ["limited", "gantry"])
def test_an_actuator_of_turns_moves_by_an_angle_others_by_a_length(name):
    """A hinge, a slide, a tendon over both, a ball joint; a tendon of hinges, a rope, a rail."""
    units = {"limited": ["rad", "m", "m", "rad"], "gantry": ["rad", "m", "m"]}
    found = [drive.unit for drive in drives(model(name))]
    assert found[: len(units[name])] == units[name]


def test_the_hexapod_moves_by_lengths_and_points_by_angles():
    assert set(rig("hexapod").units) == {"m"} and set(rig("hexapod").row_units) == {"rad"}
