"""Which joints are served without their encoders where valves are not identified."""

import numpy as np

from crane_model.array import Array, Flags
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_observer.position.assumed import MOST_BY_WEIGHT
from crane_observer.position.known import Known
from crane_observer.position.observability import WIDE

POSES = 256  # that are looked at


def refuse_unserved(model: Model, hidden: Flags) -> list[str]:
    """`ConfigurationError` where joints whose encoders are `hidden` (j,) cannot be served;
    else what is to be said of those that are served by their weight alone.
    """
    known = Known.of(model, np.zeros(len(model.joints)))
    by_weight = hidden & known.assumed
    names = [joint for joint, one in zip(model.joints, by_weight, strict=True) if one]
    if len(names) > MOST_BY_WEIGHT:
        raise ConfigurationError(
            f"the valves of {', '.join(names)} are not identified, and the weight of the crane "
            f"tells the position of {MOST_BY_WEIGHT} joint at most: identify the hydraulics, or "
            "use the other encoders"
        )
    poor = by_weight & ~told_by_weight(known)
    if poor.any():
        raise ConfigurationError(
            f"{model.joints[int(np.argmax(poor))]}: its valve is not identified, and the weight of "
            "the crane is about the same wherever it is: identify the hydraulics"
        )
    return [
        f"{joint}: its valve is not identified; its position comes from the weight of the crane "
        "while it moves steadily, and drifts where it does not"
        for joint in names
    ]


def told_by_weight(known: Known) -> Flags:
    """(j,) whether in some pose the weight bounds the position of each joint."""
    rng = np.random.default_rng(0)
    q = known.low + (known.high - known.low) * rng.uniform(size=(POSES, len(known.low)))
    still = np.zeros_like(q)
    slope = known.mechanics.balance(q, still, still).slope
    lever = known.mechanics.cylinders(q)[:, :, 1]
    noise: Array = lever * known.circuit.area_a * known.trust.pressure
    told = np.nansum((slope / noise[:, :, np.newaxis]) ** 2, axis=1).max(axis=0)
    return np.asarray(told > 1.0 / (WIDE * (known.high - known.low)) ** 2)
