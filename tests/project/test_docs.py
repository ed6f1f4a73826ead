"""The documentation runs, and says the numbers that come out."""

import re
from pathlib import Path

import numpy as np
import pytest

from experiments.app.report import CHAPTERS
from experiments.studies import LINES
from tests.pages import assert_prints, assert_says

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
RESULTS = (ROOT / "docs" / "studies.md").read_text()

EXAMPLE, OWN, IN_A_LOOP = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
(PRINTED,) = re.findall(r"```text\n(.*?)```", README, re.DOTALL)


@pytest.mark.long
def test_the_readmes_lines_print_what_stands_below_them(capsys):
    names: dict = {}
    exec(EXAMPLE, names)
    assert_prints(capsys.readouterr().out, PRINTED)
    assert np.ptp(names["run"].displacement[names["run"].time_s > 2.5, 3]) < 1e-5  # it stands


@pytest.mark.long
def test_the_readmes_own_robot_is_failed_and_found(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "yours.xml").write_bytes((ROOT / "models" / "arm.xml").read_bytes())
    names: dict = {}
    for block in (OWN, IN_A_LOOP):
        exec(block, names)
    rates, kin = names["rates"], names["failed"]
    assert rates[1] == 0.0
    np.testing.assert_allclose(kin.J[:2] @ rates[kin.actuators], [0.1, 0.0], atol=1e-12)
    said, last = capsys.readouterr().out.splitlines()[-2:]
    assert "motor2 was named locked at 1." in said
    assert last.startswith("motor2 was named locked at 1.") and float(last.split()[-1]) < 1.5e-4


SERVOS = "\n".join(
    f'<position name="m{k}" joint="j{k}" kp="{kp}" kv="{kv}" ctrlrange="-3 3"/>'
    for k, kp, kv in ((1, 3000, 300), (2, 3000, 300), (3, 2000, 150), (4, 300, 15))
)
UNKNOWN = f"""
<mujoco>
  <option integrator="implicitfast"/>
  <default><joint armature="0.1"/><geom type="capsule" size="0.03" contype="0"/></default>
  <worldbody>
    <body><joint name="j1" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.3" mass="2"/>
    <body pos="0 0 0.3"><joint name="j2" axis="0 1 0"/><geom fromto="0 0 0 0.3 0 0.3" mass="2"/>
    <body pos="0.3 0 0.3"><joint name="j3" axis="0 1 0"/><geom fromto="0 0 0 0.3 0 0" mass="1"/>
    <body pos="0.3 0 0"><joint name="j4" axis="1 0 0"/><geom fromto="0 0 0 0.1 0 0" mass="0.3"/>
      <site name="tool" pos="0.1 0 0"/></body></body></body></body>
  </worldbody>
  <actuator>{SERVOS}</actuator>
</mujoco>
"""
"""An arm that is in no example, at MuJoCo's own time step; its bodies have no names."""


GANTRY = """
<mujoco>
  <option integrator="implicitfast" gravity="0 0 0"/>
  <default><joint type="slide" armature="1" damping="5"/><geom size="0.05" contype="0"/></default>
  <worldbody>
    <body><joint name="beam" axis="1 0 0"/><geom mass="2"/>
    <body><joint name="car" axis="0 1 0"/><geom mass="1"/>
    <body><joint name="fine" axis="1 0 0"/><geom mass="0.5"/></body></body></body>
  </worldbody>
  <actuator><position joint="beam" kp="2000" kv="100"/>
    <position joint="car" kp="2000" kv="100"/><position joint="fine" kp="1000" kv="50"/></actuator>
</mujoco>
"""
"""Its actuators have no names, nor has its tool, body 3."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("mjcf", "site", "joint", "rig", "actuators"),
    [
        (UNKNOWN, '"tool"', "j2", "major=[4, 5]", ("m1", "m2", "m3", "m4")),
        (GANTRY, "3", "car", "major=[3, 4], noise=1.0, crossover=0.5", ("beam", "car", "fine")),
    ],
    ids=["arm", "gantry"],
)
def test_the_readmes_lines_survive_a_robot_that_they_do_not_know(
    mjcf, site, joint, rig, actuators, tmp_path, monkeypatch, capsys
):
    """They name the lock; by sensors whose noise hides everything they say why there is none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "yours.xml").write_text(mjcf)
    own = EXAMPLE.replace('fjh.MODELS / "arm.xml"', '"yours.xml"').replace("motor4", joint)
    names: dict = {}
    exec(own.replace('"payload"', site).replace('major=["x", "y", "z"]', rig), names)
    last = capsys.readouterr().out.splitlines()[-1]
    assert names["rig"].actuators == actuators
    if joint == "j2":
        assert "m2 was named locked at 2." in last
        assert float(last.split()[0]) < 0.5 * 1e6 * names["rig"].size
    else:
        assert "Nothing was diagnosed; the sensors read what the model without" in last


