"""Inverse kinematics, an arm: the tool stays on its path when a joint locks
=========================================================================

A tool follows a circle exactly; within their ranges and 1 rad/s, the joints stay as close to a
posture as possible. After 3 s the third joint locks. If this is known, other joints replace it.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model(fjh.MODELS / "arm.xml")
home, dt = fjh.assemble(model), 0.01
start, tool = fjh.pose_of(model, home, "payload"), fjh.FrameTask("payload")
healthy = fjh.Ik(model, [tool, fjh.PostureTask(target=home.qpos)], fjh.Limits(velocity=1.0))
time = np.arange(0.0, 6.0, dt)
path = start.translation_m + 0.1 * np.c_[0 * time, np.sin(2 * time), 1 - np.cos(2 * time)]


def errors(after, robot_after):
    """Yield the distance of the tool from its circle at each tick [mm]."""
    data = home
    for t, point in zip(time, path, strict=True):
        tool.target = fjh.Pose(start.rotation, point)
        ik, robot = (after, robot_after) if t >= 3.0 else (healthy, healthy)
        data = robot.advance(data, ik.step(data, dt), dt)
        yield 1e3 * np.linalg.norm(point - data.site("payload").xpos)


failed = healthy.with_failures(locked=["joint3"])
runs = {"healthy": (healthy, healthy), "known": (failed, failed), "unknown": (healthy, failed)}
figure, axes = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
for (name, run), style in zip(runs.items(), ["k:", "C0-", "C3-"], strict=True):
    axes.semilogy(time, error := [*errors(*run)], style, label=name)
    print(f"{name}: within {max(error):.3f} mm of the circle")
axes.set(xlabel="time [s]", title="Joint 3 locks after 3 s: tool off its circle [mm]")
axes.legend()
plt.savefig("ik_arm.png")
