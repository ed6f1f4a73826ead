"""Limits in the loop: priority, clipping, scaling and weights; a spiral and a long arm motion."""

from experiments.study.study import Study

STUDY = Study(
    name="limits",
    help="""Compare ways to keep actuators within their limits, in the loop.

    The hexapod follows a spiral beyond what stroke and coil current allow, without failure and with
    strut 1 stuck off centre. An arm with limited joints follows a long path, and a joint locks
    halfway. Strict priority is compared with scaling, clipping, a redistributed pseudo-inverse and
    one weighted problem; clipping with each of seven tracking times of the anti-windup, the problem
    with each of eight weights. 6 min on two cores (estimated), 20 s with --quick.

    Writes limits.json, the tables as limits.md, a figure, and the data of all runs (spirals.npz,
    arm.npz).

    Example: fjh limits --quick --out /tmp/limits
    """,
    runs="experiments.limits.runs:run_limits",
    results="experiments.limits.results:results",
    quick="One secondary goal, fewer strategies, faster spirals, a shorter path of the arm.",
)
