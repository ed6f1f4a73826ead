"""Inverse kinematics, a mobile base: other joints replace a blocked drive
=======================================================================

A tool follows an arc and points at a fixed point; the base moves little and avoids the forearm by
10 cm. After 3 s the sideways drive blocks. If this is known, the other joints replace it.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model(fjh.MODELS / "mobile.xml")
home, dt, time = fjh.assemble(model), 0.01, np.arange(0.0, 6.0, 0.01)
tool = fjh.FrameTask("tool", rows=[3, 4, 5])
look = fjh.LookAtTask("tool", [0, 0, 1], target=[1.8, 0.0, 0.68])
base = fjh.DampingTask(joints=["drive_x", "drive_y", "turn"])
near = fjh.Distances(model, [([fjh.sim.Body("forearm")], ["base"])], margin_m=0.1, detection_m=0.3)
healthy = fjh.Ik(model, [tool, look, base], fjh.Limits(velocity=1.5, distances=near))
path = home.site("tool").xpos + np.c_[0.3 * (np.cos(time) - 1), 0.5 * np.sin(time), 0 * time]


def errors(after, robot_after):
    """Yield the distance of the tool from its arc at each tick [mm]."""
    data = home
    for t, tool.target in zip(time, path, strict=True):
        ik, robot = (after, robot_after) if t >= 3.0 else (healthy, healthy)
        data = robot.advance(data, ik.step(data, dt), dt)
        yield 1e3 * np.linalg.norm(tool.target - data.site("tool").xpos)


failed = healthy.with_failures(locked=["drive_y"])
runs = {"healthy": (healthy, healthy), "known": (failed, failed), "unknown": (healthy, failed)}
figure, axes = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
for (name, run), style in zip(runs.items(), ["k:", "C0-", "C3-"], strict=True):
    axes.semilogy(time, error := [*errors(*run)], style, label=name)
    print(f"{name}: within {max(error):.2f} mm of the arc")
axes.set(xlabel="time [s]", title="A drive blocks after 3 s: tool off its arc [mm]")
axes.legend()
plt.savefig("ik_mobile.png")
