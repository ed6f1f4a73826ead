"""Closures: rows are the slopes of their gaps, for all other elements of a model."""

import mujoco
import numpy as np
import pytest

from sim import CenterOfMass, ClosureError, ModelError, assemble, jacobians, linearize
from tests.models import model_of
from tests.motions import check_slope, shifted
from tests.sim.machines import closed_state, linkage, open_state, state_at, stored_options

ROWS = 2 * 3 + 1 + 6 + 1
"""Number of rows of the equalities of the linkage."""


@stored_options
def test_rows_are_slopes_of_gaps(storage):
    """Check a closed pose along every velocity, admissible or not."""
    model = linkage(*storage)
    units = np.eye(model.nv)
    for seed in range(4):
        data = closed_state(model, seed)

        def opening(h: float, data: mujoco.MjData = data) -> np.ndarray:
            ends = [shifted(model, data, h * e) for e in units]
            return np.array([end.efc_pos[: end.ne] for end in ends]).T

        J_C = jacobians(model, data, "tool").J_C
        assert J_C.shape == (ROWS, model.nv)
        check_slope(J_C, opening, h=4e-3, most=1e-4)


@stored_options
def test_contacts_limits_and_dry_friction_have_no_rows(storage):
    model = linkage(*storage)
    model.opt.disableflags = 0
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)  # finds the contacts
    full = jacobians(model, data, "tool").J_C
    at_work = {mujoco.mjtConstraint(kind).name for kind in data.efc_type}
    assert {"mjCNSTR_FRICTION_DOF", "mjCNSTR_LIMIT_JOINT", "mjCNSTR_CONTACT_PYRAMIDAL"} < at_work
    none = mujoco.mjtDisableBit
    model.opt.disableflags |= int(
        none.mjDSBL_CONTACT | none.mjDSBL_LIMIT | none.mjDSBL_FRICTIONLOSS
    )
    np.testing.assert_array_equal(jacobians(model, data, "tool").J_C, full)
    assert len(full) == data.nefc == ROWS


def test_an_equality_counts_while_it_is_active():
    model, tool = linkage(), "tool"  # the tool moves if any loop is open
    data = mujoco.MjData(model)
    closed_rows = jacobians(model, data, tool).J_C
    data.eq_active[model.equality("brake").id] = True
    braked = jacobians(model, data, tool).J_C
    np.testing.assert_array_equal(braked[:ROWS], closed_rows)
    np.testing.assert_array_equal(np.flatnonzero(braked[ROWS]), model.joint("weight").dofadr)
    data.eq_active[model.equality("grip").id] = False
    assert len(jacobians(model, data, tool).J_C) == ROWS + 1 - 6
    with pytest.raises(ModelError, match="no actuator moves 'payload'"):  # it is released
        jacobians(model, data, "payload")
    data.eq_active[:] = False
    assert jacobians(model, data, tool).J_C.shape == (0, model.nv)


@pytest.mark.parametrize("flag", ["EQUALITY", "CONSTRAINT"])
def test_active_equalities_that_flags_disable_are_rejected(flag):
    """Otherwise a closed mechanism would be analyzed as an open one."""
    model = model_of("five_bar")
    model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    with pytest.raises(ModelError, match="equalities are active, and the model's flags disable"):
        jacobians(model, mujoco.MjData(model), "tool")
    model.eq_active0[:] = False
    assert jacobians(model, mujoco.MjData(model), "tool").J_C.shape == (0, 5)


def test_open_loops_are_rejected_beyond_the_tolerance():
    model = model_of("five_bar")
    data = open_state(model, 0.01)
    with pytest.raises(ClosureError, match=r"call sim\.assemble\(model, data\)"):
        jacobians(model, data, "tool")
    residual = jacobians(model, data, "tool", closure_tolerance=np.inf).closure_residual
    assert residual == pytest.approx(np.abs(data.efc_pos).max())
    unnamed = model_of("five_bar", ('connect name="pin"', "connect"))
    with pytest.raises(ClosureError, match=r'equality 0 \(connect of "a2" and "b2"\) is open'):
        jacobians(unnamed, open_state(unnamed, 0.01), "tool")
    model.eq_data[0, :3] = np.nan
    with pytest.raises(ModelError, match="an equality of the model must be finite"):
        jacobians(model, data, "tool")


