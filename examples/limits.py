"""Limits: how fast can the arm turn its camera?
=============================================

Rates of minimum norm soon exceed a motor's limit. They can be clipped, or scaled together. A
mapping with limits uses the motors that are below their limits, and is exact at higher speeds.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

model = fjh.load_model(fjh.MODELS / "arm.xml")
jacobians = fjh.jacobians(model, fjh.assemble(model), site="payload", axes="base")
kin = fjh.ConstrainedSystem.of(jacobians).kinematics()
limits = (-1.0, 1.0)  # of every motor [rad/s]
speed = np.linspace(0.0, 5.0, 501)
demand = np.outer(speed, [0.6, 0.8])  # about x and y [rad/s]
least_norm = kin.velocity_mapping(major=[0, 1])(demand)
too_fast = np.maximum(1.0, np.abs(least_norm).max(axis=1, keepdims=True))
rates = {
    "clipped": np.clip(least_norm, *limits),
    "scaled down": least_norm / too_fast,
    "limits in the mapping": kin.velocity_mapping(major=[0, 1], rate_limits=limits)(demand),
}
missed = {name: np.linalg.norm(r @ kin.J[:2].T - demand, axis=1) for name, r in rates.items()}
exact = {name: speed[error < 1e-9].max() for name, error in missed.items()}
for name, value in exact.items():
    print(f"{name}: exact up to {value:.2f} rad/s")

plt.style.use("seaborn-v0_8-whitegrid")
figure, axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
styles = [("tab:red", "-"), ("tab:orange", "--"), ("tab:blue", "-")]
for (name, error), (color, line) in zip(missed.items(), styles, strict=True):
    axes.plot(speed, error, line, color=color, label=name, linewidth=2)
axes.set(xlabel="demanded speed [rad/s]", ylabel="speed missed [rad/s]", xlim=(0, 5))
axes.legend(frameon=True)
clipped, _, most = exact.values()
figure.suptitle(f"Limits in the mapping: exact up to {most:.1f} rad/s, clipped up to {clipped:.1f}")
plt.savefig("limits.png")
