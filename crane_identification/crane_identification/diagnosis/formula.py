"""A short formula for an unknown force: sparse regression over a small grammar.

A formula is a sum of at most `MOST_TERMS` terms. Each term is a coefficient times a shape of one
variable, for example sin(q/c), times 1, the direction sgn(q') or the velocity q' of the joint. The
coefficients and scales c have units. They are fitted to the training recordings, and the formula
counts by how much of the model error it closes on held-out recordings.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from crane_identification.diagnosis.constants import (
    FORMULA_SHARE,
    MOST_SHARE,
    SURE_SIGMAS,
    VISIBLE_SHARE,
)
from crane_identification.diagnosis.evidence import (
    TINY,
    Evidence,
    beside,
    least_squares,
)
from crane_identification.diagnosis.findings import FoundFormula, FoundParameter
from crane_identification.diagnosis.gap import Gap, where_trained
from crane_identification.diagnosis.residuals import (
    OF_NO_JOINT,
    on_rows,
    read,
    solved,
    unit_of,
)
from crane_identification.diagnosis.search import Search
from crane_identification.notation import listed, plain
from crane_model.errors import CraneError
from crane_model.record import Record
from crane_model.terms.nonparametric import FACTORS
from crane_model.terms.term import Variable

NAMES = "abc"  # of the coefficients
MOST_TERMS = len(NAMES)
KEPT_SINGLES = 60  # terms by themselves, the best of which are tried in pairs
ALIKE = 1e-3  # share of the energy of a term that is left beside another, below which both are one
WAVES, STEPS, EDGES = 40, 8, 9  # scales of waves, of curves that level off, and of edges


class Primitive(NamedTuple):
    """A shape in Python, its values, the `power` of x in its unit, and how it is scaled."""

    code: str
    values: Callable[[np.ndarray, float], np.ndarray]
    power: int = 0
    scales: str = ""


PRIMITIVES = (
    Primitive("{x}", lambda x, c: x, 1),
    Primitive("{x}**2", lambda x, c: x**2, 2),
    Primitive("{x}**3", lambda x, c: x**3, 3),
    Primitive("np.abs({x})", lambda x, c: np.abs(x), 1),
    Primitive("np.sin({x}/{c})", lambda x, c: np.sin(x / c), 0, "waves"),
    Primitive("np.cos({x}/{c})", lambda x, c: np.cos(x / c), 0, "waves"),
    Primitive("np.tanh({x}/{c})", lambda x, c: np.tanh(x / c), 0, "steps"),
    Primitive("np.exp(-np.abs({x})/{c})", lambda x, c: np.exp(-np.abs(x) / c), 0, "steps"),
    Primitive("np.maximum({x} - {c}, 0)", lambda x, c: np.maximum(x - c, 0.0), 1, "edges"),
    Primitive("np.maximum({c} - {x}, 0)", lambda x, c: np.maximum(c - x, 0.0), 1, "edges"),
)
WRITTEN = {"np.maximum": "max", "np.": "", "**2": "²", "**3": "³", "- -": "+ "}
"""Python and how it is written in an equation."""
TIMES = {"1": "", "sgn(q')": "record.direction[:, j]", "q'": "record.velocity[:, j]"}
"""Factors of a term, as they are written and as Python has them."""
READ: dict[Variable, tuple[str, str]] = {
    "position": ("q", "record.position[:, {j}]"),
    "velocity": ("q'", "record.velocity[:, {j}]"),
    "acceleration": ("q''", "record.acceleration[:, {j}]"),
    "temperature": ("T", 'self.needed(record, "temperature")'),
    "slew velocity": ("w", 'self.needed(record, "slew_velocity")'),
}
"""Variables, as they are written and as Python has them."""


@dataclass(frozen=True)
class FormulaTerm:
    """The form of a `variable` of joint number `about` at a scale, times a factor."""

    variable: Variable
    about: int
    form: Primitive
    scale: float
    times: str


def formula(search: Search, held_out: Evidence, gap: Gap, j: int) -> FoundFormula | None:
    """The formula that explains the residual of joint number j best; None if no short one does."""
    grammar = _Grammar(search, j)
    best: tuple[float, FoundFormula] | None = None
    known = 0.0
    for terms in grammar.best():
        gain = grammar.gain(terms)
        if best is not None and gain - known < FORMULA_SHARE * grammar.beyond:
            break
        known = gain
        found = _tested(search, held_out, gap, j, terms)
        if best is None or (found.closed_share or 0.0) > best[0] + FORMULA_SHARE:
            best = (found.closed_share or 0.0), found
    return best[1] if best is not None and best[0] >= MOST_SHARE else None


class _Grammar:
    """All terms at a grid of scales, on the whitened rows of one joint, beside the base."""

    def __init__(self, search: Search, j: int) -> None:
        evidence = search.evidence
        self._picks = [pick for pick in search.whitener.picks if pick.channel == j]
        inside = search.whitener.channel == j
        self._basis, self._residual = search.base.basis[inside], search.base.residual[inside]
        noise = inside.sum() - (self._basis**2).sum()  # of rows that the base does not fit
        self.beyond = max(float((self._residual**2).sum() - noise), 1.0)
        self._factors = {times: _rows(evidence, FACTORS[times], j) for times in TIMES}
        self._x: dict[tuple[Variable, int], np.ndarray] = {}
        for variable, about in product(READ, range(len(evidence.joints))):
            if about != j and variable in OF_NO_JOINT:
                continue  # once is enough
            try:
                x = on_rows(variable, evidence, about)
            except CraneError:
                continue  # not recorded
            if np.isfinite(x).all() and np.ptp(x[evidence.used[:, j]]) > 0.0:
                self._x[variable, about] = x
        terms = list(self._all(evidence.used[:, j], j))
        plain = [one for one in terms if not one.form.scales]  # which the model may hold
        white = search.whitener(_columns(evidence, plain, j))
        rest = np.linalg.norm(beside(search.base.basis, white), axis=0)
        seen = rest > VISIBLE_SHARE * np.linalg.norm(white, axis=0)
        held = {one for one, shows in zip(plain, seen, strict=True) if not shows}
        self.terms = [one for one in terms if one not in held]

    def _all(self, used: np.ndarray, j: int) -> Iterator[FormulaTerm]:
        for (variable, about), x in self._x.items():
            span = float(np.ptp(x[used]))
            scales = {
                "": np.ones(1),
                "waves": span / (np.pi * np.arange(1, WAVES + 1)) if variable == "position" else (),
                "steps": span * np.geomspace(0.02, 1.0, STEPS),
                "edges": np.quantile(x[used], np.linspace(0.0, 1.0, EDGES + 2)[1:-1]),
            }
            for times in TIMES if about == j else ("1", "sgn(q')"):
                for form in PRIMITIVES:
                    for scale in np.asarray(scales[form.scales]).tolist():
                        yield FormulaTerm(variable, about, form, scale, times)

    def _products(self, terms: Sequence[FormulaTerm]) -> tuple[np.ndarray, np.ndarray]:
        """Gram matrix (k, k) of what the base leaves of terms, products with the residual (k,)."""
        x, factors = self._x, self._factors
        values = [one.form.values(x[one.variable, one.about], one.scale) for one in terms]
        columns = np.stack(values, axis=1) * np.stack([factors[one.times] for one in terms], axis=1)
        white = np.concatenate(
            [
                sum(a * columns[rows - lag] for lag, a in enumerate(polynomial)) / deviation
                for _, rows, polynomial, deviation in self._picks
            ]
        )
        size = np.linalg.norm(white, axis=0)
        white = white / np.where(size > 0.0, size, 1.0)
        known = self._basis.T @ white
        gram, score = white.T @ white - known.T @ known, white.T @ self._residual
        hidden = np.diag(gram) < VISIBLE_SHARE**2
        score[hidden] = 0.0
        gram[hidden], gram[:, hidden] = 0.0, 0.0
        gram[hidden, hidden] = 1.0
        return gram, score

    def gain(self, terms: Sequence[FormulaTerm]) -> float:
        gram, score = self._products(terms)
        return float(score @ np.linalg.pinv(gram, rcond=1e-9, hermitian=True) @ score)

    def best(self) -> Iterator[list[FormulaTerm]]:
        """The best single term, the best two, and so on, with refined scales."""
        if not self.terms or not self._picks:
            return
        gram, score = self._products(self.terms)
        power = np.diag(gram)
        alone = score**2 / power
        chosen = [int(np.argmax(alone))]
        yield self._refined([self.terms[i] for i in chosen])
        first = np.argsort(alone)[::-1][:KEPT_SINGLES]
        rest = gram[first]
        det = power[first, np.newaxis] * power - rest**2
        both = score[first, np.newaxis] ** 2 * power + score**2 * power[first, np.newaxis]
        both -= 2.0 * score[first, np.newaxis] * score * rest
        apart = det > ALIKE * power[first, np.newaxis] * power
        pairs = np.divide(both, det, out=np.zeros_like(det), where=apart)
        i, k = np.unravel_index(int(np.argmax(pairs)), pairs.shape)
        chosen = [int(first[i]), int(k)]
        while len(chosen) <= MOST_TERMS:
            yield self._refined([self.terms[i] for i in chosen])
            known = np.linalg.pinv(gram[np.ix_(chosen, chosen)], rcond=1e-9, hermitian=True)
            across = gram[chosen]
            left = score - across.T @ known @ score[chosen]
            alone_left = power - np.einsum("ki,kl,li->i", across, known, across)
            apart = alone_left > ALIKE * power
            more = np.divide(left**2, alone_left, out=np.zeros_like(left), where=apart)
            chosen.append(int(np.argmax(more)))

    def _refined(self, terms: list[FormulaTerm]) -> list[FormulaTerm]:
        """The terms with the scales that explain most together, near those of the grid."""
        free = [i for i, one in enumerate(terms) if one.form.scales]
        if not free:
            return terms
        unit = np.array([
            np.ptp(self._x[one.variable, one.about]) if one.form.scales == "edges" else one.scale
            for one in (terms[i] for i in free)
        ])  # fmt: skip
        begin = np.array([terms[i].scale for i in free])

        def at(changes: np.ndarray) -> list[FormulaTerm]:
            scales = dict(zip(free, (begin + unit * changes).tolist(), strict=True))
            return [replace(one, scale=scales.get(i, one.scale)) for i, one in enumerate(terms)]

        def cost(changes: np.ndarray) -> float:
            if np.abs(changes).max() > 0.5:
                return 0.0
            return -self.gain(at(changes))

        simplex = np.vstack([np.zeros(len(free)), 0.05 * np.eye(len(free))])
        options = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 0.1, "maxfev": 150}
        found = minimize(cost, simplex[0], method="Nelder-Mead", options=options)
        return at(found.x)


def _rows(evidence: Evidence, values: Callable[[Record, int], np.ndarray], j: int) -> np.ndarray:
    """Values (samples,) of joint number j of a record on the rows of the evidence (n,)."""
    return np.concatenate([values(run.record, j)[run.kept] for run in evidence.runs])


def _columns(evidence: Evidence, terms: Sequence[FormulaTerm], j: int) -> np.ndarray:
    """The terms (n, c, k), filtered as the force."""
    rows = []
    for run in evidence.runs:
        values = np.zeros((*run.record.position.shape, len(terms)))
        for k, one in enumerate(terms):
            x = read(one.variable, run.record, evidence.model.setting, one.about)
            values[:, j, k] = one.form.values(x, one.scale) * FACTORS[one.times](run.record, j)
        rows.append(run.filtered(values))
    return np.concatenate(rows)


def _tested(
    search: Search, held_out: Evidence, gap: Gap, j: int, terms: Sequence[FormulaTerm]
) -> FoundFormula:
    """The formula with its coefficients, and its effect on the held-out recordings."""
    evidence, terms = search.evidence, list(terms)
    while True:
        columns = _columns(evidence, terms, j)
        fit = solved(search, search.beside(columns))
        sure = np.abs(fit.values) / np.maximum(fit.std_devs, TINY)
        if len(terms) == 1 or sure.min() >= SURE_SIGMAS:
            break
        del terms[int(sure.argmin())]
    rows, left, p = where_trained(evidence, held_out), [], len(evidence.model.parameters)
    for added in (np.zeros_like(fit.values), fit.values):
        theta = np.asarray(evidence.model.theta) if evidence.keeps else None
        if theta is None:  # refitted with the added force
            forces = evidence.base, evidence.force - columns @ added
            theta = least_squares(*map(search.whitener, forces))[:p]
        force = held_out.base[:, :, :p] @ theta + _columns(held_out, terms, j) @ added
        left.append(rows.relative(np.where(held_out.used, held_out.force - force, 0.0)))
    closed = replace(gap.held_to, before=left[0], after=left[1]).closed_on([j])
    pairs = zip(NAMES, terms, fit.values.tolist(), fit.std_devs.tolist(), strict=False)
    return FoundFormula(
        equation=_equation(evidence, j, terms),
        parameters=[
            FoundParameter.of(name, value, std_dev, evidence.unit(_unit(evidence, j, one)))
            for name, one, value, std_dev in pairs
        ],
        before=left[0][j],
        after=left[1][j],
        closed_share=closed,
        source=source(evidence, j, terms),
    )


# The formula in words and as a Python file.


def _equation(evidence: Evidence, j: int, terms: Sequence[FormulaTerm]) -> str:
    told = []
    for name, one in zip(NAMES, terms, strict=False):
        about = "" if one.about == j else f"({evidence.joints[one.about]})"
        shape = one.form.code.format(x=READ[one.variable][0] + about, c=plain(one.scale))
        for python, spoken in WRITTEN.items():
            shape = shape.replace(python, spoken)
        told.append(f"{name} {shape}" + ("" if one.times == "1" else f" {one.times}"))
    return " + ".join(told)


def _unit(evidence: Evidence, j: int, one: FormulaTerm) -> str:
    """The unit of its coefficient."""
    setting, joint = evidence.model.setting, evidence.joints[j]
    coordinate, force = setting.units[joint], setting.force_unit(joint)
    about = None if one.variable in OF_NO_JOINT else evidence.joints[one.about]
    unit, seconds = unit_of(one.variable, about, setting), int(one.times == "q'")
    base, _, time = unit.partition("/")
    powers = {base: one.form.power, "s": 0}
    if time:
        powers["s"] -= one.form.power * int(time.removeprefix("s") or 1)
    powers[coordinate] = powers.get(coordinate, 0) + seconds
    powers["s"] -= seconds
    above = [f"{name}{n if n > 1 else ''}" for name, p in powers.items() if (n := -p) > 0]
    below = [f"{name}{n if n > 1 else ''}" for name, n in powers.items() if n > 0]
    return " ".join([force, *above]) + (f"/{' '.join(below)}" if below else "")


def source(evidence: Evidence, j: int, terms: Sequence[FormulaTerm]) -> str:
    """A Python file for `--terms` with the formula as a term of the joint."""
    joint, equation = evidence.joints[j], _equation(evidence, j, terms)
    columns, parameters = [], []
    for k, one in enumerate(terms):
        number = "j" if one.about == j else f'record.column("{evidence.joints[one.about]}")'
        x = READ[one.variable][1].format(j=number)
        code = one.form.code.format(x=x, c=f"{one.scale:.6g}")
        columns.append(f"({code}) * {TIMES[one.times]}" if TIMES[one.times] else code)
        unit = _unit(evidence, j, one)
        parameters.append(f'Parameter("{NAMES[k]}", "{unit}", None, "coefficient {k + 1}")')
    family = "elasticity" if all(one.times == "1" for one in terms) else "friction"
    variables = listed(list(dict.fromkeys(one.variable for one in terms)))
    return (
        (files(__package__) / "formula_term.txt")
        .read_text(encoding="utf-8")
        .format(
            joint=joint,
            equation=equation,
            name="".join(part.capitalize() for part in joint.split("_")),
            family=family,
            variables=variables,
            parameters=",\n            ".join(parameters),
            columns=",\n            ".join(columns),
        )
    )
