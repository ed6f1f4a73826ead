"""Three levels: which goals does a robot lose first?
==================================================

An arm turns its camera, moves it, and raises its elbow, in this order, while joint by joint locks.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model(fjh.MODELS / "arm.xml")
frames = ["payload", fjh.sim.Body("link4")]  # camera, elbow: six task rows each
jacobians = fjh.jacobians(model, fjh.assemble(model), site=frames, axes="base")
system = fjh.ConstrainedSystem.of(jacobians)
goals = {
    "1. turn camera": (fjh.Task([0, 1]), [0.3, 0.2]),  # [rad/s]
    "2. move camera": (fjh.Task([3, 4, 5]), [0.1, 0.0, 0.1]),  # [m/s]
    "3. raise elbow": (fjh.Task([9]), [-0.1]),  # [m/s], x points down
}
levels, targets = zip(*goals.values(), strict=True)
order = [f"motor{k}" for k in (7, 5, 3, 1, 2, 4, 6)]
exact = np.zeros((len(goals), len(order) + 1), dtype=bool)
for count in range(len(order) + 1):
    kin = system.with_failures(locked=order[:count]).kinematics()
    residuals = kin.hierarchy(levels).solve(targets).residuals
    exact[:, count] = [np.linalg.norm(residual) < 1e-9 for residual in residuals]
for name, row in zip(goals, exact, strict=True):
    print(f"{name}: exact with up to {row.sum() - 1} joints locked")

plt.style.use("seaborn-v0_8-white")
figure, axes = plt.subplots(figsize=(6.4, 2.6), layout="constrained")
axes.pcolormesh(~exact, cmap="RdYlBu_r", vmin=-0.3, vmax=1.3, edgecolors="white", linewidth=4)
for goal, count in np.ndindex(*exact.shape):
    axes.text(count + 0.5, goal + 0.5, "exact" if exact[goal, count] else "lost", ha="center")
axes.set(yticks=np.arange(3) + 0.5, yticklabels=goals, ylim=(3, 0))
axes.set(xticks=np.arange(8) + 0.5, xticklabels=range(8), xlabel="joints locked")
most = exact[0].sum() - 1
figure.suptitle(f"Lower goals are lost first; the camera turns with {most} of 7 joints locked")
plt.savefig("hierarchy.png")
