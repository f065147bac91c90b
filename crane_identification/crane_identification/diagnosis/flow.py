"""The second residual: what the flow of oil tells of valves and oil, joint by joint."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import model_validator

from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.constants import (
    SAME_ASYMMETRY,
    SAME_COMMAND,
    SAME_LEAKAGE,
    SAME_OIL,
    SURE_SIGMAS,
)
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.flow_balance import (
    COLUMNS,
    LEAK,
    PLAY,
    SOFT,
    ZONES,
    FlowRows,
    ProvedBalance,
    Side,
    balance_of,
    power,
    solved,
    with_wear,
)
from crane_identification.thresholds import Method, Thresholds
from crane_model.configuration import Positive, Schema, load
from crane_model.errors import DataError
from crane_model.flow import EDGES, FLOW_EFFECTS, asymmetry, by_chamber
from crane_model.hydraulics import HydraulicValues, JointHydraulics
from crane_model.machine_files import machine_file
from crane_model.terms import Effect

# What is usual of valves and oil: the machine's own values where they are known, else a file's.


class Usual(Schema):
    """Usual values of valves and oil; `hydraulics.yaml` explains each."""

    dead_band: dict[str, Positive]
    hysteresis: Positive
    asymmetry: Positive
    leakage: Positive | dict[str, Positive]
    bulk_modulus: Positive

    @model_validator(mode="after")
    def _of_the_same_joints(self) -> Self:
        match self.leakage:
            case dict() as each if each.keys() != self.dead_band.keys():
                raise ValueError(
                    f"leakage is given of {', '.join(each)}, dead_band of "
                    f"{', '.join(self.dead_band)}; give both of the same joints, or one leakage "
                    "for all"
                )
        return self

    def leakage_of(self, joint: str) -> float:
        """The usual leakage of a joint [m3/(s Pa)]; infinite if the file has none."""
        match self.leakage:
            case dict() as each:
                return each.get(joint, np.inf)
            case float() as same:
                return same


@dataclass(frozen=True)
class JointUsual:
    """Limits of what is usual of one joint: of dead bands towards chambers A and B, hysteresis and
    leakage the highest, of the bulk modulus the lowest, of the asymmetry both. `own`: those about
    the machine's identified values.
    """

    dead_bands: tuple[float, float]
    hysteresis: float
    asymmetry: tuple[float, float]
    leakage: float
    bulk_modulus: float
    own: frozenset[str] = frozenset()


def usual_of(joint: str, usual: Usual, hydraulics: HydraulicValues | None) -> JointUsual:
    """Limits by the joint's own values as far as determined; `DataError` without a dead band."""
    known = hydraulics.joints.get(joint) if hydraulics else None
    own = _own(known) if known and known.chambers else {}
    if joint not in usual.dead_band and "dead_bands" not in own:
        raise DataError(
            f"flow of '{joint}': the usual values of its valve are not known; identify its "
            "hydraulics, or add its dead_band"
        )
    dead_band = usual.dead_band.get(joint, np.inf)
    sheet = JointUsual(
        dead_bands=(dead_band, dead_band),
        hysteresis=usual.hysteresis,
        asymmetry=(-usual.asymmetry, usual.asymmetry),
        leakage=usual.leakage_of(joint),
        bulk_modulus=usual.bulk_modulus,
    )
    return replace(sheet, **own, own=frozenset(own))


def _own(known: JointHydraulics) -> dict[str, Any]:
    """Limits about values that are determined, by the names in `JointUsual`."""
    values = known.values

    def beyond(name: str, same: float) -> float:
        one = values[name]
        return one.value + same + SURE_SIGMAS * (one.std_dev or 0.0)

    d_a, d_b = values["dead_band_a"].value, values["dead_band_b"].value
    strokes = 1.0 - np.array([d_a, d_b, d_b, d_a])  # of EDGES, to fully open
    centre = asymmetry(np.array([values[edge].value for edge in EDGES]) / strokes)
    oil = values["bulk_modulus"]
    limits = {
        "dead_bands": (
            beyond("dead_band_a", SAME_COMMAND),
            beyond("dead_band_b", SAME_COMMAND),
        ),
        "hysteresis": beyond("hysteresis", SAME_COMMAND),
        "asymmetry": (centre - SAME_ASYMMETRY, centre + SAME_ASYMMETRY),
        "leakage": beyond("leakage", SAME_LEAKAGE),
        "bulk_modulus": (1.0 - SAME_OIL) * oil.value - SURE_SIGMAS * (oil.std_dev or 0.0),
    }
    parts = {
        "dead_bands": {"dead_band_a", "dead_band_b"},
        "asymmetry": {*EDGES, "dead_band_a", "dead_band_b"},
    }
    unknown = set(known.undetermined)
    return {name: one for name, one in limits.items() if not parts.get(name, {name}) & unknown}


