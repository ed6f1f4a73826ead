"""A strut locks: what can the hexapod still do, and how?
======================================================

The task is to point (alpha, beta). Is that possible with strut 1 locked, and which struts move?
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model()  # the hexapod
jacobians = fjh.jacobians(model, fjh.assemble(model), site="payload", axes="base")
system = fjh.ConstrainedSystem.of(jacobians)
healthy = system.kinematics()
failed = system.with_failures(locked=["coil1"]).kinematics()
print("Strut 1 locked:", str(failed.manipulability(major=[0, 1])).splitlines()[0])
angle = np.linspace(0.0, 2 * np.pi, 181)
circle = np.column_stack([np.cos(angle), np.sin(angle)])  # desired pointing [mrad]
before = healthy.velocity_mapping(major=[0, 1])(circle)  # displacements of six struts [mm]
after = failed.expand(failed.velocity_mapping(major=[0, 1])(circle))
motions = {"not remapped": before * [0, 1, 1, 1, 1, 1], "remapped": after}  # strut 1: 0
reached = {name: motion @ healthy.J[:2].T for name, motion in motions.items()}
worst = {name: np.linalg.norm(v - circle, axis=1).max() for name, v in reached.items()}
for name, value in worst.items():
    print(f"{name}: off by {value:.3f} mrad at most, on a circle of 1 mrad")

plt.style.use("seaborn-v0_8-whitegrid")
figure, (plane, struts) = plt.subplots(1, 2, figsize=(6.4, 3.4), layout="constrained")
for (name, points), color in zip(reached.items(), ["tab:red", "tab:blue"], strict=True):
    plane.plot(*points.T, color=color, label=name)
plane.plot(*circle.T, "--", color="black", label="desired")
plane.set(xlabel="alpha [mrad]", ylabel="beta [mrad]", aspect="equal")
plane.legend(loc="center", frameon=True)
for shift, motion, color in [(-0.2, before, "tab:gray"), (0.2, after, "tab:blue")]:
    struts.bar(np.arange(1, 7) + shift, abs(motion).max(axis=0), 0.4, color=color)
struts.legend(["before", "remapped"], ncols=2, loc="upper center", frameon=True)
struts.set(xlabel="strut", ylabel="largest displacement [mm]", ylim=(0, 0.3), xticks=range(1, 7))
figure.suptitle(f"Strut 1 locked: exact if remapped, {worst['not remapped']:.0%} off if not")
plt.savefig("hexapod_lock.png")
