"""Survey: what can an arm still do after each failure?
=====================================================

A joint may lock where it stands, or swing freely. What speed of the tool is left in the worst
direction? `fjh survey arm.xml` says more: forces, gains, lost secondary motion, other postures,
which failures sensors tell apart, as one page and a recording.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh
from fjh.rig import conditions  # pyright: ignore[reportMissingImports]
from fjh.rig.condition_analysis import analyze_conditions  # pyright: ignore[reportMissingImports]

model = fjh.load_model(fjh.MODELS / "arm.xml")
system = fjh.ConstrainedSystem.of(fjh.jacobians(model, fjh.assemble(model), site="payload"))
n, names = 7, [model.actuator(k).name for k in range(7)]
codes = conditions.few_failures(n)  # none, then each one, then each two: locked and free
found = analyze_conditions(
    system, [3, 4, 5], codes, rates=(-np.ones(n), np.ones(n))
)  # x, y, z; 1 rad/s
locked, free = found.singles.T
for kind, rows in (("locked", locked), ("free", free)):
    kept = [names[k] for k in range(n) if found.survived[rows[k]]]
    print(f"The tool still moves in x, y, z with any of {len(kept)} joints {kind}")
worst = min(locked, key=lambda row: found.speed_left[row])
said = f"{conditions.condition_text(codes[worst], names)}: {100 * found.speed_left[worst]:.0f} %"
print(f"Least speed left after one lock, {said}")

pairs = np.diag(found.speed_left[locked])
for row in np.flatnonzero((codes == conditions.LOCKED).sum(axis=1) == 2):
    i, j = np.flatnonzero(codes[row])
    pairs[i, j] = pairs[j, i] = found.speed_left[row]
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
picture = axes.imshow(100 * pairs, cmap="viridis", vmin=0, vmax=100)
axes.set(xticks=range(n), yticks=range(n), xlabel="motor locked", ylabel="and motor locked")
axes.set(xticklabels=range(1, n + 1), yticklabels=range(1, n + 1))
figure.colorbar(picture, label="speed left in the worst direction [%]")
figure.suptitle(f"Two locks; after one alone (diagonal) least is left with {said}")
plt.savefig("survey.png")
