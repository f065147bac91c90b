"""How clearly an experiment tells hypotheses apart: T-optimality (Atkinson and Fedorov 1975).

Of two hypotheses, one is true, and the other is fitted to what it does: with all parameters of the
model, its own, and its shapes linearised. What that cannot follow, over the noise, is their
separation: the square root of the 2 dlogL to be expected between them. The other way round it is
another one; the smaller counts.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.optimize import nnls

from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.load import Load
from crane_trajectory.settling.prediction import (
    OPEN,
    SAMPLES_A_ROW,
    Hypothesis,
    PlannedRecording,
    gate,
    in_rows,
    with_forces,
)

ROUNDING = 1e-9  # of the largest column: what is left of one below is rounding
ROUNDS = 2  # in which the force settles that terms of a model take from the force


class PlannedExperiment:
    """Recordings, beside a model whose values are known, with noise of the force (j,) a row.

    Raises `DataError` where a term needs what a prediction does not have.
    """

    def __init__(
        self,
        model: Model,
        recordings: Sequence[PlannedRecording],
        noise: np.ndarray,
        row_rate: float,
    ):
        self._model, self._recordings = model, recordings
        self._records = [
            one.record(model, row_rate, run) for run, one in enumerate(recordings, start=1)
        ]
        self._gates = [gate(record, row_rate * SAMPLES_A_ROW) for record in self._records]
        self._used = np.concatenate([in_rows(one) > OPEN for one in self._gates])
        self._weight = 1.0 / noise
        self._seen: dict[Term, np.ndarray] = {}

    @cached_property
    def _known(self) -> list[Record]:
        """With the forces and pressures that the model foretells."""
        out = []
        for run, (record, one) in enumerate(zip(self._records, self._recordings, strict=True), 1):
            force = hung = np.zeros_like(record.position)
            if one.load:
                hung = one.load * _tip((run,)).columns(record, self._model.setting)[:, :, 0]
            for _ in range(ROUNDS):
                known = with_forces(self._model, record, force, one.back_pressure)
                force = self._model.predict(known) + hung
            out.append(with_forces(self._model, record, force, one.back_pressure))
        return out

    @cached_property
    def _basis(self) -> np.ndarray:
        """Orthonormal directions (N, d) of what the model takes up, and the known loads."""
        parts = [self._model.regressor(record) for record in self._known]
        loaded = [run for run, one in enumerate(self._recordings, 1) if one.load]
        columns = self._rows(parts)
        if loaded:
            tip = _tip(loaded)
            weight = [tip.columns(record, self._model.setting) for record in self._known]
            columns = np.concatenate([columns, self._rows(weight)], axis=1)
        return _directions(columns)

    def beside(self, term: Term) -> np.ndarray:
        """Columns (N, k) of a term over the noise, beside what the model takes up."""
        if term not in self._seen:
            columns = self._rows(
                [term.columns(record, self._model.setting) for record in self._known]
            )
            self._seen[term] = columns - self._basis @ (self._basis.T @ columns)
        return self._seen[term]

    def shown(self, one: Hypothesis) -> float:
        """How clearly a hypothesis differs from the model alone."""
        return float(np.linalg.norm(self.beside(one.term) @ one.values))

    def separation(self, one: Hypothesis, other: Hypothesis) -> float:
        """Of two hypotheses, whichever is true."""
        return min(self._left(one, other), self._left(other, one))

    def _left(self, true: Hypothesis, fitted: Hypothesis) -> float:
        """What the second cannot follow of the first."""
        force = self.beside(true.term) @ true.values
        slopes = [
            (self.beside(after) - self.beside(before)) @ fitted.values / apart
            for before, after, apart in fitted.bent()
        ]
        own = self.beside(fitted.term)
        positive = np.array(
            [one.minimum == 0.0 for one in fitted.term.parameters(self._model.setting)]
        )
        free = _directions(np.column_stack([own[:, ~positive], *slopes]))
        bound, left = (values - free @ (free.T @ values) for values in (own[:, positive], force))
        return float(nnls(bound, left)[1]) if positive.any() else float(np.linalg.norm(left))

    def _rows(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(n, j, k) of each recording to the used rows (N, k) of all, over the noise."""
        pairs = zip(parts, self._gates, strict=True)
        rows = np.concatenate([in_rows(part * open_[:, :, None]) for part, open_ in pairs])
        return (rows * self._weight[:, None])[self._used]


def _directions(columns: np.ndarray) -> np.ndarray:
    """Orthonormal directions (N, d) of columns (N, k)."""
    sizes = np.linalg.norm(columns, axis=0)
    columns = columns[:, sizes > 0.0] / sizes[sizes > 0.0]
    if not columns.size:
        return np.zeros((len(columns), 0))
    directions, triangle = np.linalg.qr(columns)
    turned, sizes, _ = np.linalg.svd(triangle)
    found: np.ndarray = directions @ turned[:, sizes > ROUNDING * sizes[0]]
    return found


def _tip(runs: Sequence[int]) -> Payload:
    """A mass at the boom tip in these runs."""
    return Payload(loads=(Load(runs=tuple(runs)),))
