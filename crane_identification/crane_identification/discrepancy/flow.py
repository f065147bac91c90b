"""The second residual: what the flow of oil tells of valves and oil, joint by joint.

Measured pressures are the input of the torque model, so that valves, leakage and compressibility
cannot show in its residual. They do in the balance of flow, which is fitted as a whole: every
machine has some of each, and an effect is missing where a value is not the usual one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field
from scipy.optimize import minimize_scalar

from crane_identification.discrepancy.evidence import Evidence, Run
from crane_identification.discrepancy.filtering import thinned
from crane_identification.regression import OPEN
from crane_model.configuration import Schema, load, packaged
from crane_model.errors import DataError
from crane_model.flow import FLOW_REGISTRY, FlowTerm, flow_regressor, piston_flow
from crane_model.flow.oil import InternalLeakage, OilCompressibility
from crane_model.flow.valve import Valve, ValveAsymmetry, ValveDeadZone, ValveHysteresis
from crane_model.machine import Machine
from crane_model.terms import Effect

FEWEST_ROWS = 40
SIGMAS = 3.0  # by which a value must lie outside of what is usual
WIDEST_DEAD_ZONE = 0.3
WIDEST_PLAY = 0.2
STEP = 0.02  # of the dead zone, for its derivative
Positive = Annotated[float, Field(gt=0)]


class Usual(Schema):
    """What is usual of valves and oil; `hydraulics.yaml` says what each is."""

    dead_zone: Positive
    hysteresis: Positive
    asymmetry: Positive
    leakage: Positive
    bulk_modulus: Positive
    smallest_share: Positive


def load_usual(path: Path | None = None) -> Usual:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or packaged("crane_identification", "hydraulics.yaml"), Usual)


@dataclass(frozen=True)
class Quantity:
    """A value of the hydraulics with one standard deviation, and the limit of what is usual.

    `share` of the piston's flow (rms) that it makes up, `score` 2 dlogL that the balance loses
    without it.
    """

    kind: type[FlowTerm]
    value: float
    std_dev: float
    unit: str
    usual: float
    share: float
    score: float
    missing: bool

    @property
    def type(self) -> str:
        """Name of the effect in the catalogue."""
        return str(self.kind.model_fields["type"].default)

    @property
    def effect(self) -> Effect:
        """What people call it."""
        assert self.kind.effect is not None  # only such terms are quantities
        return self.kind.effect


@dataclass(frozen=True)
class Flow:
    """The hydraulics of one joint, and the share of the piston's flow (rms) left unexplained."""

    joint: str
    quantities: tuple[Quantity, ...]
    unexplained: float

    @property
    def missing(self) -> tuple[Quantity, ...]:
        """What is not as usual, strongest first."""
        return tuple(sorted((q for q in self.quantities if q.missing), key=lambda q: -q.score))


def examine(evidence: Evidence, usual: Usual) -> tuple[list[Flow], dict[tuple[str, str], str]]:
    """Each joint whose flow was recorded, and why effects are not observable on the others."""
    found: list[Flow] = []
    absent: dict[tuple[str, str], str] = {}
    for joint in evidence.joints:
        try:
            found.append(_Balance(evidence, joint).examined(usual))
        except DataError as error:
            effects = [name for name, cls in FLOW_REGISTRY.items() if cls.effect is not None]
            absent |= {(effect, joint): str(error) for effect in sorted(effects)}
    return found, absent


class _Judge(NamedTuple):
    """What a quantity is compared with: the power of the flow, rows, and the variance left."""

    smallest_share: float
    power: float
    rows: int
    rest: float

    def quantity(
        self,
        kind: type[FlowTerm],
        value: float,
        std_dev: float,
        unit: str,
        limit: float,
        part: np.ndarray,
    ) -> Quantity:
        """A value that is usual up to `limit`, and the flow (N, ...) that it makes up."""
        energy = float((part**2).mean())
        beyond = max(abs(value) - limit, 0.0)
        share = float(np.sqrt(energy / self.power)) * beyond / max(abs(value), 1e-300)
        return Quantity(
            kind,
            float(value),
            float(std_dev),
            unit,
            limit,
            share,
            score=energy * self.rows / self.rest,
            missing=bool(beyond > SIGMAS * std_dev and share > self.smallest_share),
        )


