"""A strut locks: what can the hexapod still do, and how?
======================================================

Its task is to point (alpha, beta). Is that still possible with strut 1 locked, and with what moves?
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model()  # the hexapod
jacobians = fjh.jacobians(model, fjh.assemble(model), site="payload", axes="base")
system = fjh.ConstrainedSystem.of(jacobians)
sound = system.kinematics()
failed = system.with_failures(locked=["coil1"]).kinematics()
print("Strut 1 locked:", str(failed.manipulability(major=[0, 1])).splitlines()[0])
angle = np.linspace(0.0, 2 * np.pi, 181)
circle = np.column_stack([np.cos(angle), np.sin(angle)])  # desired pointing [mrad]
unaware = sound.velocity_mapping(major=[0, 1])(circle)  # displacements of six struts [mm]
aware = failed.expand(failed.velocity_mapping(major=[0, 1])(circle))
moves = {"unaware": unaware * [0, 1, 1, 1, 1, 1], "remapped": aware}  # strut 1 stands
reached = {name: move @ sound.J[:2].T for name, move in moves.items()}
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
for shift, move, color in [(-0.2, unaware, "tab:gray"), (0.2, aware, "tab:blue")]:
    struts.bar(np.arange(1, 7) + shift, abs(move).max(axis=0), 0.4, color=color)
struts.legend(["before", "remapped"], ncols=2, loc="upper center", frameon=True)
struts.set(xlabel="strut", ylabel="largest displacement [mm]", ylim=(0, 0.3), xticks=range(1, 7))
figure.suptitle(f"Strut 1 locks: remapped, five point exactly; unaware, {worst['unaware']:.0%} off")
plt.savefig("hexapod_lock.png")