def test_the_readme_is_read_in_two_minutes():
    assert len(README[: README.index("## Limits")].split()) <= 500


def test_the_readmes_results_are_those_of_the_page_of_studies():
    """Which is held to what comes out."""
    for said in ("12.2 %", "38 and 41 times", "0.00305"):
        assert said in README and said in RESULTS
    assert "1.38 and 1.17 here, by 4.01" in RESULTS and "1.38 here, 4.01" in README


def test_the_page_of_studies_lists_every_command_in_the_order_of_the_help():
    table = RESULTS[: RESULTS.index("## Table I")]
    listed = re.findall(r"`(\w+)`", "".join(re.findall(r"^\|([^|]*)\|", table, re.MULTILINE)))
    assert listed == [*LINES, "report", "live", "results", "review", "render", "animate"]


def test_the_page_says_which_studies_the_report_leaves_out():
    absent = " and ".join(f"`{name}`" for name in LINES if name not in CHAPTERS)
    assert f"all but {absent} on one page" in RESULTS


@pytest.mark.parametrize("angle", ["alpha", "beta"])
def test_the_page_of_studies_has_the_table_that_comes_out(table1, angle):
    for label, key in (("here", f"{angle}_rms_urad"), ("paper", f"paper_{angle}_rms_urad")):
        printed = [float(cell.strip("*")) for cell in markdown_row(RESULTS, f"{angle}, {label}")]
        computed = [column[key] for column in table1["columns"]]
        np.testing.assert_allclose(printed, computed, atol=6e-4)


def test_its_peaks_residuals_and_ratios_are_those_that_come_out(table1):
    columns, text = table1["columns"], " ".join(RESULTS.split())
    peaks = [
        [column["secondary_peak"][axis] for axis in ("t_x_um", "t_y_um")] for column in columns
    ]
    printed = [cell.split(", ") for cell in markdown_row(RESULTS, "peak t_x, t_y [µm]")]
    np.testing.assert_allclose(np.array(printed, dtype=float), peaks, rtol=0.02, atol=0.006)
    residual_nm = 1e9 * max(column["closure_residual_max_m"] for column in columns)
    assert_says(RESULTS, f"closed loops open by at most {residual_nm:.1f} nm")

    falls = np.divide(peaks[3], peaks[4])
    (said,) = re.findall(r"fall (\d+) and (\d+) times", text)
    np.testing.assert_allclose(np.array(said, dtype=float), falls, atol=1.0)
    cost = [columns[5][f"{a}_rms_urad"] / columns[0][f"{a}_rms_urad"] for a in ("alpha", "beta")]
    assert_says(RESULTS, f"{cost[0]:.2f} and {cost[1]:.2f} here")
    spared = 1 - np.divide(*(columns[k]["strut_input_rms_percent"] for k in (1, 0)))[[0, 2, 4]]
    assert spared == pytest.approx(0.60, abs=0.01)
    assert table1["further_runs"][0]["largest_rms_difference_urad"] < 5e-5


TOLD = {
    "stiffness": "tiffness|N m/rad",
    "damping": "[Dd]amp",
    "mass": "mass|drawn only|draw ",
    "range": "[Ss]troke",
    "springref": "springref",
    "gainprm": "gainprm",
    "forcerange": "80 N",
    "solref": "time constant",
    "solreflimit": "stops",
    "timestep": "ms",
    "gravity": "Gravity",
    "diaginertia": r"kg m\^2",
}
"""What the comment above must speak of when a physical attribute is set."""


