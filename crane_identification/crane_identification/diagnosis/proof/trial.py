"""A model with effects added: what it is after the fit, refitted jointly, and what it leaves.

Where its values are kept, what changed is estimated alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from crane_identification.diagnosis.decision.cross_validation import folds
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.fit.evidence import residual
from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.diagnosis.proof.extension import Value, extended
from crane_identification.diagnosis.proof.learner import Learnt, learn
from crane_identification.diagnosis.search.energy import left_share, normalized_energy
from crane_identification.diagnosis.search.kept_values import within
from crane_identification.diagnosis.search.search import Search
from crane_identification.thresholds import Thresholds
from crane_model.model_file import Model


@dataclass(frozen=True)
class Trial:
    """`model` is that with the `effects`, fitted; `values` are the parameters of each.

    `zero` are further effects whose parameters may as well be zero, or are no more than usual.

    On the training recordings: its `residual` (n, c), `energy` (c,) of it in units of the noise,
    and `left_share` of the energy beyond noise where the effects act. `learning` tries to learn the
    residual, beyond what is uncertain of values that are kept.
    """

    effects: tuple[Judged, ...]
    zero: tuple[Judged, ...]
    values: tuple[tuple[Value, ...], ...]
    model: Model
    residual: np.ndarray
    energy: np.ndarray
    left_share: float
    learning: Callable[[], Learnt]
    thresholds: Thresholds

    @property
    def formless(self) -> bool:
        """Whether no effect has a law, which leaves something where it is not the machine's."""
        return all(one.shaped.candidate.effect.formless for one in self.effects)

    @cached_property
    def learnt(self) -> Learnt:
        """What could be learnt; it takes a second and more, so only where it is asked for."""
        return self.learning()

    @cached_property
    def law(self) -> np.ndarray:
        """(j,): whether that is a law."""
        return self.learnt.follows_law(self.thresholds)

    def explained(self, before: "Trial") -> float:
        """Share of what can be explained of what is left `before` that the effects do."""
        learnable = np.where(self.law, self.learnt.share, 0.0)
        remaining = float((self.energy[: len(learnable)] * learnable).sum())
        own = max(float((before.energy - self.energy).sum()), 0.0)
        return own / max(own + remaining, np.finfo(float).tiny)


def tried(fit: Fitted, search: Search, effects: Sequence[Judged], thresholds: Thresholds) -> Trial:
    """The model with effects; those whose parameters may as well be zero, or are no
    more than usual, are left out.

    `UndeterminedError` where the recordings do not determine all parameters.
    """
    chosen = tuple(effects)
    while True:
        model, values = extended(search, fit.before, chosen, fit.training)
        sure = tuple(
            one
            for one, own in zip(chosen, values, strict=True)
            if differs(one, own, thresholds.method.parameter_sigmas)
            or differ_together(search, chosen, one, own, thresholds.method.parameter_sigmas)
        )
        if sure == chosen:
            break
        chosen = sure
    evidence = fit.evidence
    left = residual(evidence, model)
    beyond = residual(evidence, within(search, model)) if evidence.keeps else left

    def learning() -> Learnt:
        seen = evidence.moving
        return learn(seen, seen.known, beyond[:, : len(evidence.joints)], folds(seen)[0])

    return Trial(
        effects=chosen,
        zero=tuple(one for one in effects if one not in chosen),
        values=tuple(values),
        model=model,
        residual=left,
        energy=normalized_energy(search, left),
        left_share=left_share(search, [one.shaped for one in chosen]),
        learning=learning,
        thresholds=thresholds,
    )


def differs(one: Judged, values: Sequence[Value], sigmas: float) -> bool:
    """Whether a parameter of an effect is not zero, or has changed, by more than so many standard
    deviations, and by more than is usual; shapes alone say nothing.
    """
    changes = [value.change for value in values[: len(one.shaped.positive)]]
    usual = one.shaped.candidate.effect.usual
    return any(abs(change) > max(sigmas * std_dev, usual) for change, std_dev in changes)


def differ_together(
    search: Search, chosen: Sequence[Judged], one: Judged, values: Sequence[Value], sigmas: float
) -> bool:
    """Whether the parameters of one of the `chosen` effects are not zero together, as surely as a
    single one is by so many standard deviations: where its columns are alike, each may be zero, but
    not all. Of an effect of which some is usual, none is asked together.
    """
    count = len(one.shaped.positive)
    if count < 2 or one.shaped.candidate.effect.usual:
        return False
    projection = search.projection
    numbers = [search.number(each.shaped) for each in chosen]
    columns = np.concatenate([projection.columns_of[number] for number in numbers])
    own = projection.owner[columns] == search.number(one.shaped)
    spread = np.linalg.pinv(projection.gram[np.ix_(columns, columns)], hermitian=True)
    spread = spread[np.ix_(own, own)]
    size = np.sqrt(np.diag(spread))
    changes, std_devs = np.array([value.change for value in values[:count]]).T
    sure = np.divide(changes, std_devs, out=np.zeros(count), where=std_devs > 0.0)
    joint = sure @ np.linalg.pinv(spread / np.outer(size, size), hermitian=True) @ sure
    return bool(joint > chi2.ppf(chi2.cdf(sigmas**2, 1), count))