def test_a_weld_of_any_torquescale_is_closed_in_radians():
    """MuJoCo's residual at a torquescale of 1e-3 is a two-thousandth of the angle."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body name="a"><joint name="a" axis="0 0 1"/><geom size="0.1"/><site name="tool"/>
        <body name="b" pos="0 0 1"><joint name="b" axis="0 0 1"/><geom size="0.1"/></body></body>
      </worldbody><equality><weld name="grip" body1="b" torquescale="1e-3"/></equality>
      <actuator><motor joint="a"/></actuator></mujoco>""")
    data = state_at(model, b=1e-4)
    assert jacobians(model, data, "tool").closure_residual == pytest.approx(1e-4, rel=1e-6)
    assert np.abs(assemble(model, data).qpos).max() < 1e-10


def test_welds_and_connects_between_sites_have_one_common_point_too():
    model = model_of(
        "parallelogram",
        ('<connect name="pin" body1="bar" body2="right" anchor="0.4 0 0"/>', TIES),
        ('<site name="tool"', '<site name="end" pos="0.4 0 0"/><site name="tool"'),
        ('<body name="right" pos="0.4 0 0">', FAR),
    )
    J_C = jacobians(model, open_state(model, 2e-4), "tool").J_C
    assert J_C.shape == (9, model.nv)
    assert np.abs(J_C[:, model.joint("base").dofadr[0]]).max() < 1e-15


TIES = '<connect site1="end" site2="top"/><weld body1="right" body2="far"/>'
FAR = """<body name="far" pos="0.4 0 0.3"><joint type="ball"/><joint type="slide" axis="1 0 0"/>
  <joint type="slide" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.1"/></body>
  <body name="right" pos="0.4 0 0"><site name="top" pos="0 0 0.3"/>"""


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.7])
def test_a_redundant_crank_removes_no_freedom_from_a_linear_model(turn):
    """Three parallel cranks closed to 1e-11 have one freedom."""
    third = """<body name="third" pos="0.2 0 0"><joint name="third" axis="0 1 0"/>
      <geom fromto="0 0 0 0 0 0.3"/></body><body name="right" pos="0.4 0 0">"""
    model = model_of(
        "parallelogram",
        ('<joint name="base" axis="0 0 1"/>', ""),
        ('<motor name="turn" joint="base"/>', ""),
        ('<body name="right" pos="0.4 0 0">', third),
        ("</equality>", '<connect body1="bar" body2="third" anchor="0.2 0 0"/></equality>'),
    )
    closed = assemble(model, state_at(model, left=turn + 1e-3, bar=-turn, third=turn, right=turn))
    closed.joint("right").qpos += 2e-11
    assert len(linearize(model, closed, site="tool", axes=None).A) == 2


CLOTH = """<flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" dim="2"
  radius="0.01" mass="1" pos="0 0 1">{}<edge equality="true"/></flexcomp>"""


