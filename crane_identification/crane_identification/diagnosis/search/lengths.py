"""Lengths of links that are not those of the machine's file, as columns beside the model.

Where linkages are of another size than in their file, so may be the links. No effect says which:
the force that a little more of each length makes is taken out of what is asked of the effects.
"""

from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.search.projection import project
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.whitening import whitened_base
from crane_model.machine import Machine

LENGTHS = ("a", "d")  # of a row of Table 1
STEP = 0.01  # relative


def beside_lengths(search: Search) -> Search:
    """The same candidates, from the start, beside the model and a little more of each length."""
    return widened(search, columns_of_lengths(search.evidence))


def widened(search: Search, columns: np.ndarray) -> Search:
    """The same candidates, from the start, beside the model and further columns (n, c, k)."""
    evidence = search.evidence
    evidence = replace(evidence, base=np.concatenate([evidence.base, columns], axis=2))
    base = whitened_base(evidence, search.whitener)
    projection = project(search.whitener, base, search.projection.candidates)
    return replace(search, evidence=evidence, base=base, projection=projection)


def columns_of_lengths(evidence: Evidence) -> np.ndarray:
    """d(Phi Theta)/d(ln x) (n, c, k) by each length x of a link that makes a force."""
    model, machine = evidence.model, evidence.model.setting.machine
    force = evidence.base[:, :, : len(evidence.values)] @ evidence.values
    columns = [
        (evidence.regressor(replace(model, setting=setting)) @ evidence.values - force) / STEP
        for longer in ([] if machine is None else _each_longer(machine))
        for setting in [model.setting._replace(machine=longer)]
    ]
    moving = [one for one in columns if one.any()]
    return np.stack(moving, axis=2) if moving else evidence.base[:, :, :0]


def _each_longer(machine: Machine) -> list[Machine]:
    """The machine with each length of a link that it has, in turn, larger by `STEP`."""
    out = []
    for number, joint in enumerate(machine.joints):
        for name in LENGTHS if joint.dh else ():
            longer = machine.model_dump(by_alias=True)
            longer["joints"][number]["dh"][name] *= 1.0 + STEP
            out.append(Machine.model_validate(longer))
    return out
