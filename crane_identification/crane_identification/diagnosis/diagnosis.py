"""The diagnosis: from logs and a model to a verdict, findings, an extended model, and its proof."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

from crane_identification.data.log import Log
from crane_identification.diagnosis.answer.answer import answered
from crane_identification.diagnosis.answer.verdict import Answer, Verdict
from crane_identification.diagnosis.decision.decision import Decision, decide
from crane_identification.diagnosis.decision.motion_choice import suited
from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.fit.fit import Fitted, fitted
from crane_identification.diagnosis.flow.flow import Flows, examine
from crane_identification.diagnosis.flow.usual import Usual, load_usual
from crane_identification.diagnosis.proof.commanded import Commanded, commanded
from crane_identification.diagnosis.proof.extension import Finding, in_counts
from crane_identification.diagnosis.proof.gap import Gap
from crane_identification.diagnosis.proof.proof import Proof, proved
from crane_identification.diagnosis.search.race import Race
from crane_identification.diagnosis.search.search import Search, search
from crane_identification.diagnosis.search.wanted import wanted
from crane_identification.options import Options
from crane_identification.thresholds import Thresholds
from crane_identification.validation.force_validation import elsewhere
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent
from crane_model.terms import REGISTRY


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis found, step by step, and the answer that this comes to.

    It was sought `without` these effects, and decided by these `thresholds`.
    """

    fit: Fitted
    search: Search
    decision: Decision
    flow: Flows
    proof: Proof
    commanded: Commanded
    answer: Answer
    thresholds: Thresholds
    without: frozenset[str]

    @property
    def verdict(self) -> Verdict:
        """Of the answer."""
        return self.answer.verdict

    @property
    def reason(self) -> str:
        """Of the answer."""
        return self.answer.reason

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.before.joints

    @property
    def before(self) -> Model:
        """The model, fitted."""
        return self.fit.before

    @property
    def after(self) -> Model:
        """The model with the findings, fitted."""
        return self.proof.trial.model

    @property
    def gap(self) -> Gap:
        """Errors of both on recordings that took no part."""
        return self.proof.gap

    @property
    def training(self) -> Evidence:
        """The rows that both were fitted to."""
        return self.fit.evidence

    @property
    def held_out(self) -> Evidence:
        """The rows that took no part."""
        return self.fit.held_out

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What the model lacks, strongest first, with its parameters."""
        trial, counts = self.proof.trial, bool(self.fit.uncalibrated)
        return tuple(
            Finding(one, in_counts(v) if counts else v)
            for one, v in zip(trial.effects, trial.values, strict=True)
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """About the recordings, and where the model after does not carry over to those held out."""
        gap = self.gap
        further = elsewhere(self.joints, gap.after, gap.training_after, gap.floor)
        return (*self.fit.warnings, *further)


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
    own: Collection[str] = (),
) -> Diagnosis:
    """Where `model` disagrees with the recordings, and why.

    `usual` says what is usual of the hydraulics (None: the packaged values). `without` names
    effects (types of terms) that the answer is sought without: what else could it be? Effects of
    the types `own` are reported, named or not.

    The model is fitted to the training recordings first, so that its values are not what differs.
    With `fixed` they are kept instead, and what differs from them is what has changed.

    `DataError` if recordings cannot be used or do not determine the parameters of the model;
    `ConfigurationError` if an effect is not in the catalogue, or values to keep are missing.
    """
    _check(training, validation, without)
    fit = fitted(model, training, validation, options, fixed, progress)
    race = Race(search(fit.evidence, wanted(fit, without), progress), progress)
    decision = suited(race, fit.before, decide(race, thresholds))
    found = race.search  # all of it: the decision is taken
    proof = proved(fit, found, decision.passed, thresholds, progress)
    effects = [one.shaped.candidate for one in proof.trial.effects]
    flow = examine(fit.evidence, fit.held_out, usual or load_usual(), thresholds, effects)
    answer = answered(fit, found, decision, proof, flow, thresholds, own)
    after = proof.gap.carried if proof.trial.effects else fit.before
    moved = commanded(fit, after, validation)
    return Diagnosis(
        fit, found, decision, flow, proof, moved, answer, thresholds, frozenset(without)
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
