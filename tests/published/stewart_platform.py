"""T. Dehaeze's Stewart platform, built from his parameters: stewart-simscape, folder org."""

import mujoco
import numpy as np

from fjh import ConstrainedSystem, jacobians, sim

a, b = np.deg2rad([[-10, 10, 110, 130, 230, 250], [-50, 50, 70, 170, 190, 290]])  # joints
foot = np.column_stack([0.115 * np.cos(a), 0.115 * np.sin(a), np.full(6, 0.015)])  # [m]
head = np.column_stack([0.090 * np.cos(b), 0.090 * np.sin(b), np.full(6, 0.075)])
rod = '<geom type="cylinder" size="0.005 0.025" mass="0.1" pos="0 0'
struts = balls = loops = motors = ""
for k, vectors in enumerate(zip(foot, head - foot, head - [0, 0, 0.09], strict=True), start=1):
    at, along, on = (" ".join(map(str, vector)) for vector in vectors)
    long = np.linalg.norm(vectors[1])
    struts += f"""<body pos="{at}" zaxis="{along}"><joint axis="1 0 0"/><joint axis="0 1 0"/>
      {rod} 0.025"/><body><joint name="strut{k}" type="slide" stiffness="2e7" damping="20"/>
      {rod} {long - 0.025}"/><site name="head{k}" pos="0 0 {long}"/></body></body>"""
    balls += f'<geom size="0.001" density="1000" pos="{on}"/><site name="ball{k}" pos="{on}"/>'
    loops += f'<connect site1="ball{k}" site2="head{k}"/>'
    motors += f'<motor joint="strut{k}"/>'
mjcf = f"""<mujoco><option gravity="0 0 0"><flag contact="disable"/></option><worldbody>{struts}
  <body pos="0 0 0.09"><freejoint/>
  <geom type="cylinder" size="0.1 0.005" pos="0 0 -0.005" mass="1"/>
  <site name="B" pos="0 0 0.045"/>{balls}</body></worldbody>
  <equality>{loops}</equality><actuator>{motors}</actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(mjcf)
data = mujoco.MjData(model)
modes = np.linalg.eigvals(sim.linearize(model, data, "B", axes=None).A)
modes = sorted(modes[modes.imag > 0], key=abs)
jac = jacobians(model, data, site="B")
kin = ConstrainedSystem.of(jac).kinematics()  # rotation and translation of B by the struts
need = kin.velocity_mapping(range(6)).major * [30, 30, 0, 50, 50, 50]  # [um] of each strut
upright = ConstrainedSystem(jac.J_T[3:], np.vstack([jac.J_C, jac.J_T[:3]]), jac.active)
