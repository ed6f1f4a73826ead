"""What the figures show, as data: the contents of `figures.json`."""

from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.figures.geometry import node_names
from experiments.figures.study import Portrait
from experiments.hexapod.failure_atlas import verdicts
from experiments.hexapod.metrics import loop_measures
from experiments.hexapod.provenance import plant_constants
from experiments.output.provenance import versions
from prioritized import FailureAtlas


def summarize(portrait: Portrait, seed: int) -> dict[str, Any]:
    """All numbers that are drawn, ready for JSON; units are in the names."""
    geometry = portrait.geometry
    return {
        "experiment": "figures",
        "seed": seed,
        "versions": versions(),
        "model_sha256": portrait.model_sha256,
        "bench": asdict(portrait.bench) | plant_constants(portrait.model),
        "modes_hz": portrait.modes_hz.tolist(),
        "loops": {one.angle: loop_measures(one.loop) for one in portrait.loops},
        "strut_length_m": geometry.nominal_length_m.tolist(),
        "nodes_m": {name: node.tolist() for name, node in node_names(geometry).items()},
        "atlas": _atlas(portrait.atlas),
    }


def _atlas(atlas: FailureAtlas) -> dict[str, Any]:
    assert atlas.elastic is not None  # the hexapod has springs
    failures = (atlas.codes != 0).sum(axis=1)
    struts = atlas.codes.shape[1]
    return {
        "conditions": len(atlas.codes),
        "possible_rigid": int(atlas.possible.sum()),
        "possible_elastic": int(atlas.elastic.possible.sum()),
        "verdicts": {
            verdict.name: {
                "label": verdict.label,
                "conditions": int(verdict.holds.sum()),
                "by_number_of_failures": np.bincount(
                    failures[verdict.holds], minlength=struts + 1
                ).tolist(),
            }
            for verdict in verdicts(atlas)
        },
    }