def load_usual(path: Path | None = None) -> Usual:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or machine_file("hydraulics.yaml"), Usual)


# Measured pressures are the input of the torque model, so that valves, leakage and compressibility
# cannot show in its residual. They do in the balance of flow, which is fitted as a whole: every
# machine has some of each, and an effect is missing where a value is not the usual one.


@dataclass(frozen=True)
class Quantity:
    """A value of the hydraulics, and the limit of what is usual, the machine's `own` if it was
    identified; `type` is its name in FLOW_EFFECTS. With the limit in its place, `share` of the
    piston's flow (rms) more is unexplained, and the balance loses the `score` 2 dlogL.
    """

    type: str
    value: float
    std_dev: float
    usual: float
    own: bool
    determined: bool
    share: float = 0.0
    score: float = 0.0
    missing: bool = False
    along_stroke: bool = False

    @property
    def limit(self) -> str:
        return "what was identified of it" if self.own else "what is usual"

    @property
    def effect(self) -> Effect:
        return FLOW_EFFECTS[self.type].effect

    @property
    def unit(self) -> str:
        return FLOW_EFFECTS[self.type].unit


class Gain(NamedTuple):
    """Gain of a metering edge [m3/(s Pa^0.5)], and whether the edge was used enough to tell."""

    edge: str
    value: float
    std_dev: float
    determined: bool


@dataclass(frozen=True)
class Flow:
    """The hydraulics of one joint, the share of the piston's flow (rms) left unexplained, the most
    of it that is `usual`, its correlation, and the share of its energy that `air` would explain.
    `quantities` is empty if too much is left for any value to be good.
    """

    joint: str
    quantities: tuple[Quantity, ...]
    gains: tuple[Gain, ...]
    unexplained: float
    usual: float
    correlation: float
    air: float
    known: float
    recorded: float
    method: Method

    @property
    def undetermined(self) -> tuple[str, ...]:
        edges = (f"gain of the edge {one.edge}" for one in self.gains if not one.determined)
        return (*edges, *(one.effect.name for one in self.quantities if not one.determined))

    @property
    def missing(self) -> tuple[Quantity, ...]:
        """Quantities that are not usual, strongest first; none if the rest is `unknown`."""
        return () if self.unknown else self._beyond

    @property
    def unknown(self) -> bool:
        """Return whether most of what is left has a law that is none of the quantities'."""
        named = sum(one.share**2 for one in self._beyond)
        beyond, method = named + self.unexplained**2, self.method
        # air acts in moments that are too short for neighbouring rows to be alike
        law = self.correlation >= method.flow_law_correlation or self.airy
        return law and self.unexplained > self.usual and named < method.flow_named_share * beyond

    @property
    def airy(self) -> bool:
        return self.air > self.method.flow_named_share

    @property
    def _beyond(self) -> tuple[Quantity, ...]:
        found = sorted((q for q in self.quantities if q.missing), key=lambda q: -q.score)
        least = self.method.further_share
        return tuple(q for q in found if q.share**2 >= least * found[0].share ** 2)


@dataclass(frozen=True)
class Flows:
    """The hydraulics of each joint whose flow was recorded, and why others are `unobservable`."""

    found: tuple[Flow, ...]
    unobservable: dict[tuple[str, str], str]


# Quantities of valve and oil of a joint, each beside the best balance in which it is as usual.

