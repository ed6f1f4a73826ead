"""Inverse kinematics, a humanoid: the feet stay in place when a knee locks
========================================================================

Tasks in order: feet in place, centre of mass above them, right hand on a circle, posture. After 3 s
the left knee locks. If this is known, other joints move the trunk.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model(fjh.MODELS / "humanoid.xml")
home, dt, names = fjh.assemble(model), 0.01, ("left_foot", "right_foot")
feet = [fjh.FrameTask(name, target=fjh.pose_of(model, home, name)) for name in names]
balance = fjh.CenterOfMassTask(rows=[0, 1], target=home.subtree_com[0])
hand, posture = fjh.FrameTask("right_hand", rows=[3, 4, 5]), fjh.PostureTask(target=home.qpos)
healthy = fjh.Ik(model, [feet, balance, hand, posture], fjh.Limits(velocity=3.0), active=["root"])
time, at = np.arange(0.0, 6.0, dt), home.site("right_hand").xpos
path = at + 0.12 * np.c_[0 * time, np.sin(2 * time), 1 - np.cos(2 * time)]


def errors(after, robot_after):
    """Yield the largest distance of a foot from its place at each tick [mm]."""
    data = home
    for t, hand.target in zip(time, path, strict=True):
        ik, robot = (after, robot_after) if t >= 3.0 else (healthy, healthy)
        data = robot.advance(data, ik.step(data, dt), dt)
        yield 1e3 * max(np.linalg.norm(foot.on(model).error(model, data)[3:]) for foot in feet)


failed = healthy.with_failures(locked=["left_knee"])
runs = {"healthy": (healthy, healthy), "known": (failed, failed), "unknown": (healthy, failed)}
figure, axes = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
for (name, run), style in zip(runs.items(), ["k:", "C0-", "C3-"], strict=True):
    axes.semilogy(time, error := [*errors(*run)], style, label=name)
    print(f"{name}: feet within {max(error):.4f} mm of their places")
axes.set(xlabel="time [s]", title="The left knee locks after 3 s: feet off their places [mm]")
axes.legend()
plt.savefig("ik_humanoid.png")
