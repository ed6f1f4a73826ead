"""Inverse kinematics, a mobile base: others take over when a drive blocks
=======================================================================

The tool of an arm draws an arc and looks at one point. Its base moves no more than it must, and
the forearm keeps 10 cm from it. After 3 s the sideways drive blocks: who is told uses the rest.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model(fjh.MODELS / "mobile.xml")
home, dt, time = fjh.assemble(model), 0.01, np.arange(0.0, 6.0, 0.01)
tool = fjh.FrameTask("tool", rows=[3, 4, 5])
gaze = fjh.LookAtTask("tool", [0, 0, 1], target=[1.8, 0.0, 0.68])
base = fjh.DampingTask(joints=["drive_x", "drive_y", "turn"])
near = fjh.Distances(model, [([fjh.sim.Body("forearm")], ["base"])], margin_m=0.1, detection_m=0.3)
sound = fjh.Ik(model, [tool, gaze, base], fjh.Limits(velocity=1.5, distances=near))
path = home.site("tool").xpos + np.c_[0.3 * (np.cos(time) - 1), 0.5 * np.sin(time), 0 * time]


def missed(after, machine):
    """How far the tool is off its arc at each tick [mm]."""
    data = home
    for t, tool.target in zip(time, path, strict=True):
        ik, robot = (after, machine) if t >= 3.0 else (sound, sound)
        data = robot.advance(data, ik.step(data, dt), dt)
        yield 1e3 * np.linalg.norm(tool.target - data.site("tool").xpos)


failed = sound.with_failures(locked=["drive_y"])
runs = {"no failure": (sound, sound), "locked, told": (failed, failed), "not told": (sound, failed)}
figure, axes = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
for (name, run), style in zip(runs.items(), ["k:", "C0-", "C3-"], strict=True):
    axes.semilogy(time, error := [*missed(*run)], style, label=name)
    print(f"{name}: within {max(error):.2f} mm of the arc")
axes.set(xlabel="time [s]", title="A drive blocks after 3 s: tool off its arc [mm]")
axes.legend()
plt.savefig("ik_mobile.png")
