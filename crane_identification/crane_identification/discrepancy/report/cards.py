"""One evidence card per finding, and the pictures of the gap."""

from typing import Any, NamedTuple

import numpy as np

from crane_identification.discrepancy.diagnosis import Diagnosis
from crane_identification.discrepancy.evidence import Zone
from crane_identification.discrepancy.extension import Finding, Value, carried_in
from crane_identification.discrepancy.gap import residual
from crane_identification.discrepancy.region import region
from crane_identification.discrepancy.report import charts
from crane_identification.report.notation import spoken, unit, with_uncertainty

WINDOW = 25.0  # s of the held-out recording that is drawn


class Picture(NamedTuple):
    """A figure of the page: the id of its div, what it says, and its description."""

    key: str
    caption: str
    description: dict[str, Any]

    @property
    def height(self) -> int:
        """px."""
        return int(self.description["layout"]["height"])


class Line(NamedTuple):
    """One parameter as text."""

    name: str
    value: str
    std_dev: str
    unit: str


class Card(NamedTuple):
    """Everything about one finding."""

    number: int
    title: str
    where: str
    signature: str
    strength: str
    members: str
    runner_up: str
    settled_by: str
    parameters: tuple[Line, ...]
    carried_in: dict[str, tuple[str, ...]]
    pictures: tuple[Picture, ...]


def cards(diagnosis: Diagnosis) -> list[Card]:
    """Strongest first."""
    return [_card(diagnosis, n, one) for n, one in enumerate(diagnosis.findings, start=1)]


def gap_pictures(diagnosis: Diagnosis) -> list[Picture]:
    """Force and simulated motion on the held-out recordings, before and after."""
    gap = diagnosis.gap
    names = [spoken(joint) for joint in diagnosis.joints]
    force = charts.grouped_bars(
        names,
        (
            ("before", charts.BEFORE, 100 * gap.before),
            ("after", charts.AFTER, 100 * gap.after),
            ("learner", charts.BEST, 100 * gap.best),
            ("noise floor", charts.FLOOR, 100 * gap.floor),
        ),
        "error of the force [% of its rms]",
    )
    motion = charts.grouped_bars(
        names,
        (
            ("before", charts.BEFORE, 1e3 * gap.motion_before.position_rms),
            ("after", charts.AFTER, 1e3 * gap.motion_after.position_rms),
        ),
        f"error after {gap.motion_before.horizon:.2g} s [mrad, mm]",
    )
    return [
        Picture("gap-force", "Force that the model does not explain", force),
        Picture("gap-motion", "Simulated against measured motion", motion),
    ]


def where_picture(diagnosis: Diagnosis) -> Picture:
    """Which joint carries what the model does not explain."""
    names = [spoken(joint) for joint in diagnosis.joints]
    bars = charts.grouped_bars(
        names, (("share", charts.BEFORE, 100 * diagnosis.energy),), "share of the unexplained [%]"
    )
    return Picture("where", "Which joint", bars)


def _card(diagnosis: Diagnosis, number: int, finding: Finding) -> Card:
    accepted, family = finding.accepted, finding.family
    runner = accepted.runner_up
    return Card(
        number=number,
        title=family.effect.name,
        where="the whole crane" if family.joint is None else spoken(family.joint),
        signature=family.effect.signature,
        strength=f"{100 * accepted.strength:.2g} % of the drive force",
        members=", ".join(f"{one.effect.name} ({spoken(one.where)})" for one in accepted.members),
        runner_up=""
        if runner is None
        else f"{runner.effect.name} ({spoken(runner.where)}), {accepted.margin:.0f} behind, where "
        f"{accepted.needed:.0f} are asked for",
        settled_by=family.effect.settled_by,
        parameters=tuple(
            Line(
                p.name,
                *with_uncertainty(p.value, p.std_dev),
                ("" if p.unit == "1" else unit(p.unit)) + _before(p),
            )
            for p in finding.parameters
        ),
        carried_in=carried_in(finding, diagnosis.training.sources),
        pictures=_pictures(diagnosis, number, finding),
    )


def _before(parameter: Value) -> str:
    """What a parameter was; empty for one of an effect that the model lacks."""
    return f", before {' ± '.join(with_uncertainty(*parameter.before))}" if parameter.before else ""


def _pictures(diagnosis: Diagnosis, number: int, finding: Finding) -> tuple[Picture, ...]:
    accepted = finding.accepted
    evidence, held_out = diagnosis.training, diagnosis.held_out
    columns = accepted.option.columns
    effect = columns @ [one.change[0] for one in finding.parameters[: columns.shape[2]]]
    channel = int(np.argmax(_visible(diagnosis, effect)))
    j = channel % len(diagnosis.joints)
    force_unit = unit(diagnosis.before.setting.force_unit(diagnosis.joints[j]))
    left = f"τ − τ<sub>model</sub> [{force_unit}]"
    used = evidence.used[:, channel]
    before = residual(evidence, diagnosis.before)[used, channel]
    after = residual(evidence, diagnosis.after)[used, channel]
    zone = list(Zone)[channel // len(diagnosis.joints)].value
    own = diagnosis.known.about(diagnosis.joints[j])
    follows = region(own, effect[:, channel], used)
    variable = follows.variable if follows else own.names[0]
    x = diagnosis.known.values[used, diagnosis.known.names.index(variable)]
    return (
        Picture(
            f"signature-{number}",
            f"What the model leaves {zone}, against what it follows",
            charts.cloud(x, before, after, before - after, (spoken(variable), left)),
        ),
        Picture(
            f"null-{number}",
            "Score, against what chance gives",
            charts.null_histogram(accepted.null, accepted.threshold, accepted.score),
        ),
        Picture(
            f"folds-{number}",
            "Does it help on recordings it was not fitted to?",
            charts.fold_bars(accepted.fold_names, accepted.held_out),
        ),
        Picture(
            f"force-{number}",
            f"Held out: {spoken(diagnosis.joints[j])}, measured less predicted force",
            _held_out_curves(diagnosis, held_out.run[0], j, force_unit),
        ),
    )


def _visible(diagnosis: Diagnosis, effect: np.ndarray) -> np.ndarray:
    """Energy (c,) of what an effect (n, c) changes in each channel, in units of what is left."""
    evidence = diagnosis.training
    changed = residual(evidence, diagnosis.before) - residual(evidence, diagnosis.after)
    own = np.where(evidence.rms(effect) > 0.0, evidence.rms(changed), 0.0)
    left = np.maximum(evidence.rms(residual(evidence, diagnosis.after)), np.finfo(float).tiny)
    return evidence.used.sum(axis=0) * (own / left) ** 2


def _held_out_curves(diagnosis: Diagnosis, run: int, j: int, force_unit: str) -> dict[str, Any]:
    held_out = diagnosis.held_out
    inside = held_out.run == run
    time = held_out.time[inside]
    middle = time[0] + (time[-1] - time[0]) / 2.0
    shown = np.flatnonzero(inside)[np.abs(time - middle) <= WINDOW / 2.0]
    gone = np.where(held_out.used[shown, j], 0.0, np.nan)  # a gap where the joint turns
    series = [
        (name, colour, residual(held_out, model)[shown, j] + gone)
        for name, colour, model in (
            ("before", charts.BEFORE, diagnosis.before),
            ("after", charts.AFTER, diagnosis.gap.carried),
        )
    ]
    return charts.curves(held_out.time[shown], series, f"τ − τ<sub>model</sub> [{force_unit}]")
