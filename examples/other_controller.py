"""Your controller: how does it perform on the same robot?
=======================================================

A controller is an object with start(), which returns its first state, and step(...), which returns
the next one with the drives' inputs. This one has an integrator. Strut 1 locks at 1 s.
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


mine = SimpleNamespace(start=lambda: zero, step=step)
controllers = {"mine": mine, "supervisor": rig.supervisor()}
path, lock = rig.path("circle", duration_s=3.0, turn_s=2.0), fjh.Failure("coil1", "locked", 1.0)
plt.style.use("seaborn-v0_8-whitegrid")
(figure, axes), labels = plt.subplots(figsize=(6.4, 3.4), layout="constrained"), []
for (name, controller), color in zip(controllers.items(), ["tab:red", "tab:blue"], strict=True):
    run = rig.fly(controller, path, failures=[lock])
    error = 1e6 * np.linalg.norm(run.desired - run.true, axis=1)
    labels.append(f"{name} {np.sqrt(np.mean(error[1500:] ** 2)):.1f} µrad")
    print(f"{labels[-1]} RMS from 1.5 s on. {run.status}")
    axes.plot(run.time_s, error, color=color)
axes.set(xlabel="time [s]", ylabel="pointing error [µrad]", ylim=(0, None))
axes.legend(controllers, loc="lower right", frameon=True)
figure.suptitle("Strut 1 locks at 1 s; error: " + ", ".join(labels))
plt.savefig("other_controller.png")
