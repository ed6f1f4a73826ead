"""Sampled pointing loops whose demanded pointing is limited, many settings at once."""

from collections.abc import Sequence

import control
import numpy as np

from sim import Array


def limited_response(
    plant: control.StateSpace,
    compensators: Sequence[control.StateSpace],
    reference: Array,
    disturbance: Array,
    limit: Array,
    anti_windup: Array,
) -> Array:
    """Outputs of the plant, (S, N, 2), for S settings of a limit on what the compensators demand.

    No library at hand steps a loop with a saturation in it; this is the one of
    :class:`ftc.controller.Controller`, with the mapping and the plant linear.

    Args:
        plant: Sampled, strictly proper; inputs [disturbance; demanded], two outputs.
        compensators: One for each output, of one order.
        reference: For the outputs, shape (S, N, 2); what a sensor adds to them is taken off it.
        disturbance: Of all settings, shape (N, d).
        limit: Largest demand of each compensator, shape (S,).
        anti_windup: Whether a compensator at its limit keeps its state while the error would drive
            it further, shape (S,).
    """
    A, B, C, D = (np.stack([getattr(G, part) for G in compensators]) for part in "ABCD")
    C, D, B = C[:, 0], D[:, 0, 0], B[:, :, 0]
    inputs = plant.B[:, -len(compensators) :]
    pushed = disturbance @ plant.B[:, : -len(compensators)].T
    settings, ticks, _ = reference.shape
    most, held = limit[:, None], anti_windup[:, None]
    x = np.zeros((settings, plant.nstates))
    states = np.zeros((settings, *B.shape))
    outputs = np.empty_like(reference)
    for tick in range(ticks):
        outputs[:, tick] = x @ plant.C.T
        error = reference[:, tick] - outputs[:, tick]
        asked = (states * C).sum(axis=-1) + D * error
        demanded = asked.clip(-most, most)
        moved = np.einsum("cij,scj->sci", A, states) + B * error[..., None]
        kept = held & (asked != demanded) & (error * asked > 0)
        states = np.where(kept[..., None], states, moved)
        x = x @ plant.A.T + demanded @ inputs.T + pushed[tick]
    return outputs
