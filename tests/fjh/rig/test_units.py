"""Every displacement has its unit: from the model's joints to the names of published numbers."""

import mujoco
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig.units import by_unit, said
from sim.mjcf import drives
from tests.fjh.rigs import rig
from tests.robots import TEST_MODELS


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


def test_an_actuator_of_hinges_moves_by_an_angle_others_by_a_length():
    known = drives(mujoco.MjModel.from_xml_path(str(TEST_MODELS / "transmissions.xml")))
    assert [drive.unit for drive in known] == ["rad", "m", "rad", "m", "m"]
    assert set(rig("hexapod").units) == {"m"} and set(rig("hexapod").row_units) == {"rad"}
