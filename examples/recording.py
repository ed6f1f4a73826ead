"""Recording: how do I save and view a run?
========================================

One call writes two files: an .npz with all signals at every tick, and a recording for the viewer
Rerun (`rerun recording.rrd`) that shows the arm with its failed motor marked, next to its signals.
`fjh review` shows several runs side by side.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fjh
from fjh.recording.properties import properties_of  # pyright: ignore[reportMissingImports]

task = {"axes": "base", "major": [0, 1], "size": 0.1}  # [rad]
rig = fjh.Rig.of_mjcf(fjh.MODELS / "arm.xml", **task)
lock = fjh.Failure("motor2", "locked", 1.0)
run = rig.fly(rig.controller(), rig.path("circle", duration_s=2.5, turn_s=2.0), failures=[lock])
fjh.record("recording.rrd", rig, run)
for name in ("recording.npz", "recording.rrd"):
    print(f"{name}: {Path(name).stat().st_size / 1e3:.0f} kB, {len(run.time_s)} ticks of 1 ms")
text = "{failures}: {rms_before_rad:.1g} rad RMS before, {rms_after_rad:.1g} after"
print(text.format(**properties_of(Path("recording.rrd"))))

with np.load("recording.npz") as data:
    time_s, moved, error = data["time_s"], data["displacement"], data["desired"] - data["true"]
plt.style.use("seaborn-v0_8-whitegrid")
figure, (above, below) = plt.subplots(2, figsize=(6.4, 3.8), layout="constrained", sharex=True)
above.plot(time_s, moved, color="tab:gray", linewidth=1)
above.plot(time_s, moved[:, rig.number("motor2")], color="tab:red", label="motor2")
above.set(ylabel="joints [rad]")
above.legend(loc="upper left")
below.plot(time_s, 1e3 * np.linalg.norm(error, axis=1), color="tab:blue")
below.set(xlabel="time [s]", ylabel="error [mrad]", ylim=(0, None))
above.axvline(lock.time_s, color="black", linestyle=":")
most = 1e3 * np.linalg.norm(error, axis=1).max()
figure.suptitle(f"A saved run: motor2 locks at 1 s, the camera is off by {most:.0f} mrad")
plt.savefig("recording.png")