def unmarked(mjcf: str) -> list[str]:
    """Elements with a number whose nearest comment above names no origin, or not this number."""
    origin = re.compile(r"\[(paper|geometry|chosen|derived)\b")
    comment, found = "", []
    for token in re.findall(r"<!--.*?-->|<[^!?/][^>]*>", mjcf, re.DOTALL):
        if token.startswith("<!--"):
            comment = token
            continue
        numbers = re.findall(r'(\w+)="[-+.\d][^"]*"', token)
        told = all(re.search(TOLD.get(name, ""), comment) for name in numbers)
        if numbers and not (origin.search(comment) and told):
            found.append(token)
    return found


def test_every_number_of_the_machine_file_says_where_it_comes_from():
    text = (ROOT / "models" / "fjh.xml").read_text()
    assert unmarked(text) == []
    assert unmarked(text.replace("[chosen", "[guessed")) != []
    assert unmarked(text.replace("springref is", "it is")) != []


THEORY = (ROOT / "docs" / "theory.md").read_text()


def markdown_row(text: str, label: str) -> list[str]:
    """Cells of the first table row that starts with a label."""
    row = re.search(rf"^\| {re.escape(label)} \|(.*)\|$", text, re.MULTILINE)
    assert row, label
    return [cell.strip() for cell in row.group(1).split("|")]


