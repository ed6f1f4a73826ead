"""Mass matrix and springs of joints."""

import mujoco
import numpy as np
import pytest

from sim import ModelError
from sim.mjcf import joint_stiffness, mass_matrix
from tests.motions import shifted
from tests.sim.machines import closed
from tests.sim.transmissions import linkage


def test_the_mass_matrix_gives_the_kinetic_energy_of_any_velocity():
    of = linkage()
    data = closed(of)
    mass = mass_matrix(of, data)
    of.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    for velocity in np.random.default_rng(0).normal(size=(3, of.nv)):
        data.qvel[:] = velocity
        mujoco.mj_forward(of, data)
        assert velocity @ mass @ velocity / 2 == pytest.approx(data.energy[1], rel=1e-12)


def test_springs_push_back_with_their_stiffness_against_each_velocity():
    xml = """<mujoco><option gravity="0 0 0"/><worldbody>
      <body><joint type="ball" stiffness="3"/><geom size="0.1"/><body pos="1 0 0">
        <joint type="slide" stiffness="2"/><geom size="0.1"/><body pos="1 0 0">
          <joint name="hinge" stiffness="5"/><geom size="0.1"/></body></body></body>
      <body pos="4 0 0"><joint type="free" stiffness="7"/><geom size="0.1"/></body>
    </worldbody></mujoco>"""
    of, h = mujoco.MjModel.from_xml_string(xml), 1e-4
    pushed = []
    for e in h * np.eye(of.nv):
        data = shifted(of, mujoco.MjData(of), e)
        mujoco.mj_forward(of, data)
        pushed.append(-data.qfrc_passive / h)
    np.testing.assert_allclose(pushed, np.diag(joint_stiffness(of)), atol=1e-9)
    plastic = xml.replace('stiffness="5"', 'stiffness="5" springyield="0.1"')
    with pytest.raises(ModelError, match='the spring of joint "hinge" is not linear'):
        joint_stiffness(mujoco.MjModel.from_xml_string(plastic))
