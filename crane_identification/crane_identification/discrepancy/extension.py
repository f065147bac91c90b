"""The model with the accepted effects, refitted jointly, and the parameters of each of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from crane_identification.data.units import COUNTS
from crane_identification.discrepancy.candidates import Family
from crane_identification.discrepancy.decision import Judged
from crane_identification.discrepancy.evidence import gather
from crane_identification.discrepancy.loads import LOADS, NO_LOAD, Loads
from crane_identification.discrepancy.refit import refit, shape_std_devs
from crane_identification.discrepancy.search import Search
from crane_identification.preparation import Preparation
from crane_model.model_file import Model


@dataclass(frozen=True)
class Training:
    """What models are fitted to: recordings, the `factor` of their rows, and their names."""

    recordings: Sequence[Preparation]
    factor: int
    sources: str


@dataclass(frozen=True)
class Value:
    """One parameter of a finding, linear or shape; not below `minimum`, if any."""

    name: str
    value: float
    std_dev: float
    unit: str
    minimum: float | None = None


@dataclass(frozen=True)
class Finding:
    """An accepted effect with its parameters in the extended model."""

    accepted: Judged
    parameters: tuple[Value, ...]

    @property
    def family(self) -> Family:
        """The effect and its joint."""
        return self.accepted.option.family


def extended(
    found: Search,
    before: Model,
    accepted: Sequence[Judged],
    training: Training,
) -> tuple[Model, list[tuple[Value, ...]]]:
    """The model with the accepted terms, refitted jointly, and the parameters of each.

    `UndeterminedError` where the recordings do not determine all of them.
    """
    if not accepted:
        return before, []
    model = before
    for one in accepted:
        model = model.with_term(one.option.term)
    after = refit(gather(model, training.recordings, training.factor), training.sources)
    own = [after.part(one.option.term) for one in accepted]
    assert after.std_devs is not None  # just fitted
    shapes = shape_std_devs(
        found, [one.option for one in accepted], [after.theta[part] for part in own]
    )
    values = []
    for one, part, spread in zip(accepted, own, shapes, strict=True):
        linear = [
            Value(
                after.parameters[i].name,
                float(after.theta[i]),
                float(after.std_devs[i]),
                after.parameters[i].unit,
                after.parameters[i].minimum,
            )
            for i in range(part.start, part.stop)
        ]
        coordinate = after.setting.units.get(one.option.family.where, "rad")
        bent = [
            Value(name, float(one.option.shape[name]), spread[name], shape.unit_on(coordinate))
            for name, shape in one.option.family.term.shapes.items()
        ]
        values.append(tuple(linear + bent))
    return after, values


def carried_in(finding: Finding, recordings: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Which recordings carry each load of an effect that differs between them, and which `none`."""
    loads: Loads | None = getattr(finding.accepted.option.term, LOADS, None)
    if loads is None:
        return {}
    pairs = zip(finding.parameters, loads, strict=True)
    carried = {value.name: load.recordings for value, load in pairs}
    loaded = {name for names in carried.values() for name in names}
    return carried | {NO_LOAD: tuple(sorted(set(recordings) - loaded))}


def in_counts(values: tuple[Value, ...]) -> tuple[Value, ...]:
    """Parameters that are found in counts."""
    return tuple(replace(one, unit=COUNTS if one.unit != "1" else "1") for one in values)