EFFECTS = {
    "dead_bands": "valve_dead_band",
    "hysteresis": "valve_hysteresis",
    "asymmetry": "valve_asymmetry",
    "leakage": "internal_leakage",
    "bulk_modulus": "oil_compressibility",
}
"""Effects in FLOW_EFFECTS that are missing if a limit in `JointUsual` is passed."""

Tied = Callable[[Side, np.ndarray], tuple[np.ndarray, np.ndarray | float]]
"""From a side and its columns to those of a balance with one quantity as it usually is, and the
part of the flow that is then known."""


class Quantities:
    """The quantities of a joint's balance, beside their usual values."""

    def __init__(self, balance: ProvedBalance, usual: JointUsual, thresholds: Thresholds) -> None:
        self._balance, self._usual = balance, usual
        self._gates, self._method = thresholds.gates, thresholds.method

    def all(self) -> tuple[Quantity, ...]:
        """In the order of EFFECTS."""
        usual = self._usual
        return (
            self._dead_band(),
            self._of_column("hysteresis", PLAY, self._balance.spool.play, usual.hysteresis),
            self._asymmetry(),
            self._of_column("leakage", LEAK, 1.0, usual.leakage),
            self._of_column("bulk_modulus", SOFT, 1.0, 1.0 / usual.bulk_modulus),
        )

    def _dead_band(self) -> Quantity:
        balance = self._balance
        limits, zones = self._usual.dead_bands, balance.spool.dead_bands
        a, b = (min(zone, limit) for zone, limit in zip(zones, limits, strict=True))
        usual = balance.spool._replace(dead_bands=(a, b))
        beyond = [zone - limit for zone, limit in zip(zones, limits, strict=True)]
        fixed = [part for part, excess in zip(ZONES, beyond, strict=True) if excess > 0.0]

        def tied(side: Side, _: np.ndarray) -> tuple[np.ndarray, float]:
            return np.delete(side.columns(usual), fixed, axis=1), 0.0

        k = int(np.argmax(beyond))
        std_dev = balance.std_dev(balance.unit(ZONES[k]))
        return self._judged("dead_bands", zones[k], std_dev, limits[k], tied)

    def _asymmetry(self) -> Quantity:
        (lowest, highest), values = self._usual.asymmetry, self._balance.fitted.values
        gains = values[: len(EDGES)]
        (mean_a, mean_b), shares = by_chamber(gains)
        value = asymmetry(gains)
        limit = highest if value > (lowest + highest) / 2.0 else lowest
        usual_a, usual_b = shares + (limit - value)
        gradient = np.zeros(len(values))
        gradient[:2] = gains[[1, 0]] * (1.0, -1.0) / (2.0 * mean_a) ** 2
        gradient[2:4] = gains[[3, 2]] * (-1.0, 1.0) / (2.0 * mean_b) ** 2

        def tied(_: Side, columns: np.ndarray) -> tuple[np.ndarray, float]:
            supply_a, a_tank, supply_b, b_tank = columns[:, : len(EDGES)].T
            chambers = (
                (1.0 + usual_a) * supply_a + (1.0 - usual_a) * a_tank,
                (1.0 - usual_b) * supply_b + (1.0 + usual_b) * b_tank,
            )
            return np.column_stack([*chambers, columns[:, len(EDGES) :]]), 0.0

        std_dev = self._balance.std_dev(gradient)
        beyond = value - limit if limit == highest else limit - value
        return self._judged("asymmetry", value, std_dev, limit, tied, beyond)

    def _of_column(self, name: str, part: int, unit: float, limit: float) -> Quantity:
        """A quantity that is a parameter times a `unit`."""
        values = self._balance.fitted.values
        value = float(values[part])
        fixed = limit / unit
        own = [part, *range(COLUMNS, len(values))] if part == LEAK else [part]

        def tied(_: Side, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return np.delete(columns, own, axis=1), fixed * columns[:, part]

        std_dev = unit * self._balance.std_dev(self._balance.unit(part))
        judged = self._judged(name, unit * value, std_dev, limit, tied)
        return replace(judged, along_stroke=len(own) > 1)

    def _judged(
        self,
        name: str,
        value: float,
        std_dev: float,
        limit: float,
        tied: Tied,
        beyond: float | None = None,
    ) -> Quantity:
        """Beside the best balance in which the value, which lies `beyond` the limit, is usual."""
        sigmas = self._method.flow_sigmas * std_dev
        judged = Quantity(
            type=EFFECTS[name],
            value=value,
            std_dev=std_dev,
            usual=limit,
            own=name in self._usual.own,
            determined=sigmas <= max(abs(value), abs(limit)),
        )
        if not (value - limit if beyond is None else beyond) >= sigmas:
            return judged
        balance = self._balance
        columns, known = tied(balance.here, balance.columns)
        flow, rest = balance.here.rows.flow, balance.fitted.rest
        fit = solved(columns, flow - known)
        columns, known = tied(balance.there, balance.proof)
        left = power(balance.there.rows.flow - known - columns @ fit.values)
        share = float(np.sqrt(max(fit.rest - rest, 0.0) / balance.flow_power))
        score = len(flow) * float(np.log(fit.rest / rest))
        proved = left > self._method.flow_proof_factor * balance.least
        missing = proved and share > self._gates.smallest_flow_share
        return replace(judged, share=share, score=score, missing=missing)


def examine(
    evidence: Evidence,
    held_out: Evidence,
    usual: Usual,
    thresholds: Thresholds,
    named: Sequence[Candidate] = (),
) -> Flows:
    """The flow of each joint: missing are values that predict `held_out` better than usual ones."""
    distrusted = {one.where for one in named if one.term.is_of_sensors()}
    found: list[Flow] = []
    absent: dict[tuple[str, str], str] = {}
    for joint in evidence.joints:
        try:
            here, there = FlowRows(evidence, joint), FlowRows(held_out, joint)
            if joint in distrusted:
                raise DataError(f"flow of '{joint}': its sensors may be wrong; resolve that first")
            own = usual_of(joint, usual, evidence.model.hydraulics)
            found.append(_flow(here, there, own, thresholds))
        except DataError as error:
            absent |= {(effect, joint): str(error) for effect in sorted(FLOW_EFFECTS)}
    return Flows(tuple(found), absent)


def _flow(here: FlowRows, there: FlowRows, usual: JointUsual, thresholds: Thresholds) -> Flow:
    """The quantities and the rest of the balance of a joint; `DataError` if noise hides them."""
    gates, method = thresholds.gates, thresholds.method
    balance = balance_of(here, there)
    if balance.unexplained > gates.unexplained_flow:
        balance = with_wear(balance, method.flow_named_share)
    noise = balance.unexplained > method.flow_noise_share
    if noise and balance.correlation < method.flow_law_correlation:
        raise DataError(
            f"flow of '{here.joint}': {balance.unexplained:.0%} of it is noise, at most "
            f"{method.flow_noise_share:.0%} allowed; move faster"
        )
    gains = _gains(balance, here.joint, method)
    air, values = balance.beside(here.air, there.air)
    return Flow(
        joint=here.joint,
        quantities=() if noise else Quantities(balance, usual, thresholds).all(),
        gains=gains,
        unexplained=balance.unexplained,
        usual=gates.unexplained_flow,
        correlation=balance.correlation,
        air=air if values[-1] > 0.0 else 0.0,
        known=here.known,
        recorded=here.recorded,
        method=method,
    )


def _gains(balance: ProvedBalance, joint: str, method: Method) -> tuple[Gain, ...]:
    """The metering edges; `DataError` if the flow does not follow them."""
    gains = []
    for k, edge in enumerate(EDGES):
        value, std_dev = float(balance.fitted.values[k]), balance.std_dev(balance.unit(k))
        gains.append(Gain(edge, value, std_dev, abs(value) >= method.flow_sigmas * std_dev))
    known = [gain for gain in gains if gain.determined]
    wrong = [gain.edge for gain in known if gain.value < 0.0]
    if wrong or not known:
        raise DataError(
            f"flow of '{joint}': it does not follow the valve"
            + (f", and runs against it at the edge {', '.join(wrong)}" if wrong else "")
            + "; check sign and log of its command, and that its chambers are not exchanged"
        )
    return tuple(gains)