def cloth(
    on_hand: str = "", on_ground: str = "", ties: str = ""
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Create a robot and a cloth with some attributes."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
      <body pos="0 0 2"><joint name="a"/><geom size="0.1"/><body name="hand" pos="0.3 0 0">
        <joint name="b"/><geom size="0.1"/><site name="tool"/>{on_hand}</body></body>{on_ground}
      </worldbody><equality><joint joint1="b" joint2="a" polycoef="0 2 0 0 0"/>{ties}</equality>
      <actuator><motor joint="a"/></actuator></mujoco>""")
    return model, mujoco.MjData(model)


@pytest.mark.parametrize(
    "where", [{"on_ground": CLOTH.format("")}, {"on_hand": CLOTH.format('<pin id="0 2"/>')}]
)
def test_a_cloth_outside_the_task_is_left_out_with_a_warning(where):
    """`assemble` warns as well; the robot's loop, whose row follows the cloth's, stays closed."""
    model, data = cloth(**where)
    data.joint("a").qpos, data.joint("b").qpos = 0.3, 0.5
    with pytest.warns(RuntimeWarning, match="flex.* is left out"):
        closed = assemble(model, data)
    assert closed.joint("b").qpos == pytest.approx(2.0 * closed.joint("a").qpos, abs=1e-9)
    jac = jacobians(model, closed, "tool")
    assert any("flex" in sentence and "left out" in sentence for sentence in jac.warnings)
    row = np.zeros((1, model.nv))
    row[0, model.joint("b").dofadr], row[0, model.joint("a").dofadr] = 1.0, -2.0
    np.testing.assert_array_equal(jac.J_C, row)
    expected = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, closed, expected, None, model.site("tool").id)
    np.testing.assert_array_equal(jac.J_T[3:], expected)
    closed.eq_active[model.eq_type == mujoco.mjtEq.mjEQ_FLEX] = 0
    assert not any("flex" in sentence for sentence in jacobians(model, closed, "tool").warnings)


def test_a_cloth_tied_to_the_robot_is_rejected_with_advice_that_helps():
    model, data = cloth(
        on_ground=CLOTH.format('<pin id="8"/>'), ties='<weld body1="hand" body2="cloth_0"/>'
    )
    with pytest.raises(ModelError, match=r"couples a flex to the mechanism.*eq_active0 and data"):
        jacobians(model, data, "tool", closure_tolerance=np.inf)
    of_flex = model.eq_type == mujoco.mjtEq.mjEQ_FLEX
    model.eq_active0[of_flex], data.eq_active[of_flex] = 0, 0
    jacobians(model, assemble(model), "tool")
    jacobians(model, data, "tool", closure_tolerance=np.inf)


def sleeping_state(drive: str, open_by: float = 0.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Create two bodies with a gear between them, possibly inactive, and a third body."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 0 0"><flag sleep="enable"/></option><worldbody>
      <body sleep="allowed"><joint name="a"/><geom size="0.1"/></body>
      <body sleep="allowed" pos="3 0 0"><joint name="b" axis="0 1 0"/>
        <geom size="0.1" pos="0.2 0 0"/><site name="tool" pos="0.3 0 0"/></body>
      <body sleep="allowed" pos="9 0 0"><freejoint/><geom size="0.1"/></body></worldbody>
      <tendon><fixed name="cable"><joint joint="a" coef="1"/><joint joint="b" coef="3"/></fixed>
      </tendon><equality><joint joint1="a" joint2="b"/></equality>
      <actuator><motor {drive}/></actuator></mujoco>""")
    data = mujoco.MjData(model)
    data.eq_active[0] = not open_by
    data.qpos[:2] = 0.2, 0.2 - open_by
    mujoco.mj_step(model, data, 2000)
    assert data.ntree_awake == 0
    return model, data


@pytest.mark.parametrize("drive", ['joint="a"', 'tendon="cable"', 'site="tool" gear="0 0 1 0 0 0"'])
def test_sleeping_trees_have_the_same_jacobians_as_awake_ones(drive):
    """MuJoCo skips equality and transmission rows of sleeping trees; frames are up to date."""
    model, data = sleeping_state(drive)
    sleeping = jacobians(model, data, ["tool", CenterOfMass()])
    closed = assemble(model, data)
    assert data.ntree_awake == 0  # unchanged
    model.opt.enableflags = 0
    awake = jacobians(model, data, ["tool", CenterOfMass()])
    assert len(awake.J_C) == 1 + ("joint" not in drive)
    np.testing.assert_array_equal(sleeping.J_T, awake.J_T)
    np.testing.assert_array_equal(sleeping.J_C, awake.J_C)
    np.testing.assert_array_equal(sleeping.accuracy.J_C_error, awake.accuracy.J_C_error)  # type: ignore[union-attr]
    np.testing.assert_allclose(closed.qpos, data.qpos, atol=1e-9)


def test_an_equality_activated_in_a_sleeping_tree_is_closed():
    model, data = sleeping_state('joint="a"', open_by=0.2)
    data.eq_active[0] = 1
    with pytest.raises(ClosureError, match=r"open by 0\.2"):
        jacobians(model, data, "tool")
    a, b = assemble(model, data).qpos[:2]
    assert a == pytest.approx(b, abs=1e-9)
