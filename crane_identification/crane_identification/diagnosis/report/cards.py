"""One evidence card per finding."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis import finding_wording, variables
from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.fit.evidence import normed, residual
from crane_identification.diagnosis.fit.runs import Zone
from crane_identification.diagnosis.proof.extension import Finding
from crane_identification.diagnosis.report import charts
from crane_identification.diagnosis.report.pictures import Picture
from crane_identification.notation import human, listed, plain, spoken
from crane_model.terms.term import Variable

WINDOW = 25.0  # s of the held-out recording that is drawn
WHATEVER: tuple[Variable, ...] = ("velocity",)  # shows that an effect depends on nothing


class Card(NamedTuple):
    """Everything about one finding, `member` being that of its class whose parameters are given."""

    number: int
    title: str
    signature: str
    strength: str
    evidence: str
    member: str
    settled_by: str
    parameters: tuple[finding_wording.PrintedParameter, ...]
    drawn: list[str]
    carried: list[str]
    pictures: tuple[Picture, ...]


def cards(diagnosis: Diagnosis, content: finding_wording.Content) -> list[Card]:
    """Strongest first; `content` is that of findings.json, which begins with the same findings."""
    pairs = zip(diagnosis.findings, content["findings"], strict=False)
    return [_card(diagnosis, n, *pair) for n, pair in enumerate(pairs, start=1)]


def _card(
    diagnosis: Diagnosis, number: int, finding: Finding, said: finding_wording.Content
) -> Card:
    return Card(
        number=number,
        title=finding_wording.called(said),
        signature=finding.candidate.effect.signature,
        strength=finding_wording.strength(said),
        evidence=finding_wording.evidence(said),
        member=said["name"] if said["class_members"] else "",
        settled_by=said["settled_by"],
        parameters=tuple(finding_wording.estimates(said)),
        drawn=finding_wording.drawn(said),
        carried=finding_wording.carried(said),
        pictures=(*drawn(f"shape-{number}", said), *_pictures(diagnosis, number, finding)),
    )


def drawn(key: str, said: finding_wording.Content) -> tuple[Picture, ...]:
    """The shapes of an entry of findings.json as they were drawn, for each factor."""
    out = []
    for place, one in enumerate(said["shapes"]):
        (unit, factor), (force, size) = human(one["variable_unit"]), human(one["unit"])
        values, std_devs = (size * np.array(one[name]) for name in ("values", "std_devs"))
        times = "" if one["times"] == "1" else f", to be multiplied by {one['times']}"
        out.append(
            Picture(
                f"{key}-{place}",
                f"The law as it was drawn{times}: values at its knots, with their standard "
                "deviations",
                f"From {plain(values.min())} to {plain(values.max())} {force}.",
                charts.shape(
                    factor * np.array(one["knots"]),
                    values,
                    std_devs,
                    (f"{one['variable']} [{unit}]", f"[{force}]"),
                ),
            )
        )
    return tuple(out)


def _pictures(diagnosis: Diagnosis, number: int, finding: Finding) -> tuple[Picture, ...]:
    judged = finding.judged
    effect = _beside(diagnosis, finding)
    channel = int(np.argmax(_shown(diagnosis, effect)))
    follows = finding.candidate.effect.follows or WHATEVER
    return (
        *(
            _signature(diagnosis, f"signature-{number}-{place}", effect, channel, variable)
            for place, variable in enumerate(follows)
        ),
        Picture(
            f"null-{number}",
            "Score, against what chance gives",
            f"Score {judged.score:.0f}, threshold {judged.threshold:.0f}, largest of "
            f"{len(judged.null)} by chance {judged.null.max():.0f}.",
            charts.null_histogram(judged.null, judged.threshold, judged.score),
        ),
        folds(
            number,
            judged.fold_names,
            judged.held_out,
            {run.source for run in diagnosis.training.runs},
        ),
        _held_out(diagnosis, f"force-{number}", channel % len(diagnosis.joints)),
    )


def _signature(
    diagnosis: Diagnosis, key: str, effect: np.ndarray, channel: int, variable: Variable
) -> Picture:
    """What is left in a channel with an effect (n, c) and without, against what it depends on."""
    evidence, j = diagnosis.training, channel % len(diagnosis.joints)
    used = evidence.used[:, channel]
    after = residual(evidence, diagnosis.after)[used, channel]
    before = after + effect[used, channel]
    joint = diagnosis.joints[j]
    unit, factor = _unit(diagnosis, variable, joint)
    x = factor * variables.on_rows(variable, evidence, j)[used]
    forwards = variables.on_rows("velocity", evidence, j)[used] >= 0.0
    about = variable if variable in variables.OF_NO_JOINT else f"{variable} of the {spoken(joint)}"
    zone = list(Zone)[channel // len(diagnosis.joints)].value
    title = about + (f" [{unit}]" if unit else "")
    left, _ = _unit(diagnosis, "force", joint)
    return Picture(
        key,
        f"What is left {zone} without this effect and with it, against the {about}. Lines: the "
        "effect beside the model, forwards (solid) and backwards (dashed)",
        _sizes(before, after, left),
        charts.cloud(x, before, after, forwards, (title, f"τ − τ<sub>model</sub> [{left}]")),
    )


def folds(number: int, names: Sequence[str], gains: np.ndarray, recordings: set[str]) -> Picture:
    """What an effect gains on training data that is left out of the fit in turn."""
    whole = set(names) <= recordings
    part = "training recording" if whole else "part of the training data"
    ends = charts.span(gains)
    caption = [f"Does it help on each {part}, left out of the fit in turn?"]
    if ends is not None:
        beyond = np.flatnonzero((gains < ends[0]) | (gains > ends[1]))
        far = [f"{i + 1} reaches {plain(gains[i])}" for i in beyond]
        caption.append(f"The axis is cut: {listed(far)}.")
    unknown = [str(i + 1) for i in np.flatnonzero(~np.isfinite(gains))]
    if unknown:
        caption.append(f"Not asked: {listed(unknown)}, without which it is not determined.")
    said = [plain(gain) if np.isfinite(gain) else "not asked" for gain in gains]
    return Picture(
        f"folds-{number}",
        " ".join(caption),
        f"Gains: {', '.join(said)}.",
        charts.fold_bars(names, gains, f"{part} left out of the fit"),
    )


def _held_out(diagnosis: Diagnosis, key: str, j: int) -> Picture:
    held_out = diagnosis.held_out
    moving = held_out.used[:, j]
    run = np.argmax(np.bincount(held_out.run, moving))  # in which the joint moves most
    inside = held_out.run == run
    time = held_out.time[inside]
    middle = time[0] + (time[-1] - time[0]) / 2.0
    if not moving[inside][np.abs(time - middle) <= WINDOW / 2.0].any() and moving[inside].any():
        middle = float(np.median(time[moving[inside]]))
    shown = np.flatnonzero(inside)[np.abs(time - middle) <= WINDOW / 2.0]
    gone = np.where(held_out.used[shown, j], 0.0, np.nan)  # a gap where the joint turns
    before, after = (
        residual(held_out, model)[shown, j] + gone
        for model in (diagnosis.before, diagnosis.gap.carried)
    )
    unit, _ = _unit(diagnosis, "force", diagnosis.joints[j])
    series = [("before", charts.BEFORE, before), ("after", charts.AFTER, after)]
    return Picture(
        key,
        f"On a recording that took no part: {spoken(diagnosis.joints[j])}, measured less predicted "
        "force",
        _sizes(before, after, unit),
        charts.curves(held_out.time[shown], series, f"τ − τ<sub>model</sub> [{unit}]"),
    )


def _sizes(before: np.ndarray, after: np.ndarray, unit: str) -> str:
    """Root mean squares in words."""
    if not np.isfinite(before).any():
        return "The joint rests there."
    rms = (float(np.sqrt(np.mean(values[np.isfinite(values)] ** 2))) for values in (before, after))
    return "Root mean square {} before, {} after.".format(*(f"{plain(one)} {unit}" for one in rms))


def _unit(diagnosis: Diagnosis, variable: Variable, joint: str) -> tuple[str, float]:
    setting, counts = diagnosis.before.setting, bool(diagnosis.fit.uncalibrated)
    return human(variables.unit_of(variable, joint, setting, counts))


def _beside(diagnosis: Diagnosis, finding: Finding) -> np.ndarray:
    """What of a finding (n, c) neither the model nor the other findings explain without it."""
    evidence, own = diagnosis.training, finding.judged.shaped
    others = [
        one.judged.shaped.columns for one in diagnosis.findings if one.judged.shaped is not own
    ]
    known = 0 if evidence.keeps else len(diagnosis.before.parameters)
    rest = np.concatenate([evidence.base[:, :, :known], *others], axis=2)
    effect = own.columns @ finding.added
    weight = np.broadcast_to(1.0 / _left(diagnosis), effect.shape)[evidence.used]
    scaled, norms = normed(rest[evidence.used] * weight[:, np.newaxis])
    values = np.linalg.lstsq(scaled, effect[evidence.used] * weight, rcond=1e-9)[0] / norms
    return effect - rest @ values


def _shown(diagnosis: Diagnosis, effect: np.ndarray) -> np.ndarray:
    """Energy (c,) of an effect (n, c) in each channel, in units of what is left."""
    evidence = diagnosis.training
    return evidence.used.sum(axis=0) * (evidence.rms(effect) / _left(diagnosis)) ** 2


def _left(diagnosis: Diagnosis) -> np.ndarray:
    """Root mean square (c,) of what is left in each channel; never 0."""
    evidence = diagnosis.training
    left = evidence.rms(residual(evidence, diagnosis.after))
    return np.maximum(left, np.finfo(float).tiny)
