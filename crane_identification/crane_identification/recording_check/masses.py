"""Static balance: the masses that the force needs, against the plausible ones of the machine."""

from collections.abc import Iterator

import numpy as np

from crane_identification.recording_check.constants import ALIKE, KNOWN
from crane_identification.recording_check.suspicion import Suspicion
from crane_model.model_file import Model


def masses(model: Model, values: np.ndarray, std_devs: np.ndarray) -> Iterator[Suspicion]:
    """What is suspicious of identified `values` (p,) with their standard deviations (p,)."""
    assert model.machine is not None
    plausible = model.machine.plausible
    wrong, ratios = [], []
    for parameter, value, spread in zip(model.parameters, values, std_devs, strict=True):
        if parameter.name not in plausible or spread > KNOWN * abs(value):
            continue
        low, high = plausible[parameter.name]
        ratios.append(value / np.sqrt(low * high))
        if not low <= value <= high:
            wrong.append(
                f"{parameter.name} {value:.4g} {parameter.unit}, plausible {low:g} to {high:g}"
            )
    if not wrong:
        return
    known = np.array(ratios)
    factor = float(np.median(known))
    where, evidence = "masses that the force carries", ", ".join(wrong)
    if (known < 0.0).all():
        cause = "the load would lift the crane: the sign of the forces is turned"
        yield Suspicion(where, evidence, cause, decisive=True)
    elif len(known) > 1 and (np.abs(known / factor - 1.0) < ALIKE).all():
        cause = (
            f"all are about {factor:.2g} times what is plausible: unit of force or pressure, "
            "piston areas, or the plausible masses of the machine file"
        )
        yield Suspicion(where, evidence, cause, decisive=True)
    else:
        cause = "a load that the machine file does not know, a wrong transducer, or wrong geometry"
        yield Suspicion(where, evidence, cause, decisive=False)
