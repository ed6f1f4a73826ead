"""The force experiment as numbers and files."""

from functools import partial
from typing import Any

import numpy as np

from experiments.force.aims import PRESCRIBED, weighed
from experiments.force.answers import (
    MAJOR_WEIGHTS,
    PLATFORM_MJCF,
    Answer,
    Exerted,
    InternalForce,
    Tradeoff,
    Tried,
)
from experiments.force.figure import pictures
from experiments.force.recording import write_force
from experiments.force.rig import Readings
from experiments.force.runs import Examination, Force, Held, Trial, payload_stiffness
from experiments.force.tables import checks, tables
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.rig.hexapod.metrics import percent, plant_constants
from experiments.rig.run import rms
from experiments.study.provenance import versions
from experiments.study.results import Results
from prioritized import Status
from sim import Array, load_model, model_sha256


def results(force: Force) -> Results:
    """Everything that `fjh force` publishes."""
    summary = summarize(force)
    return Results(
        summary,
        tables=tables(summary),
        checks=checks(summary),
        pictures=pictures(force, summary),
        arrays={summary["data"]: _arrays(force)},
        records=[partial(write_force, force.examinations, summary)],
    )


def summarize(force: Force) -> dict[str, Any]:
    """All numbers of the experiment, ready for JSON; units are in the names."""
    model = load_model()
    K = payload_stiffness(model)
    return {
        "experiment": "force",
        "seed": force.seed,
        "versions": versions(),
        "model_sha256": {"fjh": model_sha256(), "platform": model_sha256(PLATFORM_MJCF)},
        "bench": plant_constants(model),
        "asked": {
            "major_n_m": force.aims.major.tolist(),
            "secondary_n_and_n_m": force.aims.secondary.tolist(),
        },
        "conditions": [_condition(one, K) for one in force.examinations],
        "tradeoff": _tradeoff(force.tradeoff),
        "internal_force": [_internal(one) for one in force.internal],
        "recording": "force.rrd",
        "data": "force.npz",
    }


def _condition(one: Examination, K: Array) -> dict[str, Any]:
    condition = one.condition
    readings = [read for trial in one.trials for read in (trial.pressed, trial.held)]
    return {
        "condition": str(condition),
        "kind": condition.kind,
        "strut": None if condition.kind is None else condition.strut + 1,
        "theorems": [_theorem(trial, K) for trial in one.trials],
        "reaction": _reaction(one) if condition.kind == "locked" else None,
        "prescribed": [_prescribed(held) for held in one.prescribed],
        "closure_residual_max_m": float(max(r.closure_residual_m.max() for r in readings)),
    }


def _theorem(trial: Trial, K: Array) -> dict[str, Any]:
    answer, fixture = trial.answer, trial.pressed.fixture[:, -1]
    asked, strut = answer.asked[:, MAJOR], trial.held.strut_n[:, -1]
    # As far as the push would move the payload if the springs alone held it.
    unheld = np.linalg.solve(K, answer.wrench.T).T
    return {
        "theorem": answer.goal.theorem,
        "exact": answer.status is Status.EXACT,
        "cost_excess": _cost_excess(answer),
        "torque_peak_n": float(np.abs(answer.torques).max()),
        "pressed_off_percent": percent((fixture - answer.wrench) @ answer.seen, answer.wrench),
        "pressed_major_off_percent": _off_percent(fixture[:, MAJOR] - asked, asked),
        "held_off_percent": _off_percent(strut - answer.strut, answer.strut),
        "moved_percent": percent(trial.held.displacement[:, -1], unheld),
    }


def _cost_excess(answer: Answer) -> float:
    """The largest of the aims, relative to all that is weighed there."""
    whole = weighed(answer.goal, answer.torques, answer.asked[:, SECONDARY])
    return float(((answer.cost - answer.least_cost) / (whole**2).sum(axis=1)).max())


def _reaction(one: Examination) -> dict[str, Any]:
    """What the lock bears of the prescribed wrenches, held and pressing."""
    trial, strut = one.trial(PRESCRIBED), one.condition.strut
    held, pressed = (each.lock_n[:, -1, strut].tolist() for each in (trial.held, trial.pressed))
    predicted = trial.answer.strut[:, strut].tolist()
    return {"predicted_n": predicted, "simulated_n": held, "simulated_pressed_n": pressed}


