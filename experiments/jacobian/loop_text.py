"""The closed-loop study of the Jacobian in one paragraph."""

from typing import Any

from experiments.jacobian.loop import GROWN

_QUANTITIES = {
    "pointing_rms_urad": "pointing",
    "gamma_rms_urad": "gamma",
    "translation_rms_um": "translation",
    "strut_input_rms_percent": "strut inputs",
}


def loop_paragraph(loop: dict[str, Any]) -> str:
    """What a reader could cite, from `summarize_loop`'s numbers."""
    first, last = loop["growth"][0], loop["growth"][-1]
    extra = {name: one["extra_percent"] for name, one in last["variants"].items()}
    pointing = {name: one["pointing_cost_percent"] for name, one in last["variants"].items()}
    sentences = [
        f"Tracking {loop['duration_s']:g} s of the spiral with strut 1 locked ({GROWN}, seed "
        f"{loop['seed']}) visits e = {first['e_visited']['frobenius']:.1e} of the "
        f"{first['e_box']['frobenius']:.1e} that the stroke allows (Frobenius). "
        f"{_beside_the_noise(loop)}",
        f"With spiral and stroke grown, geometry puts a constant Jacobian off the optimum of the "
        f"secondary goal by {_per_e(loop, 'static_extra_percent')} e and off the loop gain by "
        f"{_per_e(loop, 'loop_gain_error_percent')} e, e being eq. (40) over the lengths that are "
        f"visited: {_where(loop)}. In the runs it shows once it "
        f"passes the floor of {first['variants']['constant']['extra_percent']:.1f} % that "
        f"converters, detector noise and dynamics keep from the optimum.",
        f"At a spiral {last['spiral_factor']:g} times as large the secondary goal is off by "
        f"{extra['constant']:.0f} % with the constant Jacobian, and by {extra['analytic']:.0f} % "
        f"with that of the present pose on absolute displacements, which is no remedy: it counts "
        f"twice the curvature that the other leaves out. It is off by {extra['incremental']:.0f} % "
        f"with increments, which drift with the area that is encircled, and by "
        f"{extra['relinearized']:.1f} % with one Gauss-Newton step a tick from the estimated pose.",
        f"Pointing RMS, relative to the Jacobian of the present pose on absolute displacements, "
        f"then changes by {pointing['constant']:+.1f} % (constant), {pointing['incremental']:+.1f} "
        f"% (increments) and {pointing['relinearized']:+.1f} % (Gauss-Newton).",
    ]
    if loop["duration_s"] < loop["spiral_duration_s"]:
        sentences.insert(0, "Part of the spiral only, not to be compared with the whole.")
    return " ".join(sentences)


def _beside_the_noise(loop: dict[str, Any]) -> str:
    """Which changes another noise seed would hide, at nominal size."""
    return (
        f"There, against the Jacobian of every tick, a constant one changes "
        f"{_by_more(loop, 'constant')} than another noise seed does, and increments change "
        f"{_by_more(loop, 'incremental')}."
    )


def _by_more(loop: dict[str, Any], variant: str) -> str:
    above = [
        f"{words} of {one['column']}"
        for what, words in _QUANTITIES.items()
        for one in loop["nominal"]
        if not one["variants"][variant][what] < one["noise"][what]
    ]
    return f"{', '.join(above) or 'nothing'} by more"


def _per_e(loop: dict[str, Any], cost: str) -> str:
    """Smallest and largest ratio of a cost to e of the visited set."""
    ratios = [one[cost] / (100 * one["e_visited"]["frobenius"]) for one in loop["growth"]]
    return f"{min(ratios):.1f} to {max(ratios):.1f}"


def _where(loop: dict[str, Any]) -> str:
    words = {"static_extra_percent": "goal", "loop_gain_error_percent": "loop gain"}
    return ", ".join(
        f"{cost['percent']:g} % of the {words[cost['cost']]} at e = "
        f"{cost['e_visited_frobenius']:.1e} (spiral x{cost['spiral_factor']:.0f})"
        for cost in loop["costs"]
    )
