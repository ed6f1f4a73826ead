"""Inverse kinematics, two arms: the load stays on its circle when a joint locks
=============================================================================

Two arms of six joints carry one load along a circle, in closed loops. After 3 s a joint locks, and
five of six motions remain: the position stays exact, and the load tilts as little as possible.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model, load = fjh.load_model(fjh.MODELS / "arms.xml"), fjh.sim.Body("load")
home, dt = fjh.assemble(model), 0.01
start, tilt = fjh.pose_of(model, home, load), fjh.FrameTask(load, rows=[0, 1, 2])
place, tilt.target = fjh.FrameTask(load, rows=[3, 4, 5]), start
healthy = fjh.Ik(model, [place, tilt], fjh.Limits(velocity=1.0))
time = np.arange(0.0, 6.0, dt)
path = start.translation_m + 0.03 * np.c_[0 * time, np.sin(2 * time), 1 - np.cos(2 * time)]


def errors(after):
    """Return the load's distance from its circle [mm] and its tilt [°] at each tick."""
    data, error = home, []
    for t, place.target in zip(time, path, strict=True):
        ik = after if t >= 3.0 else healthy
        data = ik.advance(data, ik.step(data, dt), dt)
        error.append([np.linalg.norm(task.on(model).error(model, data)) for task in (place, tilt)])
    return np.array(error).T * [[1e3], [180 / np.pi]]


figure, axes = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
for joint, style in {"no": "k:", "joint2": "C0-", "joint10": "C1-"}.items():
    off, tilted = errors(healthy if joint == "no" else healthy.with_failures(locked=[joint]))
    axes.plot(time, tilted, style, label=f"{joint} lock")
    print(f"{joint} lock: {off.max():.3f} mm off its circle, {tilted.max():.1f}° tilted")
axes.set(xlabel="time [s]", title="A joint locks after 3 s: tilt of the load [°]")
axes.legend()
plt.savefig("ik_two_arms.png")
