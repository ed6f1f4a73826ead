"""Inverse kinematics, a quadruped: the feet stay on target when a hip locks
=========================================================================

The trunk has no motor of its own. Three feet stand and the fourth steps; with lower priority
the trunk sways. After 3 s the right rear hip locks. If this is known, all feet stay on target.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model(fjh.MODELS / "quadruped.xml")
legs = "front_left", "front_right", "rear_left", "rear_right"
home, dt, time = fjh.assemble(model), 0.01, np.arange(0.0, 6.0, 0.01)
feet = [fjh.FrameTask(leg, rows=[3, 4, 5], target=home.site(leg).xpos) for leg in legs]
trunk, posture = fjh.FrameTask("trunk", rows=[3, 4, 5]), fjh.PostureTask(target=home.qpos)
healthy = fjh.Ik(model, [feet[1:], feet[0], trunk, posture], active=["root"])
path = home.site("trunk").xpos + 0.03 * np.c_[np.sin(2 * time), np.cos(2 * time) - 1, 0 * time]


def errors(after, robot_after):
    """Yield the largest distance of a foot from its target at each tick [mm]."""
    data = home
    for t, trunk.target in zip(time, path, strict=True):
        feet[0].target = home.site(legs[0]).xpos + 0.05 * np.sin(t) * np.array([1, 0, np.sin(t)])
        ik, robot = (after, robot_after) if t >= 3.0 else (healthy, healthy)
        data = robot.advance(data, ik.step(data, dt), dt)
        yield 1e3 * max(np.linalg.norm(foot.on(model).error(model, data)) for foot in feet)


failed = healthy.with_failures(locked=["rear_right_hip"])
runs = {"healthy": (healthy, healthy), "known": (failed, failed), "unknown": (healthy, failed)}
figure, axes = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
for (name, run), style in zip(runs.items(), ["k:", "C0-", "C3-"], strict=True):
    axes.semilogy(time, error := [*errors(*run)], style, label=name)
    print(f"{name}: feet within {max(error):.3f} mm")
axes.set(xlabel="time [s]", title="The right rear hip locks after 3 s: feet off their places [mm]")
axes.legend()
plt.savefig("ik_quadruped.png")
