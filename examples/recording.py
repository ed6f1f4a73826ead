"""Recording: how do I keep a flight and look at it?
=================================================

All signals go into an .npz file, and the motion into a recording in which the viewer Rerun moves
the arm (`rerun recording.rrd`). The same functions draw it on paper, with the path of its beam.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fjh
from fjh.experiments.recording.drawing import View, draw_machine, machine
from fjh.experiments.recording.file import RecordingInfo
from fjh.experiments.recording.mechanism import Driven, motion_of, write_mechanism
from fjh.experiments.recording.views import Plot

rig = fjh.Rig.of_mjcf(fjh.MODELS / "arm.xml", axes="base", major=[0, 1], size=0.1)
run = rig.fly(rig.controller(), rig.path("circle", duration_s=2.5, turn_s=2.0))
error = 1e3 * (run.desired - run.true)
plot = Plot("error", "Desired - true", ["about x [mrad]", "about y [mrad]"], run.time_s, error)
notes = RecordingInfo("arm-seed0", "arm", "# A circle of the arm's beam", {"seed": 0})
flight = Driven(run.time_s, run.qpos, [plot], nominal=run.qpos[0])
np.savez("recording.npz", **run.arrays)
write_mechanism(Path("recording.rrd"), notes, rig.model, {"arm": flight})
for name in ("recording.npz", "recording.rrd"):
    print(f"{name}: {Path(name).stat().st_size / 1e3:.0f} kB, {len(run.time_s)} ticks of 1 ms")
motion, solids, view = motion_of(rig.model, run.qpos), machine(rig.model), View(-60.0, 20.0)
camera = rig.model.body("camera").id
beam_m = motion.position_m[:, camera] + motion.rotation[:, camera] @ [0, 0, 0.9]
plt.style.use(["default", "seaborn-v0_8-white"])
figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
draw_machine(axes, solids, solids.placed(motion, 0), view)
axes.plot(*view.on_paper(beam_m).T, color="tab:blue", zorder=3, label="path of the beam's end")
axes.set(aspect="equal", xticks=[], yticks=[])
axes.legend(loc="lower right", frameon=True)
rms = np.sqrt((error**2).sum(axis=1).mean())
figure.suptitle(f"A recorded flight, drawn again: the camera is off by {rms:.2f} mrad RMS")
plt.savefig("recording.png")
