"""A broken number of a model is one sentence that names its element, whoever reads the file."""

import re
from pathlib import Path

import pytest

from experiments.app.cli import main
from sim import HEXAPOD_MJCF, MODELS, ModelError, load_model

MODEL = """<mujoco>
<option timestep="0.002" gravity="0 0 -9.81" density="0"/>
<statistic extent="1"/>
<worldbody><body name="arm" pos="0 0 0">
  <joint name="hinge" axis="0 0 1" damping="1" stiffness="0" armature="0" frictionloss="0"
    range="-1 1" springref="0" ref="0"/>
  <geom name="ball" size="0.1" mass="1" friction="1"/>
  <site name="tip" pos="0 0 0.1"/>
</body></worldbody>
<tendon><fixed name="cord" damping="2"><joint joint="hinge" coef="1"/></fixed></tendon>
<actuator><position name="servo" joint="hinge" kp="10" gear="1" ctrlrange="-1 1"/></actuator>
<keyframe><key name="home" qpos="0.5" ctrl="0.5"/></keyframe>
</mujoco>"""

HUGE = ("inf", "-1e300", "1e20")
BROKEN = {  # what is replaced, by what, and which sentence names it
    'timestep="0.002"': ("timestep", ("1e9", "1e-9", "0", "-1", "inf")),
    'gravity="0 0 -9.81"': ("gravity", ("0 0 1e20", "0 inf 0")),
    'density="0"': ("density", HUGE),
    'extent="1"': ("extent", ("inf", "1e300")),
    'pos="0 0 0"': ('pos of body "arm"', ("0 0 1e20", "inf 0 0")),
    'pos="0 0 0.1"': ('pos of site "tip"', ("0 0 1e20", "inf 0 0")),
    'mass="1"': ('inertia of body "arm"', ("inf", "1e300", "1e20")),
    'friction="1"': ('friction of geom "ball"', HUGE),
    'damping="1"': ('damping of joint "hinge"', (*HUGE, "-1")),
    'stiffness="0"': ('stiffness of joint "hinge"', HUGE),
    'armature="0"': ('armature of joint "hinge"', (*HUGE, "-1")),
    'frictionloss="0"': ('frictionloss of joint "hinge"', (*HUGE, "-1")),
    'springref="0"': ('qpos_spring of joint "hinge"', HUGE),
    'damping="2"': ('damping of tendon "cord"', (*HUGE, "-1")),
    'kp="10"': ('of actuator "servo"', HUGE),
    'gear="1"': ('gear of actuator "servo"', HUGE),
    'qpos="0.5"': ('qpos of key "home"', HUGE),
    'ctrl="0.5"': ('ctrl of key "home"', HUGE),
}
CASES = [(old, new, name) for old, (name, values) in BROKEN.items() for new in values]


def broken(folder: Path, text: str, old: str, new: str) -> Path:
    """The machine with one attribute replaced."""
    assert old in text
    file = folder / "broken.xml"
    file.write_text(text.replace(old, f'{old.partition("=")[0]}="{new}"', 1))
    return file


def refused(file: Path) -> str:
    """The sentence; its path is left out."""
    with pytest.raises(ModelError) as error:
        load_model(file)
    sentence = str(error.value)
    assert sentence.startswith(f"{file}: ") and "\n" not in sentence
    return sentence.removeprefix(f"{file}: ")


@pytest.mark.parametrize(("old", "new", "named"), CASES)
def test_an_absurd_number_is_refused_with_the_name_of_its_element(tmp_path, old, new, named):
    said = refused(broken(tmp_path, MODEL, old, new))
    assert named in said and " must be " in said


@pytest.mark.parametrize("old", [*BROKEN, 'range="-1 1"', 'ctrlrange="-1 1"'])
def test_nan_is_refused_even_where_mujoco_takes_it_for_a_number_that_is_not_stated(tmp_path, old):
    """A mass is one: the density would be taken instead."""
    attribute = old.partition("=")[0]
    assert f"{attribute} of " in refused(broken(tmp_path, MODEL, old, "NaN"))


@pytest.mark.parametrize(
    ("old", "new"), [('range="-1 1"', "-inf inf"), ('name="tip"', "nan"), ('mass="1"', "1e-6")]
)
def test_what_may_be_infinite_small_or_a_name_is_accepted(tmp_path, old, new):
    assert load_model(broken(tmp_path, MODEL, old, new)).nsite == 1


@pytest.mark.parametrize("file", sorted(MODELS.glob("*.xml")), ids=lambda file: file.stem)
def test_every_machine_that_is_shipped_is_sound(file):
    assert load_model(file).nu


@pytest.mark.parametrize("words", ["track", "table1 --model"])
@pytest.mark.parametrize("new", ["nan", "1e9"])
def test_a_command_says_so_in_one_line_and_leaves_nothing(capfd, tmp_path, words, new):
    text = HEXAPOD_MJCF.read_text()
    (old,) = re.findall(r'timestep="[^"]+"', text)
    file, out = broken(tmp_path, text, old, new), tmp_path / "out"
    assert main([*words.split(), str(file), "--out", str(out)]) == 2
    said = capfd.readouterr().err
    assert said.startswith(f"fjh: {file}: timestep") and said.count("\n") == 1
    assert not out.exists()
