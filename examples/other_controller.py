"""Your controller: how does it do on the same robot?
==================================================

A controller is an object whose start() gives its first state, and step(...) the next one, with the
inputs of the drives. This one is an integrator behind a pseudo-inverse; strut 1 locks at 1 s.
"""

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np

import fjh

rig = fjh.Rig.hexapod()
gain = 2 * np.pi * 5.0 * rig.period_s * np.linalg.pinv(rig.task.major_jacobian)  # 5 Hz
zero = SimpleNamespace(inputs=np.zeros(6), integral=np.zeros(2))


def step(state, reference, measurement):
    integral = state.integral + reference - measurement.output
    inputs = rig.task.drives.inputs(gain @ integral)
    return SimpleNamespace(inputs=inputs, integral=integral)


pilots = {"mine": SimpleNamespace(start=lambda: zero, step=step), "supervisor": rig.supervisor()}
path, lock = rig.path("circle", duration_s=3.0, turn_s=2.0), fjh.Failure("coil1", "locked", 1.0)
plt.style.use("seaborn-v0_8-whitegrid")
figure, axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
said = []
for (name, pilot), color in zip(pilots.items(), ["tab:red", "tab:blue"], strict=True):
    run = rig.fly(pilot, path, failures=[lock])
    error = 1e6 * np.linalg.norm(run.desired - run.true, axis=1)
    said.append(f"{name} {np.sqrt(np.mean(error[1500:] ** 2)):.1f} µrad")
    print(f"{said[-1]} RMS from 1.5 s on. {run.status}")
    axes.plot(run.time_s, error, color=color)
axes.set(xlabel="time [s]", ylabel="pointing error [µrad]", ylim=(0, None))
axes.legend(pilots, loc="lower right", frameon=True)
figure.suptitle("Strut 1 locks at 1 s; error: " + ", ".join(said))
plt.savefig("other_controller.png")
