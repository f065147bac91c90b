"""The diagnosis: from logs and a model to a verdict, findings, an extended model, and its proof."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crane_identification.data.log import Log
from crane_identification.diagnosis import changes
from crane_identification.diagnosis.candidates import Family, families
from crane_identification.diagnosis.decision import decide
from crane_identification.diagnosis.determined import decimation, fitted
from crane_identification.diagnosis.evidence import Evidence, gather
from crane_identification.diagnosis.extension import Finding, Training, in_counts
from crane_identification.diagnosis.flow import examine
from crane_identification.diagnosis.gap import Gap
from crane_identification.diagnosis.hydraulics import Flow, Usual, load_usual
from crane_identification.diagnosis.learner import Features, Learnt, features
from crane_identification.diagnosis.motion_choice import suited
from crane_identification.diagnosis.nearest import Nearest, nearest
from crane_identification.diagnosis.proof import proved
from crane_identification.diagnosis.pulsation import (
    Line,
    Pulsation,
    clearest_lines,
    pulsations,
)
from crane_identification.diagnosis.region import Region, region
from crane_identification.diagnosis.search import Search, search
from crane_identification.diagnosis.strength import detectable
from crane_identification.diagnosis.thresholds import Thresholds
from crane_identification.diagnosis.trial import Trial, tried
from crane_identification.diagnosis.verdict import (
    Reach,
    Verdict,
    judge,
    with_flow,
    with_loads,
    with_pulsation,
)
from crane_identification.options import Options
from crane_identification.preparation.periodicity import periodic_part
from crane_identification.preparation.prepare import Preparation, prepare, prepare_all
from crane_identification.preparation.session import Session, chronological
from crane_identification.validation.carry_over import elsewhere
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.progress import Progress, silent
from crane_model.terms import REGISTRY, Term


@dataclass(frozen=True)
class Diagnosis:
    """Everything that page, summary and text are made of.

    Per joint (j,): `energy` share of the unexplained energy, `regions` that carry it, `learnt` from
    the residual before and after; `correlation_left` of neighbouring rows of what remains, 0 for
    noise. `undetermined` parameters of the given model were left out of it; the answer is sought
    `without` these effects; `uncalibrated` quantities are in counts; `warnings` are about the
    recordings, and say where the model after does not carry over to those held out. `regions_left`
    carry what is left after, and `lines` are the clearest of each joint in its spectrum. `session`
    says whether time runs through all recordings, `fixed` whether the values of the model were
    kept.
    """

    verdict: Verdict
    reason: str
    before: Model
    after: Model
    search: Search
    thresholds: Thresholds
    threshold: float
    findings: tuple[Finding, ...]
    nearest: Nearest | None
    training: Evidence
    held_out: Evidence
    gap: Gap
    energy: np.ndarray
    regions: tuple[Region | None, ...]
    regions_left: tuple[Region | None, ...]
    learnt_before: Learnt
    learnt_after: Learnt
    correlation_left: np.ndarray
    detectable: float
    known: Features
    undetermined: tuple[str, ...]
    without: frozenset[str]
    uncalibrated: tuple[str, ...]
    warnings: tuple[str, ...]
    flows: tuple[Flow, ...]
    flow_unobservable: dict[tuple[str, str], str]
    lines: tuple[Line, ...]
    session: Session
    fixed: bool

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.before.joints

    @property
    def pulsations(self) -> tuple[Pulsation, ...]:
        """The lines in the force that are clear enough."""
        return pulsations(self.lines, self.thresholds)


def diagnose(
    model: Model,
    training: Sequence[Log],
    validation: Sequence[Log],
    options: Options,
    thresholds: Thresholds,
    progress: Progress = silent,
    usual: Usual | None = None,
    without: Collection[str] = (),
    fixed: bool = False,
) -> Diagnosis:
    """Where `model` disagrees with the recordings, and why.

    `usual` says what is usual of the hydraulics (None: the packaged values). `without` names
    effects (types of terms) that the answer is sought without: what else could it be?

    The model is fitted to the training recordings first, so that its values are not what differs.
    With `fixed` they are kept instead, and what differs from them is what has changed.

    `DataError` if recordings cannot be used or do not determine the parameters of the model;
    `ConfigurationError` if an effect is not in the catalogue, or values to keep are missing.
    """
    _check(training, validation, without)
    if fixed:
        changes.check_values(model)
    model = model.of_machine()  # what these recordings carry is asked anew
    logs = chronological((*training, *validation))
    session = Session.of(logs)
    whole = replace(options, average=False)
    prepared = prepare_all(model, logs, whole, progress, session)
    sources = {log.source for log in training}
    train = [p for p in prepared if p.source in sources]
    hold = [p for p in prepared if p.source not in sources]
    given = Training(train, decimation(train, options.decimation), ", ".join(sorted(sources)))
    evidence, before, left_out = (
        (changes.kept(model, train, given.factor), model, ())
        if fixed
        else fitted(model, train, given.factor, given.sources)
    )
    held_out = gather(before, hold, given.factor, first_run=len(train))
    found = search(evidence, _wanted(before, evidence, left_out, without), progress)
    decision = decide(found, thresholds)
    known = features(evidence.moving)
    first = tried(found, before, (), given, known, thresholds)
    progress("what is left", 0.5)
    wanted = suited(found, before, decision.accepted)
    periods, not_periodic = _averaged(model, validation, options)
    proof = proved(found, before, wanted, given, known, held_out, periods, thresholds)
    progress("what is left", 1.0)
    last, gap = proof.trial, proof.gap
    least, undetermined = detectable(found, decision.threshold), _names(model, left_out)
    reach = Reach(found.testable_share, least, undetermined)
    answer, near = judge(first, proof, reach, thresholds), None
    if answer.verdict is Verdict.UNKNOWN:
        objection = answer.objection or decision.objection
        effects = [one.effect for one in proof.short] or last.zero or decision.nearest
        near = nearest(found, before, effects, objection, given, held_out) if effects else None
    answer = with_loads(answer, gap.loads)
    progress("gap", 1.0)
    wrong = {
        one.option.family.where
        for one in last.effects
        if one.option.family.term.family == "sensing"
    }
    flows, no_flow = examine(evidence, held_out, usual or load_usual(), thresholds, wrong)
    fewest = thresholds.method.pulsation_recordings
    lines = clearest_lines(last.model, (*evidence.runs, *held_out.runs), fewest)
    answer = with_pulsation(with_flow(answer, flows), pulsations(lines, thresholds))
    uncalibrated = tuple(dict.fromkeys(name for log in logs for name in log.uncalibrated))
    return Diagnosis(
        verdict=answer.verdict,
        reason=answer.reason,
        before=before,
        after=last.model,
        search=found,
        thresholds=thresholds,
        threshold=decision.threshold,
        findings=tuple(
            Finding(one, in_counts(v) if uncalibrated else v)
            for one, v in zip(last.effects, last.values, strict=True)
        ),
        nearest=near,
        training=evidence,
        held_out=held_out,
        gap=gap,
        energy=_energy(found, first),
        regions=_regions(known, first, evidence),
        regions_left=_regions(known, last, evidence),
        learnt_before=first.learnt,
        learnt_after=last.learnt,
        correlation_left=_correlation(evidence.moving, last),
        detectable=least,
        known=known,
        undetermined=undetermined,
        without=frozenset(without),
        uncalibrated=uncalibrated,
        warnings=(
            *(one for log in logs for one in log.warnings),
            *not_periodic,
            *elsewhere(model.joints, gap.after, gap.training_after, gap.floor),
        ),
        flows=tuple(flows),
        flow_unobservable=no_flow,
        lines=lines,
        session=session,
        fixed=fixed,
    )


def _check(training: Sequence[Log], validation: Sequence[Log], without: Collection[str]) -> None:
    """Whether there is something to ask for, and to ask."""
    for name, logs in (("--train", training), ("--validate", validation)):
        if not logs:
            raise DataError(f"no recordings given; name at least one with {name}")
    check_known(without)


def check_known(effects: Collection[str]) -> None:
    """`ConfigurationError` with all that there are if one of `effects` is not in the catalogue."""
    known = sorted(name for name, cls in REGISTRY.items() if cls.effect)
    if unknown := sorted(set(effects) - set(known)):
        raise ConfigurationError(
            f"{', '.join(unknown)}: no effect that shows in the force; there are {', '.join(known)}"
        )


def _wanted(
    model: Model, evidence: Evidence, left_out: Collection[Term], without: Collection[str]
) -> list[Family]:
    """The families that are asked for: not `without`, and none that the model had."""
    had = {(term.type, getattr(term, "joint", None)) for term in left_out}
    changed = changes.families(evidence.model) if evidence.keeps else []
    return [
        family
        for family in (*families(model, evidence), *changed)
        if family.type not in without and (family.type, family.joint) not in had
    ]


def _names(model: Model, terms: Sequence[Term]) -> tuple[str, ...]:
    """The parameters of terms."""
    return tuple(p.name for term in terms for p in term.parameters(model.setting))


def _averaged(
    model: Model, logs: Sequence[Log], options: Options
) -> tuple[list[Preparation], list[str]]:
    """The validation recordings averaged, those that are periodic; their scatter is the noise.

    Beside them, which of them do not have the period that was given.
    """
    out: list[Preparation] = []
    wrong = []
    for log in logs:
        try:
            periodic_part(log, options.period)
        except DataError as error:
            if options.period is not None:
                wrong.append(f"{error}. Its noise floor is not known.")
            continue  # not periodic: no scatter
        try:
            out += prepare(model, log, replace(options, average=True))
        except DataError:
            continue  # no whole period without a gap
    return out, wrong


def _regions(known: Features, trial: Trial, seen: Evidence) -> tuple[Region | None, ...]:
    """Where what a model leaves of each joint sits."""
    joints = range(len(seen.joints))
    return tuple(region(known, trial.residual[:, j], seen.used[:, j]) for j in joints)


def _energy(found: Search, before: Trial) -> np.ndarray:
    """Share (j,) of the energy beyond noise that each joint carries."""
    channels = np.maximum(before.energy - found.evidence.used.sum(axis=0), 0.0)
    beyond = channels.reshape(-1, len(found.evidence.joints)).sum(axis=0)
    total = float(beyond.sum())
    return beyond / total if total > 0.0 else np.zeros_like(beyond)


def _correlation(seen: Evidence, last: Trial) -> np.ndarray:
    """Correlation (j,) of neighbouring rows of what is left; 0 for white noise."""
    left = last.residual[:, : len(seen.joints)]
    both = seen.used[1:] & seen.used[:-1] & (np.diff(seen.run) == 0)[:, np.newaxis]
    product = np.where(both, left[1:] * left[:-1], 0.0).sum(axis=0)
    power = np.where(seen.used, left**2, 0.0).sum(axis=0)
    share = both.sum(axis=0) / np.maximum(seen.used.sum(axis=0), 1)
    return product / np.maximum(power * share, np.finfo(float).tiny)