class _Balance:
    """Rows of the balance of flow of one joint, while it moves."""

    def __init__(self, evidence: Evidence, joint: str) -> None:
        machine = evidence.model.machine
        if machine is None:
            raise DataError(f"flow of '{joint}': the model has no machine with cylinders")
        self.machine: Machine = machine
        self.joint, self.runs = joint, evidence.runs
        self.flow = self._rows(
            lambda run: piston_flow(run.record, machine, joint)[..., np.newaxis]
        )[:, 0]
        if len(self.flow) < FEWEST_ROWS or not self.flow.any():
            raise DataError(f"flow of '{joint}': it hardly moves; record a motion")
        always = self.terms(InternalLeakage(joint=joint), OilCompressibility(joint=joint))
        self.always = always
        self.band = self._most_likely(
            lambda x: np.concatenate([self._spool(x), always], axis=1), WIDEST_DEAD_ZONE
        )

    def terms(self, *terms: FlowTerm) -> np.ndarray:
        """Columns (N, k) of terms."""
        return self._rows(lambda run: flow_regressor(terms, run.record, self.machine))

    def examined(self, usual: Usual) -> Flow:
        """All quantities."""
        base = np.concatenate([self._spool(self.band), self.always], axis=1)
        asymmetry = self._uneven(self.band)
        width = self._most_likely(
            lambda x: np.concatenate([base, self._play(x)], axis=1), WIDEST_PLAY
        )
        columns = np.concatenate([base, asymmetry, self._play(width)], axis=1)
        values, spread, rest = self._solved(columns)
        gain, _, leakage, softness, _, difference, play = values
        spreads = spread / np.abs(gain)
        shut = gain * self.terms(ValveDeadZone(joint=self.joint, band=self.band))
        parts = columns * values

        judge = _Judge(usual.smallest_share, float((self.flow**2).mean()), len(self.flow), rest)
        found = (
            judge.quantity(
                *(ValveDeadZone, self.band, self._band_std(gain, rest), "1"),
                *(usual.dead_zone, shut),
            ),
            judge.quantity(
                *(ValveHysteresis, width * play / gain, width * spreads[6], "1"),
                *(usual.hysteresis, parts[:, 6]),
            ),
            judge.quantity(
                *(ValveAsymmetry, difference / gain, spreads[5], "1"),
                *(usual.asymmetry, parts[:, 5]),
            ),
            judge.quantity(
                *(InternalLeakage, leakage, spread[2], "m3/(s Pa)"),
                *(usual.leakage, parts[:, 2]),
            ),
            judge.quantity(
                *(OilCompressibility, softness, spread[3], "1/Pa"),
                *(1.0 / usual.bulk_modulus, parts[:, 3]),
            ),
        )
        return Flow(self.joint, found, float(np.sqrt(rest / judge.power)))

    def _band_std(self, gain: float, rest: float) -> float:
        """One standard deviation of the dead zone, linearized."""
        change = self._spool(self.band + STEP)[:, 0] - self._spool(self.band)[:, 0]
        slope = gain * change / STEP
        return float(np.sqrt(rest / max(float(slope @ slope), np.finfo(float).tiny)))

    def _spool(self, band: float) -> np.ndarray:
        """Flow for K = 1 through a spool with this dead zone, and its change by a delay."""
        terms = Valve(joint=self.joint), ValveDeadZone(joint=self.joint, band=band)

        def columns(run: Run) -> np.ndarray:
            flow = flow_regressor(terms, run.record, self.machine).sum(axis=2)
            rate = run.record.rate(flow)
            return np.stack([flow, rate], axis=2)

        return self._rows(columns)

    def _uneven(self, band: float) -> np.ndarray:
        """As a spool of K = 1 in one direction, and of K = -1 in the other."""
        valve = Valve(joint=self.joint)
        terms = valve, ValveDeadZone(joint=self.joint, band=band)

        def columns(run: Run) -> np.ndarray:
            flow = flow_regressor(terms, run.record, self.machine).sum(axis=2)
            way = np.sign(valve.opening(run.record, self.machine))
            return (way[:, np.newaxis] * flow)[..., np.newaxis]

        return self._rows(columns)

    def _play(self, width: float) -> np.ndarray:
        return self.terms(ValveHysteresis(joint=self.joint, width=width))

    def _most_likely(self, columns: Callable[[float], np.ndarray], highest: float) -> float:
        """The shape parameter whose columns leave least."""
        found = minimize_scalar(
            lambda x: self._solved(columns(float(x)))[2],
            bounds=(1e-3, highest),
            method="bounded",
            options={"xatol": 1e-4},
        )
        return float(found.x)

    def _solved(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Parameters, their standard deviations, and the variance of what is left."""
        size = np.linalg.norm(columns, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        scaled = columns / size
        values = np.linalg.lstsq(scaled, self.flow, rcond=1e-10)[0]
        rest = float(((self.flow - scaled @ values) ** 2).mean())
        spread = np.sqrt(rest * np.diag(np.linalg.pinv(scaled.T @ scaled, rcond=1e-10)))
        return values / size, spread / size, rest

    def _rows(self, of: Callable[[Run], np.ndarray]) -> np.ndarray:
        """(N, k) from (samples, 2, k) of each run, filtered like the torque; both chambers."""
        parts = []
        for run in self.runs:
            values = of(run)
            if not np.isfinite(values).all():
                raise DataError(f"flow of '{self.joint}': what it needs was not logged throughout")
            j = run.record.column(self.joint)
            gate = run.gate[:, j]
            rows = thinned(values * gate[:, np.newaxis, np.newaxis], run.factor)
            rows = rows[thinned(gate, run.factor) > OPEN]
            parts.append(rows.reshape(-1, rows.shape[2]))
        return np.concatenate(parts)
