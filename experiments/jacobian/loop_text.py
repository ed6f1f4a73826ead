"""The closed-loop study of the Jacobian in one paragraph."""

from typing import Any

from experiments.jacobian.loop import GROWN


def loop_paragraph(loop: dict[str, Any]) -> str:
    """What a reader could cite, from `summarize_loop`'s numbers."""
    first, last = loop["growth"][0], loop["growth"][-1]
    extra = {name: one["extra_percent"] for name, one in last["variants"].items()}
    per_e = first["static_extra_percent"] / (100 * first["e_visited"]["frobenius"])
    gain_per_e = first["loop_gain_error_percent"] / (100 * first["e_visited"]["frobenius"])
    pointing = max(abs(g["variants"]["constant"]["pointing_cost_percent"]) for g in loop["growth"])
    (drift,) = (
        one["variants"]["incremental"]["gamma_rms_urad"] / one["noise"]["gamma_rms_urad"]
        for one in loop["nominal"]
        if one["column"] == GROWN
    )
    sentences = [
        f"Tracking the spiral with strut 1 locked ({GROWN}) visits e = "
        f"{first['e_visited']['frobenius']:.1e} of the {first['e_box']['frobenius']:.1e} that the "
        f"stroke allows (Frobenius). {_beside_the_noise(loop)}",
        f"With spiral and stroke grown, a constant Jacobian is off the optimum of the secondary "
        f"goal by {per_e:.1f} e and off the loop gain by {gain_per_e:.1f} e, e being eq. (40) over "
        f"the lengths that are visited: {_where(loop)}.",
        f"Pointing itself, which the detector closes, changes by no more than {pointing:.1f} % up "
        f"to a spiral {last['spiral_factor']:g} times as large.",
        f"There the secondary goal is off by {extra['constant']:.0f} % with the constant Jacobian, "
        f"by {extra['analytic']:.0f} % with that of the present pose on absolute displacements, "
        f"which counts the curvature twice instead of not at all, by {extra['incremental']:.0f} % "
        f"with increments, which drift with the area that is encircled (at nominal size gamma by "
        f"{drift:.1f} times what another noise seed changes), and by {extra['relinearized']:.1f} % "
        f"with one Gauss-Newton step a tick from the estimated pose.",
    ]
    return " ".join(sentences)


def _beside_the_noise(loop: dict[str, Any]) -> str:
    above = [
        f"{what} of {one['column']}"
        for one in loop["nominal"]
        for what, noise in one["noise"].items()
        if not one["variants"]["constant"][what] < noise
    ]
    if above:
        return f"There a constant Jacobian shows above the noise in {', '.join(above)}."
    return (
        "There a constant Jacobian changes pointing RMS, secondary motion and strut inputs by less "
        "than another seed of the detector noise does."
    )


def _where(loop: dict[str, Any]) -> str:
    words = {"static_extra_percent": "goal", "loop_gain_error_percent": "loop gain"}
    return ", ".join(
        f"{cost['percent']:g} % of the {words[cost['cost']]} at e = "
        f"{cost['e_visited_frobenius']:.1e} (spiral x{cost['spiral_factor']:.0f})"
        for cost in loop["costs"]
    )
