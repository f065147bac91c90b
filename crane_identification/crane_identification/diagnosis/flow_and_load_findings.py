"""What findings.json says of flows of oil and of loads of single recordings.

They are found beside the effects of the force, with which they do not compete.
"""

from typing import Any

from crane_identification.diagnosis.candidates import WHOLE, Candidate
from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.hydraulics import Flow, Quantity
from crane_identification.diagnosis.loads import LOADS, MASS_SIGMAS, NO_LOAD, Weighed
from crane_identification.notation import is_determined


def of_load(diagnosis: Diagnosis, one: Weighed) -> dict[str, Any]:
    """A load that a held-out recording alone carries, by the same keys."""
    cls = next(type(term) for term in diagnosis.gap.carried.terms if hasattr(term, LOADS))
    name = "m_payload"
    return _by_itself(
        diagnosis,
        Candidate(cls, None),
        WHOLE,
        _value(name, one.mass, one.std_dev, "kg", is_determined(one.mass, one.std_dev)),
        (one.mass / one.std_dev) ** 2,
        MASS_SIGMAS**2,
        None,
    ) | {"carried_in": {name: [one.recording], NO_LOAD: sorted(diagnosis.training.sources)}}


def of_flow(diagnosis: Diagnosis, joint: str, one: Quantity) -> dict[str, Any]:
    """A finding of the flow balance, by the same keys; it adds nothing to the model of forces."""
    sigmas = diagnosis.thresholds.method.flow_sigmas
    threshold = (sigmas * one.std_dev / one.value) ** 2 * one.score
    return _by_itself(diagnosis, one, joint, of_quantity(one), one.score, threshold, one.share)


def _by_itself(
    diagnosis: Diagnosis,
    what: Candidate | Quantity,
    joint: str,
    value: dict[str, Any],
    score: float,
    threshold: float,
    visible_strength: float | None,
) -> dict[str, Any]:
    """A finding with one parameter, which competed with no other effect."""
    return {
        "effect": what.type,
        "name": what.effect.name,
        "joint": joint,
        "class_members": [],
        "parameters": [value],
        "carried_in": {},
        "score": score,
        "threshold": threshold,
        "false_alarm_rate": diagnosis.thresholds.method.false_alarm_rate,
        "runner_up": None,
        "margin": score,
        "margin_needed": 0.0,
        "visibility": 1.0,
        "strength": None,  # rms over that of the drive force, as of effects that compete
        "visible_strength": visible_strength,
        "held_out_gains": {},
        "settled_by": what.effect.settled_by,
    }


def balance(flow: Flow) -> dict[str, Any]:
    """Everything the flow balance says of a joint."""
    return {
        "unexplained_share": flow.unexplained,
        "correlation_left": flow.correlation,
        "known_time": flow.known,
        "recorded_time": flow.recorded,
        "edge_gains": {
            one.edge: {"value": one.value, "std_dev": one.std_dev, "determined": one.determined}
            for one in flow.gains
        },
        "quantities": {
            one.type: {
                **of_quantity(one),
                "usual_limit": one.usual,
                "share_beyond_usual": one.share,
            }
            for one in flow.quantities
        },
    }


def of_quantity(one: Quantity) -> dict[str, Any]:
    """A value of the hydraulics, by the keys of a parameter."""
    return _value(one.type, one.value, one.std_dev, one.unit, one.determined)


def _value(name: str, value: float, std_dev: float, unit: str, determined: bool) -> dict[str, Any]:
    return {
        "name": name,
        "value": value,
        "std_dev": std_dev,
        "unit": unit,
        "minimum": None,
        "determined": determined,
    }
