"""Evidence and searches of columns made up for the purpose: one axis, white noise."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.projection import project, whitened_base, whitener
from crane_identification.diagnosis.search import Search
from crane_identification.thresholds import load_thresholds
from crane_model import Model
from crane_model.terms import REGISTRY, Setting, single_axis

ROWS = 600
MODEL = Model("axis", Setting({"axis": "m"}, None), (single_axis.Inertia(joint="axis"),))
MASS = 5.0  # of the model


def normal(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(shape or (ROWS,))


def evidence(
    force: np.ndarray,
    base: np.ndarray,
    run: np.ndarray | None = None,
    runs: Sequence[Run] = (),
    used: np.ndarray | None = None,
) -> Evidence:
    """Force (n,) and base (n, p) while the axis moves; no row is close to a reversal."""
    n = len(force)
    number = np.zeros(n, dtype=int) if run is None else run
    none = np.zeros(n)
    return Evidence(
        model=MODEL,
        runs=tuple(runs),
        time=0.1 * np.arange(n),
        run=number,
        bag=number,
        force=np.stack([force, none], axis=1),
        base=np.stack([base, np.zeros_like(base)], axis=1),
        used=np.stack([np.ones(n, bool) if used is None else used, none > 0.0], axis=1),
    )


def shaped(kind: str, columns: np.ndarray, positive: bool = False) -> ShapedCandidate:
    """A candidate without a shape whose columns (n, k) are made up."""
    candidate = Candidate(REGISTRY[kind], "axis")
    there = np.stack([columns, np.zeros_like(columns)], axis=1)
    return ShapedCandidate(
        candidate, {}, candidate.at({}), there, np.full(columns.shape[1], positive)
    )


def search(given: Evidence, candidates: Sequence[ShapedCandidate]) -> Search:
    white = whitener(given, np.concatenate([one.columns for one in candidates], axis=2))
    base = whitened_base(given, white)
    made = project(white, base, candidates)
    return Search(given, load_thresholds(), white, base, made, {}, {})


def searched(
    columns: Mapping[str, np.ndarray],
    missing: np.ndarray,
    mass: float = MASS,
    positive: Collection[str] = (),
) -> Search:
    """Candidates with these columns, (n,) or (n, k), where the model lacks `missing` (n,). The
    parameters of some must be `positive`.
    """
    base = normal(99)
    force = mass * base + missing + normal(100)
    candidates = [
        shaped(kind, values.reshape(ROWS, -1), kind in positive) for kind, values in columns.items()
    ]
    return search(evidence(force, base[:, np.newaxis]), candidates)
