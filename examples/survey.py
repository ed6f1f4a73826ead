"""Survey: what can an arm still do after each failure?
=====================================================

A joint may lock or swing freely. Which fraction of the tool's speed remains in the worst direction?
`fjh survey arm.xml` also computes forces, gains, lost secondary motion, other postures, and which
failures sensors distinguish, as a page and a recording.
"""

import matplotlib.pyplot as plt
import numpy as np

import fjh
from fjh.rig import conditions  # pyright: ignore[reportMissingImports]
from fjh.rig.condition_analysis import analyze_conditions  # pyright: ignore[reportMissingImports]

model = fjh.load_model(fjh.MODELS / "arm.xml")
system = fjh.ConstrainedSystem.of(fjh.jacobians(model, fjh.assemble(model), site="payload"))
n, names = 7, [model.actuator(k).name for k in range(7)]
codes = conditions.few_failures(n)  # no failure, all single and double ones
analysis = analyze_conditions(
    system, [3, 4, 5], codes, rates=(-np.ones(n), np.ones(n))
)  # x, y, z; 1 rad/s
locked, free = analysis.singles.T
for kind, rows in (("locked", locked), ("free", free)):
    surviving = [names[k] for k in range(n) if analysis.survived[rows[k]]]
    print(f"The tool still moves in x, y, z with any of {len(surviving)} joints {kind}")
worst = min(locked, key=lambda row: analysis.speed_left[row])
text = f"{conditions.condition_text(codes[worst], names)}: {100 * analysis.speed_left[worst]:.0f} %"
print(f"Least speed left after one lock, {text}")

pairs = np.diag(analysis.speed_left[locked])
for row in np.flatnonzero((codes == conditions.LOCKED).sum(axis=1) == 2):
    i, j = np.flatnonzero(codes[row])
    pairs[i, j] = pairs[j, i] = analysis.speed_left[row]
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
picture = axes.imshow(100 * pairs, cmap="viridis", vmin=0, vmax=100)
axes.set(xticks=range(n), yticks=range(n), xlabel="motor locked", ylabel="and motor locked")
axes.set(xticklabels=range(1, n + 1), yticklabels=range(1, n + 1))
figure.colorbar(picture, label="speed left in the worst direction [%]")
figure.suptitle(f"Two locks, and one alone (diagonal); least for {text}")
plt.savefig("survey.png")
