"""When the numbers of `fjh recover` may be believed, and its goals are met."""

from typing import Any

from experiments.hexapod.checks import CLOSURE_LIMIT_M

ISOLATION = 0.99
OVER_ORACLE = 1.10
FALSE_ALARMS_PER_HOUR = 0.1
ENOUGH_H = 30.0


def complaint(summary: dict[str, Any]) -> str | None:
    """One sentence on what is wrong; None when nothing is."""
    opened = summary["closure_residual_max_m"]
    if not opened < CLOSURE_LIMIT_M:
        return f"a closed loop opened by {opened:.1e} m, more than {CLOSURE_LIMIT_M:.0e} m"
    if summary["beliefs"]["unstable"]:
        return (
            f"the loop is unstable when {summary['beliefs']['worst_truth']} is the truth and "
            f"{summary['beliefs']['worst_belief']} is believed"
        )
    for what in ("strut_as_first_named", "strut_and_kind_in_the_end"):
        rate = summary["isolation"][what]["rate"]
        if rate is None:
            return f"no failure is separated enough to be counted: {what.replace('_', ' ')}"
        if rate < ISOLATION:
            return (
                f"only {100 * rate:.1f} % of the failures are isolated ({what.replace('_', ' ')})"
            )
    for which, ratio in summary["after_over_oracle"].items():
        if not ratio < OVER_ORACLE:
            return f"after recovery the RMS is {ratio:.2f} times that of an oracle, {which}"
    if summary["second_failure"]["all_right"]["rate"] < ISOLATION:
        return "of two failures in a flight, not all were found"
    for name, flight in summary["shown"].items():
        if not flight["right"]:
            return f"in the flight {name} not all was found, or the loss of the task mistaken"
    alarms = summary["false_alarms"]
    for what in ("flown", "with_fresh_noise"):
        counted = alarms[what]
        # In less than ENOUGH_H even no alarm at all could not show it.
        bound = "high_per_hour_95" if counted["hours"] >= ENOUGH_H else "low_per_hour_95"
        if not counted[bound] < FALSE_ALARMS_PER_HOUR:
            return (
                f"{counted['alarms']} false alarms in {counted['hours']:.2f} h "
                f"({what.replace('_', ' ')}) do not stay below {FALSE_ALARMS_PER_HOUR} per hour"
            )
    return None
