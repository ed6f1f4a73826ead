"""The first pages: their code runs as printed, and what they say of MuJoCo and pip is so."""

import contextlib
import re
import shutil
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.pages import blocks, run

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
QUICKSTART, URDF, INSTALL = (
    (DOCS / f"{name}.md").read_text() for name in ("quickstart", "urdf", "install")
)
ARM = next(content for language, content in blocks(URDF) if language == "xml")


@pytest.mark.long
def test_the_quickstart_ends_with_a_lens_that_stays_on_its_circle(tmp_path):
    """Joint 4 stands in the physics of both flights; the unaware one is off by its radius."""
    with contextlib.chdir(tmp_path):
        names = run(QUICKSTART)
    rates, kin = names["rates"], names["stuck"]
    np.testing.assert_allclose(kin.J[3:] @ rates[kin.actuators], [0, 0, 0.01], atol=1e-12)
    late, supervised, unaware = (names[name] for name in ("late", "supervised", "unaware"))
    for flight in (supervised, unaware):
        assert np.ptp(flight.displacement[late, 3]) < 1e-5
    off = [np.linalg.norm(one.desired - one.true, axis=1)[late] for one in (supervised, unaware)]
    size = names["rig"].size
    assert off[0].max() < 0.05 * size
    assert np.sqrt((off[1] ** 2).mean()) > size


@pytest.mark.long
def test_a_robot_of_a_urdf_file_flies_on_with_a_locked_joint(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    with contextlib.chdir(tmp_path):
        names = run(URDF)
    flight = names["run"]
    (found,) = flight.diagnoses
    assert (found.actuator, found.kind) == ("elbow", "locked")
    late = flight.time_s > 1.7
    off = np.linalg.norm(flight.desired - flight.true, axis=1)[late]
    assert np.sqrt((off**2).mean()) < 0.05 * names["rig"].size


@pytest.mark.long
def test_the_bump_of_the_page_on_tracks_is_felt_and_is_no_failure(tmp_path):
    """A push of 0.2 N for 50 ms moves the lens; only joint 4, which locks after it, is named."""
    shutil.copy(ROOT / "models" / "arm.xml", tmp_path)
    with contextlib.chdir(tmp_path):
        names = run((DOCS / "track.md").read_text())
    rig, pushed, path = names["rig"], names["run"], names["path"]
    assert [(found.actuator, found.kind) for found in pushed.diagnoses] == [("motor4", "locked")]
    before = pushed.time_s < 2.45
    calm = rig.fly(rig.supervisor(), path[before], seed=0)
    assert 1e-6 < np.abs(calm.true - pushed.true[before]).max() < 1e-3


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def urdf(folder: Path, extension: str, upper: str = "", arm: str = ARM) -> mujoco.MjModel:
    """The arm with another extension, and with more in its upper link; beside it `meshes/a.obj`."""
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes" / "a.obj").write_text(TETRAHEDRON)
    text = re.sub(r"<mujoco>.*?</mujoco>", extension and f"<mujoco>{extension}</mujoco>", arm)
    file = folder / "arm.urdf"
    file.write_text(text.replace('<link name="upper">', f'<link name="upper">{upper}'))
    return mujoco.MjSpec.from_file(str(file)).compile()


def extension(attribute: str) -> str:
    """The row of the page's table with this attribute of the extension."""
    (found,) = re.findall(rf"^\| `(<[^`]*{attribute}[^`]*/>)` \|", URDF, re.MULTILINE)
    return found


def shape(kind: str) -> str:
    """A mesh as ROS names it."""
    mesh = '<mesh filename="package://my_robot/meshes/a.obj"/>'
    return f"<{kind}><geometry>{mesh}</geometry></{kind}>"


def bodies(model: mujoco.MjModel) -> list[str]:
    """Their names."""
    return [model.body(k).name for k in range(model.nbody)]


def test_a_link_on_a_fixed_joint_is_merged_unless_the_extension_keeps_it(tmp_path):
    assert "tool" not in bodies(urdf(tmp_path, ""))
    assert "tool" in bodies(urdf(tmp_path, extension("fusestatic")))


def test_meshes_named_as_in_ros_are_found_with_the_extension(tmp_path):
    with pytest.raises(ValueError, match=r"package:/my_robot/meshes/a\.obj"):
        urdf(tmp_path, "", shape("collision"))
    assert urdf(tmp_path, extension("meshdir"), shape("collision")).nmesh == 1


def test_visual_shapes_are_left_out_unless_the_extension_keeps_them(tmp_path):
    visual = "<visual><geometry><sphere radius='0.1'/></geometry></visual>"
    assert urdf(tmp_path, "", visual).ngeom == 0
    assert urdf(tmp_path, extension("discardvisual"), visual).ngeom == 1


def test_impossible_inertias_are_refused_unless_the_extension_balances_them(tmp_path):
    flat = ARM.replace('ixx="0.016"', 'ixx="0.1"')
    with pytest.raises(ValueError, match="inertia"):
        urdf(tmp_path, "", arm=flat)
    assert urdf(tmp_path, extension("balanceinertia"), arm=flat).nv == 3


def test_the_extension_takes_options_and_no_actuators(tmp_path):
    assert urdf(tmp_path, extension("timestep")).opt.timestep == 1e-3
    assert urdf(tmp_path, "").opt.timestep == 2e-3
    assert urdf(tmp_path, '<actuator><motor joint="elbow"/></actuator>').nu == 0


def test_the_page_on_installation_has_every_extra_of_a_user():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    said = re.findall(r"\| `pip install \"?\.(?:\[(\w+)\])?\"?` \|", INSTALL)
    extras = project["optional-dependencies"].keys() - {"test", "check", "docs"}
    assert said == ["", *(name for name in project["optional-dependencies"] if name in extras)]
    versions = re.findall(r":: (3\.\d+)", " ".join(project["classifiers"]))
    assert f"Python {versions[0]} to {versions[-1]} on Linux" in INSTALL


@pytest.mark.parametrize("word", ["install", "quickstart", "URDF", "Panda", "glossary", "MJCF"])
def test_what_a_newcomer_searches_for_is_the_title_of_a_page(word):
    """The site's search puts titles first."""
    titles = [page.read_text().splitlines()[0] for page in DOCS.glob("*.md")]
    assert [title for title in titles if word.lower() in title.lower()], word