def test_every_test_file_and_picture_that_a_page_names_exists():
    """History names files of its time; NAME and STUDY stand for others."""
    tests = "\n".join(file.read_text() for file in (ROOT / "tests").rglob("test_*.py"))
    rooms = "argument_checks|examples|experiments|fjh|ftc|kernels|models|prioritized|sim|tests"
    pages = {ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")}
    missing, found = [], 0
    for page in pages:
        text = page.read_text()
        named = {name: f"def {name}(" in tests for name in re.findall(r"`(test_\w+)`", text)}
        for file in re.findall(rf"`((?:{rooms})/[\w/]+\.\w+)`", text):
            named[file] = (ROOT / file).is_file() or "NAME" in file or "STUDY" in file
        for picture in re.findall(r"\((pictures/\w+\.png)\)", text):
            named[picture] = (ROOT / "docs" / picture).is_file()
        missing += [(page.name, name) for name, exists in named.items() if not exists]
        found += len(named)
    assert missing == [] and found > 100


def test_every_name_of_code_that_the_theory_page_speaks_of_exists():
    code = "\n".join(file.read_text() for file in (ROOT / "prioritized").rglob("*.py"))
    words = re.findall(r"`(?:[A-Z]\w+\.)?((?!test_)[a-zA-Z_]\w+)(?:\(.*?\))?`", THEORY)
    outside = {"experiments", "sim", "fjh"}
    assert {word for word in words if word not in code} <= outside


def test_the_theory_page_speaks_of_every_equation_theorem_and_remark():
    """Equations (1) to (41), the two Problems, six Theorems, the Remarks and the footnote."""
    told = set()
    for first, last in re.findall(r"\((\d+)\)(?: to \((\d+)\))?", THEORY):
        told |= set(range(int(first), int(last or first) + 1))
    assert set(range(1, 42)) - told == set()
    for name in ("Problem 1", "Problem 6", "Remark 2", "Remark 10", "Footnote 1"):
        assert name in THEORY
    for theorem in (3, 4, 5, 7, 8, 9):
        assert f"Theorem {theorem}" in THEORY


def test_the_theory_pages_tables_are_those_that_come_out(release):
    sweep = release["sweep"]
    for label, key, tolerance in (
        ("alpha for 100 µrad commanded, simulated", "alpha_simulated_urad", 0.006),
        ("alpha, elastic mapping", "alpha_elastic_urad", 0.006),
        (
            "error of the payload motion predicted for a locked strut, %",
            "mismatch_as_if_locked_percent",
            0.5,
        ),
    ):
        printed = [float(cell) for cell in markdown_row(THEORY, label)]
        np.testing.assert_allclose(printed, [point[key] for point in sweep], atol=tolerance)
    spirals = {spiral["name"]: spiral for spiral in release["spirals"]}
    for label, start, flight in (
        ("no failure", "sound", "sound"),
        (
            "failure unknown to the mapping",
            "loose_from_start_uncorrected",
            "loose_in_flight_uncorrected",
        ),
        (
            "known, mapped by the springs' statics",
            "loose_from_start_corrected",
            "loose_in_flight_corrected",
        ),
        ("known, mapped as locked", "loose_from_start_as_locked", "loose_in_flight_as_locked"),
    ):
        keys = ("alpha_rms_urad", "beta_rms_urad")
        computed = [spirals[start][key] for key in keys]
        computed += [spirals[flight][key] for key in ("alpha_peak_urad", "sensitivity_peak")]
        printed = [float(cell) for cell in markdown_row(THEORY, label)]
        np.testing.assert_allclose(printed, computed, rtol=5e-3, atol=0.05)
    assert max(point["mismatch_elastic_percent"] for point in sweep) < 0.26
    assert max(point["mismatch_linear_model_percent"] for point in sweep) < 0.006
    possible = {row["struts"]: row["possible"] for row in release["atlas"]}
    assert f"possible in {possible['rigid']} of the 729 conditions" in THEORY
    assert f"and in {possible['elastic']} with the springs" in THEORY


def test_the_theory_pages_weighted_pseudo_inverse_is_what_it_does(model):
    """The paper's introduction: it compromises the major task in accordance with the weight."""
    from fjh.rig.hexapod.fault_tolerance import elastic_system

    kin = elastic_system(model).with_failures(locked=[0, 1]).kinematics()
    v = np.array([1e-4, 0, 0, 0, 0, 0])

    def errors_u(rates: np.ndarray) -> list[float]:
        off = 1e6 * (kin.J @ rates - v)
        return [float(np.linalg.norm(off[:2])), float(np.linalg.norm(off[3:]))]

    for w in (1, 10, 100):
        W = np.diag([w, w, 1, 1, 1, 1])
        printed = [float(cell) for cell in markdown_row(THEORY, f"pseudo-inverse, w = {w}")]
        computed = errors_u(np.linalg.pinv(W @ kin.J) @ W @ v)
        np.testing.assert_allclose(computed, printed, rtol=5e-3)
    exact = errors_u(kin.velocity_mapping([0, 1], secondary_weight=np.ones(4))(v[:2]))
    printed = [float(cell) for cell in markdown_row(THEORY, "the mapping")]
    np.testing.assert_allclose(exact, printed, atol=5e-3)
    assert exact[0] < 1e-9


def test_the_theory_pages_mechanisms_are_as_classified(systems, table1):
    import mujoco

    from experiments.systems import MECHANISMS
    from prioritized import ConstrainedSystem
    from sim import jacobians, load_model

    for mechanism in MECHANISMS:
        cells = markdown_row(THEORY, f"`{mechanism.name}.xml`")
        machine = load_model(mechanism.path)
        jac = jacobians(machine, mujoco.MjData(machine), "payload", "base")
        # Every velocity passive: all that the loops leave is self-motion.
        free = ConstrainedSystem(jac.J_T, jac.J_C, []).kinematics().passive_self_motion
        assert cells[:2] == [mechanism.title, f"{machine.nv}, {machine.nu}, {free.shape[1]}"]
        ours = [one for one in systems["systems"] if one["mechanism"] == mechanism.name]
        exact = sum(not one["unmanipulable"] and not one["unstable_major"] for one in ours)
        kinds = [sum(one[key] for one in ours) for key in ("unstable_major", "unmanipulable")]
        assert [int(cell) for cell in cells[2:6]] == [len(ours), exact, *kinds]
        off = 100 * max(one["largest_error"] for one in ours)
        assert float(cells[6].removesuffix(" %")) == pytest.approx(off, abs=0.01)
    off = max(
        abs(column[f"{angle}_rms_urad"] / column[f"predicted_{angle}_rms_urad"] - 1)
        for column in table1["columns"]
        for angle in ("alpha", "beta")
    )
    assert markdown_row(THEORY, "`fjh.xml`")[6] == f"{100 * off:.1f} % (RMS)"


JACOBIAN = (ROOT / "docs" / "jacobian.md").read_text()


def test_the_jacobian_pages_values_are_those_that_come_out(jacobian_study):
    variation = {one["norm"]: one for one in jacobian_study["variation"]}
    tried = {one["reading"]: one for one in jacobian_study["tried"]}

    def row(label: str) -> list[float]:
        return [float(cell) for cell in markdown_row(JACOBIAN, label)[:2]]

    def both(key: str) -> list[float]:
        return [variation[norm][key] for norm in ("frobenius", "two")]

    np.testing.assert_allclose(row("twist, base axes: found"), both("value"), atol=6e-6)
    bounds = both("certified_upper_bound")
    np.testing.assert_allclose(row("twist, base axes: certified to be at most"), bounds, atol=6e-6)
    np.testing.assert_allclose(row("certified bound"), bounds, atol=6e-7)
    np.testing.assert_allclose(row("value found"), both("value"), atol=6e-7)
    for part in ("linear", "quadratic", "cubic", "remainder"):
        computed = [variation[norm][part] for norm in ("frobenius", "two")]
        np.testing.assert_allclose(row(part), computed, rtol=0.05)
    for label, reading in {
        "twist, payload axes": "twist, payload axes",
        "Euler rates, R = Rz Ry Rx": "Euler rates, R = Rz Ry Rx",
        "Euler rates, R = Rx Ry Rz": "Euler rates, R = Rx Ry Rz",
        "inverse of J": "inverse of J",
        "lengths in mm": "lengths in mm",
        "origin between the top nodes": "origin between the top nodes",
        "J, largest entry of the change": "twist; largest entry of the change",
        "inverse, largest entry of the change": "inverse; largest entry of the change",
        "J, one strut at a time": "twist; one strut at a time",
        "J, struts within a ball": "twist; struts within a ball",
        "inverse, median of 1000 random points": "inverse; median of random points",
    }.items():
        computed = [tried[reading][norm] for norm in ("frobenius", "two")]
        np.testing.assert_allclose(row(label), computed, atol=6e-6)
    found = "{:.5f} (Frobenius) and {:.5f} (2-norm)".format(*both("value"))
    assert found in " ".join(RESULTS.split())


def test_the_jacobian_pages_costs_are_those_of_the_geometry():
    """The long run is not repeated here; what it shows, the geometry alone must say as well."""
    from experiments.jacobian import BY_NAME, GROWN, STRIDE_S, relative_change
    from fjh.rig.hexapod.closed_form import hexapod
    from fjh.rig.hexapod.controller import StrutMapping
    from fjh.rig.hexapod.curvature import extra_percent, follow, loop_gain_error
    from fjh.rig.hexapod.rig import nominal_testbed

    testbed, goal = nominal_testbed(), BY_NAME[GROWN].goal
    geometry = hexapod(testbed.model)
    constant = StrutMapping(geometry, goal, "constant")
    time_s = np.arange(0, 16, STRIDE_S)
    for label, times in {"x1": 1, "x100": 100}.items():
        bench = testbed.scaled(stroke=times, spiral=times).bench
        visited = follow(constant, bench.desired_rad(time_s))
        off = extra_percent(geometry, goal, visited)
        e = relative_change(geometry, visited.strut_m, "frobenius").max()
        gain = 100 * loop_gain_error(constant, visited.strut_m)
        cells = [float(cell) for cell in markdown_row(JACOBIAN, label)]
        np.testing.assert_allclose(
            [cells[0], cells[2], cells[7]], [e, off, gain], rtol=0.05, atol=6e-3
        )
        assert cells[0] == pytest.approx(e, rel=0.02)
        # The simulation adds its floor to what the geometry says.
        floor = cells[6]
        assert cells[3] == pytest.approx(np.hypot(off, floor), rel=0.05)
