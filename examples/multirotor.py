"""Multirotor: can a hexarotor be controlled without one rotor?
============================================================

Six thrusts between zero and a maximum produce lift and three torques. The directions of rotation
alternate (PNPNPN) or not (PPNNPN). A vehicle can be controlled at hover if every small torque is
possible there (Du, Quan, Yang, Cai; J. Guidance, Control, and Dynamics 38, 2015).
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh

WEIGHT, MOST, ARM, DRAG = 15.043, 6.125, 0.275, 0.1  # of the paper: [N], [N], [m], [m]
place, angle = np.deg2rad(60 * np.arange(6)), np.deg2rad(np.arange(0, 361, 3))
ring = 10 * np.column_stack([0 * angle, np.cos(angle), 0 * angle, np.sin(angle)])  # [N m]
rows, torques, possible = [0, 1, 2, 3], {}, {}  # lift [N]; roll, pitch, yaw [N m]
for name, turns in {"PNPNPN": (1, -1, 1, -1, 1, -1), "PPNNPN": (1, 1, -1, -1, 1, -1)}.items():
    B = [np.ones(6), ARM * np.sin(place), -ARM * np.cos(place), DRAG * np.array(turns)]
    for lost in ([], [0]):
        kin = fjh.ConstrainedSystem(B, None, range(6)).with_failures(locked=lost).kinematics()
        hover = kin.velocity_mapping(rows, rate_limits=(0.0, MOST))([WEIGHT, 0, 0, 0])
        box = -hover, MOST - hover  # limits of the thrusts about hover
        part = kin.velocity_mapping(rows, rate_limits=box, when_limited="scaled").solve(ring).scale
        torques[name, len(lost)] = part[:, None] * ring[:, [1, 3]]
        possible[name] = "can" if kin.attainable(rows, rate_limits=box).radius > 0 else "cannot"
        print(f"{name}, {len(lost)} of 6 rotors lost: {possible[name]} be controlled,", end=" ")
        print(f"{10 * part.min():.2f} N m of roll and yaw")

plt.style.use("seaborn-v0_8-whitegrid")
figure, panels = plt.subplots(1, 2, figsize=(6.4, 3.4), layout="constrained", sharey=True)
for ((name, lost), points), k in zip(torques.items(), [0, 0, 1, 1], strict=True):
    panels[k].fill(*points.T, color=["tab:gray", "tab:blue"][lost], alpha=0.4, linewidth=2)
    panels[k].set(title=name, xlabel="roll torque [N m]", xlim=(-1.8, 1.8))
    panels[k].plot(0, 0, "k+", markersize=10)  # hover
panels[0].set(ylabel="yaw torque [N m]")
panels[1].legend(["six rotors", "hover", "rotor 1 lost"], frameon=True, loc="lower right")
text = ", ".join(f"{name} {word}" for name, word in possible.items())
figure.suptitle(f"One rotor lost: {text} be controlled at hover")
plt.savefig("multirotor.png")
