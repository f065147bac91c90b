"""What candidates add to the base model: their columns with the base projected out.

By the theorem of Frisch, Waugh and Lovell, least squares on these gives the parameters and the
gain of the full model: no effect is absorbed in Theta, and Theta is not biased by one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from crane_identification.diagnosis.fit.evidence import beside
from crane_identification.diagnosis.search.candidates import ShapedCandidate
from crane_identification.diagnosis.search.whitening import Base, Whitener


@dataclass(frozen=True)
class Projection:
    """Candidates as columns (N, K) of norm one beside the base, and the residual (N,) of the base.

    `owner` (K,) is the number of the candidate of each column, `positive` (K,) its sign constraint,
    `largest` (K,) the size of its coefficient, beyond which it is no such effect, `scale` (K,) what
    one unit of the parameter weighs, `visibility` per candidate, that of its least visible column
    in the zone that most of its rest lies in.
    """

    candidates: tuple[ShapedCandidate, ...]
    columns: np.ndarray
    residual: np.ndarray
    owner: np.ndarray
    positive: np.ndarray
    scale: np.ndarray
    visibility: np.ndarray

    @cached_property
    def largest(self) -> np.ndarray:
        """Of the coefficients (K,), by the size that the parameters of an effect may have."""
        limits = np.array([one.candidate.effect.largest for one in self.candidates])
        return limits[self.owner] * self.scale

    @cached_property
    def gram(self) -> np.ndarray:
        """Inner products of the columns (K, K)."""
        return self.columns.T @ self.columns

    @cached_property
    def score(self) -> np.ndarray:
        """Inner products of the columns with the residual (K,)."""
        return self.columns.T @ self.residual

    @cached_property
    def root(self) -> np.ndarray:
        """R (K, K) with R R^T the Gram matrix: from white noise to scores."""
        power, vectors = np.linalg.eigh(self.gram)
        return vectors * np.sqrt(np.maximum(power, 0.0))

    @cached_property
    def columns_of(self) -> tuple[np.ndarray, ...]:
        """The columns of each candidate."""
        return tuple(np.flatnonzero(self.owner == i) for i in range(len(self.candidates)))

    @cached_property
    def by_count(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """The numbers (m,) and the columns (m, k) of the candidates that have k of them."""
        counts = np.array([len(columns) for columns in self.columns_of], dtype=int)
        groups = ((k, np.flatnonzero(counts == k)) for k in np.unique(counts).tolist())
        return {
            k: (numbers, np.stack([self.columns_of[i] for i in numbers])) for k, numbers in groups
        }

    def kept(self, wanted: np.ndarray) -> Self:
        """The candidates marked in `wanted` (candidates,) alone."""
        numbers = np.flatnonzero(wanted)
        columns = np.isin(self.owner, numbers)
        return type(self)(
            tuple(self.candidates[i] for i in numbers),
            self.columns[:, columns],
            self.residual,
            np.searchsorted(numbers, self.owner[columns]),
            self.positive[columns],
            self.scale[columns],
            self.visibility[numbers],
        )

    def joined(self, other: Self) -> Self:
        """These candidates, then those of `other`."""
        grown = replace(
            self,
            candidates=self.candidates + other.candidates,
            columns=np.concatenate([self.columns, other.columns], axis=1),
            owner=np.concatenate([self.owner, other.owner + len(self.candidates)]),
            positive=np.concatenate([self.positive, other.positive]),
            scale=np.concatenate([self.scale, other.scale]),
            visibility=np.concatenate([self.visibility, other.visibility]),
        )
        # Inner products of the old columns are known.
        mixed = self.columns.T @ other.columns
        grown.__dict__["gram"] = np.block([[self.gram, mixed], [mixed.T, other.gram]])
        return grown


def project(whitener: Whitener, base: Base, candidates: Sequence[ShapedCandidate]) -> Projection:
    """The candidates beside the base, whitened."""
    parts, visibility = [], np.zeros(len(candidates))
    scales = []
    for number, shaped in enumerate(candidates):
        columns = whitener(shaped.columns)
        rest = beside(base.basis, columns)
        norms, whole = np.linalg.norm(rest, axis=0), np.linalg.norm(columns, axis=0)
        visibility[number] = _visibility(columns, rest, whitener.zone).min(initial=1.0)
        scales.append(norms)
        parts.append(np.divide(rest, norms, out=np.zeros_like(rest), where=norms > 1e-12 * whole))
    owner = np.repeat(np.arange(len(candidates)), [len(s) for s in scales])
    return Projection(
        tuple(candidates),
        np.concatenate(parts, axis=1),
        base.residual,
        owner,
        np.concatenate([shaped.positive for shaped in candidates]),
        np.concatenate(scales),
        visibility,
    )


def _visibility(columns: np.ndarray, rest: np.ndarray, zone: np.ndarray) -> np.ndarray:
    """Share (k,) of the norm of columns (N, k) that is their rest, where most of the rest lies."""
    several = range(int(zone.max()) + 1)
    left, whole = (
        np.stack([np.linalg.norm(values[zone == z], axis=0) for z in several])
        for values in (rest, columns)
    )
    most = left.argmax(axis=0)[np.newaxis]
    left, whole = (np.take_along_axis(values, most, axis=0)[0] for values in (left, whole))
    return np.divide(left, whole, out=np.zeros_like(left), where=whole > 0.0)
