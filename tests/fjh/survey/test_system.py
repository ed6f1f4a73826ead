"""Surveyed systems: matrices in several file formats, limits, and invalid input."""

import numpy as np
import pytest

from fjh.study.errors import WrongInput
from fjh.survey.system import matrix_system
from prioritized import ConstrainedSystem
from sim import MODELS
from tests.fjh.survey.surveys import conditions, matrix_file, of_matrix, of_robot, speeds
from tests.robots import TEST_MODELS

B = np.random.default_rng(3).normal(size=(3, 5))


@pytest.mark.parametrize(
    ("name", "text"),
    {
        "bare.csv": "1,2,0\n0,1,3\n",
        "header.csv": "a,b,c\n1,2,0\n0,1,3\n",
        "names.csv": "x,1,2,0\ny,0,1,3\n",
        "both.csv": ",a,b,c\nx,1,2,0\ny,0,1,3\n",
        "corner.csv": "a,b,c\nx,1,2,0\ny,0,1,3\n",
        "blanks.txt": "# from somewhere\n1 2 0\n\n0 1 3\n",
        "semicolons.csv": "a;b;c\n1;2;0\n0;1;3\n",
        "tabs.tsv": "\ufeffa\tb\tc\n1\t2\t0\n0\t1\t3\n",
    }.items(),
)
def test_matrix_is_the_same_with_and_without_names(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    system = matrix_system(tmp_path / name, None, None, None, None)
    np.testing.assert_array_equal(system.constrained_system.J_T, [[1, 2, 0], [0, 1, 3]])
    has_header, has_names = "a" in text[:8] and "b" in text[:8], "x," in text
    assert system.actuators == (tuple("abc") if has_header else ("u1", "u2", "u3"))
    assert system.rows == (tuple("xy") if has_names else ("row 0", "row 1"))
    assert system.major == (0, 1)
    if has_names:
        assert matrix_system(tmp_path / name, None, None, "y", None).major == (1,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b,c\n", "has no numbers"),
        ("1,2\n3\n", "row 2, column 2 must be a number below"),
        ("1,2\n3,4,5\n", "cannot be read: Error tokenizing"),
        ("x,1,2\nx,3,4\n", "names of rows must differ"),
        ("a,b\n1,2,3\n", "the first row has 2 names for 3 columns"),
        pytest.param(f"a,b\n1,{'2' * 100_000}\n", "row 1, column 2 must be a number", id="huge"),
        pytest.param("1," * 200 + "1\n", "1 to 200 rows", id="wide"),
    ],
)
def test_invalid_matrix_file_is_rejected_in_one_sentence(tmp_path, text, message):
    (tmp_path / "B.csv").write_text(text)
    with pytest.raises(WrongInput, match=message) as error:
        matrix_system(tmp_path / "B.csv", None, None, None, None)
    assert "B.csv" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--lower", "1", "--upper", "-1"], "--lower of u1 is above its --upper: 1 > -1"),
        (["--upper", "L.csv"], "with 3"),
        (["--hold", "1,x"], "--hold: there is no file"),
        (["--major", "2"], "--major must be different rows from 0 to 1 or of row 0,row 1"),
        (["--site", "tip"], "--site applies to a robot"),
        ([str(MODELS / "arm.xml")], "give either a MODEL.xml or --matrix"),
    ],
)
def test_invalid_options_of_a_matrix_are_rejected(
    tmp_path, refused, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    matrix_file(tmp_path / "B.csv", B[:2])
    matrix_file(tmp_path / "L.csv", np.ones((1, 3)))
    assert message in refused("survey", "--matrix", "B.csv", *arguments, "--out", "out")
    assert not (tmp_path / "out").exists()


def test_limits_come_from_files_of_numbers_in_a_row_or_a_column(tmp_path):
    file = matrix_file(tmp_path / "B.csv", B)
    upper = matrix_file(tmp_path / "U.csv", np.arange(1.0, 6.0)[None])
    column = matrix_file(tmp_path / "V.csv", np.arange(1.0, 6.0)[:, None])
    starts = [of_matrix(file, lower="-1", upper=str(limits)).start for limits in (upper, column)]
    np.testing.assert_array_equal(speeds(starts[0]), speeds(starts[1]))
    kin = ConstrainedSystem(B, None, range(5)).kinematics()
    radius = kin.attainable(range(3), (-1, range(1, 6))).radius
    assert speeds(starts[0])[0] == pytest.approx(radius)


def test_velocity_actuators_limit_rates_and_gears_count():
    file, task = TEST_MODELS / "stretched.xml", {"site": "tip", "axes": None, "major": "4"}
    survey = of_robot(file, **task)
    system, healthy = survey.system, conditions(survey).loc["healthy"]
    assert np.isnan(healthy.worst_speed_m_per_s) and healthy.speed_left == 1.0
    np.testing.assert_allclose(system.rates, [[-0.5, -1, -np.inf], [0.5, 3, np.inf]])
    assert system.sources["rates"] is not None and system.torques is not None
    np.testing.assert_allclose(system.torques[1], [np.inf, np.inf, 7])
    stated = of_robot(file, lower="-2", upper="2", **task).system
    np.testing.assert_array_equal(stated.rates, [[-2] * 3, [2] * 3])
