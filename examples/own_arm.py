"""Your robot: does it stay on its path when a joint locks?
========================================================

An arm points a camera along a circle; its elbow locks at 0.8 s, unannounced. The supervisor
identifies the failed motor and uses the others. For your robot change file, site and task rows.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

task = {"site": "payload", "axes": "base", "major": [0, 1], "size": 0.02, "noise": 2e-5}  # [rad]
rig = fjh.Rig.of_mjcf(fjh.MODELS / "arm.xml", **task)
path = rig.path("circle", duration_s=2.2, turn_s=2.0)
lock = fjh.Failure("motor4", "locked", 0.8)
controllers = {"controller": rig.controller(), "supervisor": rig.supervisor()}
runs = {name: rig.fly(each, path, failures=[lock]) for name, each in controllers.items()}
late = runs["controller"].time_s >= 1.3
error = {name: 1e3 * np.linalg.norm(run.desired - run.true, axis=1) for name, run in runs.items()}
rms = {name: np.sqrt(np.mean(values[late] ** 2)) for name, values in error.items()}
print(runs["supervisor"].status)
for name, value in rms.items():
    print(f"{name}: RMS error {value:.3f} mrad from 1.3 s on, on a circle of 20 mrad")

plt.style.use("seaborn-v0_8-whitegrid")
figure, (plane, time) = plt.subplots(1, 2, figsize=(6.4, 3.0), layout="constrained")
plane.plot(*(1e3 * path.T), "--", color="black", label="desired")
for (name, run), color in zip(runs.items(), ["tab:red", "tab:blue"], strict=True):
    plane.plot(*(1e3 * run.true.T), color=color, label=name)
    time.plot(run.time_s, error[name], color=color)
time.axvline(lock.time_s, color="black", linestyle=":")
plane.set(xlabel="rotation about x [mrad]", ylabel="rotation about y [mrad]", aspect="equal")
plane.legend(loc="center", frameon=True)
time.set(xlabel="time [s]", ylabel="pointing error [mrad]", title="elbow locks at 0.8 s")
delay, times = runs["supervisor"].diagnoses[0].time_s - 0.8, rms["controller"] / rms["supervisor"]
figure.suptitle(
    f"A lock, diagnosed after {1e3 * delay:.0f} ms: the error is {times:.0f} times smaller"
)
plt.savefig("own_arm.png")