def _prescribed(held: Held) -> dict[str, Any]:
    def size(displacement: Array) -> dict[str, list[float]]:
        parts = {"pointing_urad": MAJOR, "translation_um": slice(3, 6)}
        return {
            name: (1e6 * np.linalg.norm(displacement[:, part], axis=1)).tolist()
            for name, part in parts.items()
        }

    return {
        "mapping": held.mapping,
        "lacking_force_n": np.linalg.norm(held.lacking[:, 3:], axis=1).tolist(),
        "lacking_major_n_m": np.linalg.norm(held.lacking[:, MAJOR], axis=1).tolist(),
        "predicted": size(held.predicted),
        "simulated": size(held.simulated),
        "off_percent": percent(held.simulated - held.predicted, held.unheld),
    }


def _tradeoff(trade: Tradeoff) -> dict[str, Any]:
    least, others, pseudo = trade.mapping.weighed[0], trade.others, trade.pseudo_inverse
    columns = (MAJOR_WEIGHTS, pseudo.weighed / least, 100 * pseudo.major_off)
    keys = ("major_weight_per_n_m", "weighed_over_mapping", "major_off_percent")
    return {
        "asked_n_m": trade.asked.tolist(),
        "mapping": {
            "weighed_torque_n": float(least),
            "major_off_percent": 100 * float(trade.mapping.major_off[0]),
        },
        "others": {
            "count": len(others.weighed),
            "cheapest_over_mapping": float(others.weighed.min() / least),
            "dearest_over_mapping": float(others.weighed.max() / least),
            "major_off_percent": 100 * float(others.major_off.max()),
        },
        "pseudo_inverse": [
            dict(zip(keys, map(float, row), strict=True)) for row in zip(*columns, strict=True)
        ],
    }


def _internal(use: InternalForce) -> dict[str, Any]:
    """Root mean squares over the forces that are exerted."""

    def weighed_n(how: Exerted) -> Array:
        return np.linalg.norm((how.torques - use.desired) * use.torque_weight, axis=1)

    def exerted(how: Exerted) -> dict[str, Any]:
        legs, fixture = how.pressed.strut_n[:, -1], how.pressed.fixture[:, -1]
        of_motors = {"weighed_rms_n": float(rms(weighed_n(how)))}
        if use.motor is None:
            of_motors["least_squeeze_n"] = float((legs * np.sign(use.desired)).min())
        else:
            of_motors["hot_motor_rms_n"] = float(rms(how.torques[:, use.motor]))
        return of_motors | {
            "internal_rms_n": float(rms(how.legs @ use.direction)),
            "internal_simulated_rms_n": float(rms(legs @ use.direction)),
            "wrench_off_percent": percent(fixture - use.wrench, use.wrench),
            "legs_off_percent": _off_percent(legs - how.legs, how.legs),
        }

    return {
        "name": use.name,
        "motor": None if use.motor is None else use.motor + 1,
        "without": exerted(use.without),
        "used": exerted(use.used),
        "saved_at_least_n": float((weighed_n(use.without) - weighed_n(use.used)).min()),
    }


def _off_percent(difference: Array, whole: Array) -> float:
    return float(100 * np.linalg.norm(difference) / np.linalg.norm(whole))


def _arrays(force: Force) -> dict[str, Array]:
    """All commands, predictions and readings; wrenches and displacements are [angular; linear]."""
    arrays = {"asked_wrench": force.aims.wrench}
    for one in force.examinations:
        for trial in one.trials:
            answer = trial.answer
            where = f"{one.condition} {answer.goal}".replace(" ", "_")
            arrays |= {f"{where}_torques_n": answer.torques, f"{where}_wrench": answer.wrench}
            arrays |= {f"{where}_strut_n": answer.strut}
            arrays |= _prefixed(f"{where}_pressed", trial.pressed)
            arrays |= _prefixed(f"{where}_held", trial.held)
        for held in one.prescribed:
            where = f"{one.condition} prescribed {held.mapping}".replace(" ", "_")
            arrays |= {f"{where}_torques_n": held.torques, f"{where}_predicted": held.predicted}
            arrays |= _prefixed(where, held.readings)
    for name in ("mapping", "others", "pseudo_inverse"):
        arrays |= _prefixed(f"tradeoff_{name}", getattr(force.tradeoff, name))
    for use in force.internal:
        where = f"platform_{use.name}".replace(" ", "_")
        arrays |= {f"{where}_wrench": use.wrench}
        for name, how in (("without", use.without), ("used", use.used)):
            arrays |= {f"{where}_{name}_torques_n": how.torques, f"{where}_{name}_legs_n": how.legs}
            arrays |= _prefixed(f"{where}_{name}", how.pressed)
    return arrays


def _prefixed(where: str, record: Readings | Tried) -> dict[str, Array]:
    return {f"{where}_{name}": values for name, values in vars(record).items()}
