"""Force: which loads can a platform bear if one leg has no force?
===============================================================

A platform moves in a plane on four legs of 100 N each, one more than its three motions need. Leg 1
loses its force. Which forces can the other legs exert, without turning the platform?
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle

import fjh

model = fjh.load_model(fjh.MODELS / "platform.xml")
system = fjh.ConstrainedSystem.of(fjh.jacobians(model, fjh.assemble(model), site="payload"))
angle = np.deg2rad(np.arange(0, 361, 3))
ring = np.column_stack([0 * angle, np.cos(angle), np.sin(angle)])  # moment z, forces x and y
target = 1000.0 * ring  # [N m], [N]: beyond any limit
force = {}
for name, free in {"all four legs": [], "leg 1 without force": ["motor1"]}.items():
    kin = system.with_failures(free=free).kinematics()
    limits = {"torque_limits": (-100.0, 100.0), "when_limited": "scaled"}
    mapping = kin.force_mapping(major=[2, 3, 4], **limits)
    force[name] = 1000.0 * mapping.solve(target).scale[:, None] * ring[:, 1:]  # same directions
least = {name: np.linalg.norm(points, axis=1).min() for name, points in force.items()}
for name, value in least.items():
    print(f"{name}: {value:.0f} N in every direction")

plt.style.use("seaborn-v0_8-whitegrid")
figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
for (name, points), color in zip(force.items(), ["tab:gray", "tab:blue"], strict=True):
    axes.fill(*points.T, color=color, alpha=0.35, label=name)
    axes.add_patch(Circle((0, 0), least[name], fill=False, color=color, linestyle="--"))
axes.set(xlabel="force along x [N]", ylabel="force along y [N]", aspect="equal")
axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
few, many = least["leg 1 without force"], least["all four legs"]
figure.suptitle(
    f"Without leg 1 the platform bears {few:.0f} N in every direction, {many:.0f} N before"
)
plt.savefig("force.png")
