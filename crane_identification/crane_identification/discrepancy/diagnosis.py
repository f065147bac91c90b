"""The diagnosis: from logs and a model to a verdict, findings, an extended model, and its proof."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crane_identification.data.log import Log
from crane_identification.discrepancy.candidates import Family, families
from crane_identification.discrepancy.cross_validation import folds
from crane_identification.discrepancy.decision import decide
from crane_identification.discrepancy.determined import decimation, fitted
from crane_identification.discrepancy.evidence import Evidence, gather
from crane_identification.discrepancy.extension import Finding, extended, in_counts
from crane_identification.discrepancy.flow import examine
from crane_identification.discrepancy.gap import Gap, measure, residual
from crane_identification.discrepancy.hydraulics import Flow, Usual, load_usual
from crane_identification.discrepancy.learner import Features, Learnt, features, learn
from crane_identification.discrepancy.motion_choice import suited
from crane_identification.discrepancy.pulsation import Pulsation, pulsations
from crane_identification.discrepancy.region import Region, region
from crane_identification.discrepancy.search import Search, search
from crane_identification.discrepancy.strength import detectable
from crane_identification.discrepancy.thresholds import Thresholds
from crane_identification.discrepancy.verdict import (
    Verdict,
    judge,
    normalized_energy,
    proved,
    with_flow,
    with_loads,
    with_pulsation,
)
from crane_identification.options import Options
from crane_identification.preparation import Preparation, prepare, prepare_all
from crane_identification.progress import Progress, silent
from crane_identification.session import Session, chronological
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.terms import REGISTRY, Term


@dataclass(frozen=True)
class Diagnosis:
    """Everything that page, summary and text are made of.

    Per joint (j,): `energy` share of the unexplained energy, `regions` that carry it, `learnt` from
    the residual before and after; `correlation_left` of neighbouring rows of what remains, 0 for
    noise. `undetermined` parameters of the given model were left out of it; the answer is sought
    `without` these effects; `uncalibrated` quantities are in counts. `session` says whether time
    runs through all recordings.
    """

    verdict: Verdict
    reason: str
    before: Model
    after: Model
    search: Search
    thresholds: Thresholds
    threshold: float
    findings: tuple[Finding, ...]
    training: Evidence
    held_out: Evidence
    gap: Gap
    energy: np.ndarray
    regions: tuple[Region | None, ...]
    learnt_before: Learnt
    learnt_after: Learnt
    correlation_left: np.ndarray
    detectable: float
    known: Features
    undetermined: tuple[str, ...]
    without: frozenset[str]
    uncalibrated: tuple[str, ...]
    flows: tuple[Flow, ...]
    flow_unobservable: dict[tuple[str, str], str]
    pulsations: tuple[Pulsation, ...]
    session: Session

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.before.joints


def diagnose(
    model: Model,
    training: Sequence[Log],
    validation: Sequence[Log],
    options: Options,
    thresholds: Thresholds,
    progress: Progress = silent,
    usual: Usual | None = None,
    without: Collection[str] = (),
) -> Diagnosis:
    """Where `model` disagrees with the recordings, and why.

    `usual` says what is usual of the hydraulics (None: the packaged values). `without` names
    effects (types of terms) that the answer is sought without: what else could it be?

    The model is fitted to the training recordings first, so that its values are not what differs.
    `DataError` if recordings cannot be used or do not determine the parameters of the model;
    `ConfigurationError` if an effect is not in the catalogue.
    """
    for name, logs in (("--train", training), ("--validate", validation)):
        if not logs:
            raise DataError(f"no recordings given; name at least one with {name}")
    unknown = sorted(set(without) - {name for name, cls in REGISTRY.items() if cls.effect})
    if unknown:
        raise ConfigurationError(
            f"{', '.join(unknown)}: no effect that shows in the force; name effects as "
            "findings.json does"
        )
    whole = replace(options, average=False)
    logs = chronological((*training, *validation))
    session = Session.of(logs)
    prepared = prepare_all(model, logs, whole, progress, session)
    sources = {log.source for log in training}
    train = [p for p in prepared if p.source in sources]
    hold = [p for p in prepared if p.source not in sources]
    uncalibrated = tuple(dict.fromkeys(name for log in logs for name in log.uncalibrated))
    factor = decimation(train, options.decimation)
    text = ", ".join(sorted(sources))
    evidence, before, left_out = fitted(model, train, factor, text)
    held_out = gather(before, hold, factor, first_run=len(train))
    found = search(evidence, _wanted(before, evidence, left_out, without), progress)
    accepted, threshold = decide(found, thresholds)
    seen, joints = evidence.moving, len(model.joints)
    known, (fold, _) = features(seen), folds(seen)
    left = residual(evidence, before)
    learnt_before = learn(seen, known, left[:, :joints], fold)
    progress("what is left", 0.5)
    left_share = found.left_share([one.option for one in accepted])
    accepted = suited(found, before, accepted)
    after, values = extended(found, before, accepted, train, factor, text)
    left_after = residual(evidence, after)
    learnt_after = learn(seen, known, left_after[:, :joints], fold) if accepted else learnt_before
    progress("what is left", 1.0)
    least = detectable(found, threshold)
    periods = _averaged(model, validation, options)
    verdict, reason = judge(
        found,
        accepted,
        energies=(normalized_energy(found, left), normalized_energy(found, left_after)),
        learnt=(learnt_before, learnt_after),
        left_share=left_share,
        least=least,
        undetermined=_names(model, left_out),
        thresholds=thresholds,
    )
    if verdict is Verdict.UNKNOWN:
        accepted, after, values = [], before, []
    named = [one.option.family for one in accepted]
    wrong = {one.where for one in named if one.term.family == "sensing"}
    flows, no_flow = examine(evidence, held_out, usual or load_usual(), wrong)
    verdict, reason = with_flow(verdict, reason, flows)
    lines = pulsations(after, (*evidence.runs, *held_out.runs))
    verdict, reason = with_pulsation(verdict, reason, lines)
    gap = measure(before, after, evidence, held_out, periods)
    verdict, reason = with_loads(verdict, proved(reason, gap), gap.loads)
    progress("gap", 1.0)
    energy = _energy(found, left)
    return Diagnosis(
        verdict=verdict,
        reason=reason,
        before=before,
        after=after,
        search=found,
        thresholds=thresholds,
        threshold=threshold,
        findings=tuple(
            Finding(a, in_counts(v) if uncalibrated else v)
            for a, v in zip(accepted, values, strict=True)
        ),
        training=evidence,
        held_out=held_out,
        gap=gap,
        energy=energy,
        regions=tuple(region(known, left[:, j], evidence.used[:, j]) for j in range(joints)),
        learnt_before=learnt_before,
        learnt_after=learnt_after,
        correlation_left=_correlation(seen, residual(seen, after)),
        detectable=least,
        known=known,
        undetermined=_names(model, left_out),
        without=frozenset(without),
        uncalibrated=uncalibrated,
        flows=tuple(flows),
        flow_unobservable=no_flow,
        pulsations=lines,
        session=session,
    )


def _wanted(
    model: Model, evidence: Evidence, left_out: Collection[Term], without: Collection[str]
) -> list[Family]:
    """The families that are asked for: not `without`, and none that the model had."""
    had = {(term.type, getattr(term, "joint", None)) for term in left_out}
    return [
        family
        for family in families(model, evidence)
        if family.type not in without and (family.type, family.joint) not in had
    ]


def _names(model: Model, terms: Sequence[Term]) -> tuple[str, ...]:
    """The parameters of terms."""
    return tuple(p.name for term in terms for p in term.parameters(model.setting))


def _averaged(model: Model, logs: Sequence[Log], options: Options) -> list[Preparation]:
    """The validation recordings averaged, those that are periodic; their scatter is the noise."""
    out = []
    for log in logs:
        try:
            out += prepare(model, log, replace(options, average=True))
        except DataError:
            continue  # not periodic: no scatter
    return out


def _energy(found: Search, left: np.ndarray) -> np.ndarray:
    """Share (j,) of the energy beyond noise that each joint carries."""
    channels = np.maximum(normalized_energy(found, left) - found.evidence.used.sum(axis=0), 0.0)
    beyond = channels.reshape(-1, len(found.evidence.joints)).sum(axis=0)
    total = float(beyond.sum())
    return beyond / total if total > 0.0 else np.zeros_like(beyond)


def _correlation(evidence: Evidence, left: np.ndarray) -> np.ndarray:
    """Correlation (j,) of neighbouring rows of a residual; 0 for white noise."""
    both = evidence.used[1:] & evidence.used[:-1] & (np.diff(evidence.run) == 0)[:, np.newaxis]
    product = np.where(both, left[1:] * left[:-1], 0.0).sum(axis=0)
    power = np.where(evidence.used, left**2, 0.0).sum(axis=0)
    share = both.sum(axis=0) / np.maximum(evidence.used.sum(axis=0), 1)
    return product / np.maximum(power * share, np.finfo(float).tiny)
