"""The second residual: what the flow of oil tells of valves and oil, joint by joint.

Measured pressures are the input of the torque model, so that valves, leakage and compressibility
cannot show in its residual. They do in the balance of flow, which is fitted as a whole: every
machine has some of each, and an effect is missing where a value is not the usual one.
"""

from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.discrepancy.evidence import Evidence, Run
from crane_identification.discrepancy.filtering import thinned
from crane_identification.discrepancy.hydraulics import Flow, Quantity, Usual
from crane_identification.discrepancy.scaling import normed
from crane_identification.regression import OPEN
from crane_model.errors import DataError
from crane_model.flow import FLOW_REGISTRY, FlowTerm, flow_regressor, piston_flow
from crane_model.flow.oil import InternalLeakage, OilCompressibility
from crane_model.flow.valve import Valve, ValveAsymmetry, ValveDeadZone, ValveHysteresis
from crane_model.machine import Machine
from crane_model.record import Record

LEAST_TIME = 8.0  # s of motion in either direction
LEAST_PRESSURE = 1e5  # Pa above the tank's, below which a chamber is about to be empty
SIGMAS = 3.0  # by which a value must lie outside of what is usual
CLEARLY = 2.0  # times the variance that the usual value leaves on held-out recordings
UNKNOWN_FLOW = 0.1  # share of the flow left unexplained above which the balance tells nothing
WIDEST_DEAD_ZONE = 0.3
WIDEST_PLAY = 0.2
STEP = 0.02  # of the dead zone, for its derivative
SPOOL, LEAK, SOFT, UNEVEN, PLAY = 0, 2, 3, 5, 6  # columns of the balance
UNITS: dict[type[FlowTerm], str] = {InternalLeakage: "m3/(s Pa)", OilCompressibility: "1/Pa"}


def examine(
    evidence: Evidence, held_out: Evidence, usual: Usual, distrusted: Collection[str] = ()
) -> tuple[list[Flow], dict[tuple[str, str], str]]:
    """Each joint whose flow was recorded, and why effects are not observable on the others.

    An effect is missing where its value lies beyond what is usual, and where the usual value
    predicts the flow of the `held_out` recordings clearly worse. Sensors of the joints `distrusted`
    are known to be wrong.
    """
    found: list[Flow] = []
    absent: dict[tuple[str, str], str] = {}
    for joint in evidence.joints:
        try:
            here, there = _Balance(evidence, joint), _Balance(held_out, joint)
            if joint in distrusted:
                raise DataError(f"flow of '{joint}': its sensors may be wrong; settle that first")
            found.append(_examined(here, there, usual))
        except DataError as error:
            effects = [name for name, cls in FLOW_REGISTRY.items() if cls.effect is not None]
            absent |= {(effect, joint): str(error) for effect in sorted(effects)}
    return found, absent


class _Fit(NamedTuple):
    """Parameters of the seven columns, one standard deviation each, and the variance left."""

    values: np.ndarray
    std_devs: np.ndarray
    rest: float


class _Balance:
    """Rows (N,) of the balance of flow of one joint while it moves, both chambers."""

    def __init__(self, evidence: Evidence, joint: str) -> None:
        machine = evidence.model.machine
        if machine is None:
            raise DataError(f"flow of '{joint}': the model has no machine with cylinders")
        self.machine: Machine = machine
        self.joint, self.runs = joint, evidence.runs
        self.leak_and_oil = self._rows(
            lambda run: flow_regressor(
                (InternalLeakage(joint=joint), OilCompressibility(joint=joint)), run.record, machine
            )
        )
        flow = self._rows(lambda run: piston_flow(run.record, machine, joint)[..., np.newaxis])
        self.flow = flow[:, 0]
        up, down = self._times()
        if min(up, down) < LEAST_TIME or not flow.any():
            raise DataError(
                f"flow of '{joint}': it moves up for {up:.0f} s and down for {down:.0f} s, "
                f"{LEAST_TIME:.0f} s each needed; record longer"
            )

    def columns(self, band: float, width: float) -> np.ndarray:
        """(N, 7): spool, its change by a delay, leakage, oil (2), uneven gain, play."""
        spool = self.spool(band)
        parts = (spool[:, :2], self.leak_and_oil, spool[:, 2:], self.play(width))
        return np.concatenate(parts, axis=1)

    def play(self, width: float) -> np.ndarray:
        """(N, 1): what play between command and spool changes, for K = 1."""
        term = ValveHysteresis(joint=self.joint, width=width)
        return self._rows(lambda run: flow_regressor((term,), run.record, self.machine))

    def spool(self, band: float) -> np.ndarray:
        """(N, 3): flow for K = 1 with this dead zone, its rate, and with K = -1 one way."""
        valve = Valve(joint=self.joint)
        terms = valve, ValveDeadZone(joint=self.joint, band=band)

        def columns(run: Run) -> np.ndarray:
            flow = flow_regressor(terms, run.record, self.machine).sum(axis=2)
            way = np.sign(valve.opening(run.record, self.machine))[:, np.newaxis]
            return np.stack([flow, run.record.rate(flow), way * flow], axis=2)

        return self._rows(columns)

    def _filled(self, record: Record) -> np.ndarray:
        """(samples,) where no chamber is about to be empty: then it draws oil past the valve."""
        j, of = record.column(self.joint), f"flow of '{self.joint}'"
        pressures = [record.needed(name, of)[:, j] for name in ("pressure_a", "pressure_b")]
        return np.minimum(*pressures) > record.needed("tank_pressure", of) + LEAST_PRESSURE

    def _times(self) -> tuple[float, float]:
        """How long [s] the joint moves in either direction, where it is asked."""
        times = np.zeros(2)
        for run in self.runs:
            record, j = run.record, run.record.column(self.joint)
            steps = np.diff(record.time, append=record.time[-1:])
            steps = steps * run.gate[:, j] * self._filled(record)
            up = record.velocity[:, j] > 0.0
            times += steps[up].sum(), steps[~up].sum()
        return float(times[0]), float(times[1])

    def _rows(self, of: Callable[[Run], np.ndarray]) -> np.ndarray:
        """(N, k) from (samples, 2, k) of each run, filtered like the torque."""
        parts = []
        for run in self.runs:
            values = of(run)
            if not np.isfinite(values).all():
                raise DataError(f"flow of '{self.joint}': what it needs was not logged throughout")
            gate = run.gate[:, run.record.column(self.joint)] * self._filled(run.record)
            rows = thinned(values * gate[:, np.newaxis, np.newaxis], run.factor)
            rows = rows[thinned(gate, run.factor) > OPEN]
            parts.append(rows.reshape(-1, rows.shape[2]))
        return np.concatenate(parts)


def _examined(here: _Balance, there: _Balance, usual: Usual) -> Flow:
    """All quantities of a joint, from its balance `here`, proved `there`."""
    if here.joint not in usual.dead_zone:
        raise DataError(
            f"flow of '{here.joint}': what is usual of its valve is not known; add its dead_zone"
        )

    def left(band: float) -> float:
        columns = np.concatenate([here.spool(band)[:, :2], here.leak_and_oil], axis=1)
        return _solved(columns, here.flow).rest

    band = _lowest(left, WIDEST_DEAD_ZONE)
    stiff = here.columns(band, WIDEST_PLAY)[:, :PLAY]
    width = _lowest(
        lambda x: _solved(np.concatenate([stiff, here.play(x)], axis=1), here.flow).rest,
        WIDEST_PLAY,
    )
    columns = here.columns(band, width)
    free = _solved(columns, here.flow)
    power = float((here.flow**2).mean())
    unexplained = float(np.sqrt(free.rest / power))
    if unexplained > UNKNOWN_FLOW:
        raise DataError(
            f"flow of '{here.joint}': {unexplained:.0%} of it is left unexplained, at most "
            f"{UNKNOWN_FLOW:.0%} allowed; move faster"
        )
    gain = float(free.values[SPOOL])
    if gain < SIGMAS * free.std_devs[SPOOL]:
        raise DataError(f"flow of '{here.joint}': it does not follow the valve; check its command")
    proof = there.columns(band, width)
    least = float(((there.flow - proof @ free.values) ** 2).mean())

    def judged(
        kind: type[FlowTerm], value: float, std_dev: float, limit: float, part: int | None
    ) -> Quantity:
        """`part`: the column whose parameter is in question, None for the dead zone."""
        unit = UNITS.get(kind, "1")
        value, std_dev = float(value), float(std_dev)
        if abs(value) - limit < SIGMAS * std_dev:
            return Quantity(kind, value, std_dev, unit, limit, 0.0, 0.0, False)
        if part is None:
            tied, other = here.columns(limit, width), there.columns(limit, width)
            values = _solved(tied, here.flow).values
        else:
            tied, other = columns, proof
            fixed = free.values[part] * limit / abs(value)
            rest = np.delete(np.arange(columns.shape[1]), part)
            values = np.zeros(columns.shape[1])
            values[rest] = _solved(columns[:, rest], here.flow - fixed * columns[:, part]).values
            values[part] = fixed
        worse = float(((here.flow - tied @ values) ** 2).mean())
        proved = float(((there.flow - other @ values) ** 2).mean()) > CLEARLY * least
        share = float(np.sqrt(max(worse - free.rest, 0.0) / power))
        score = len(here.flow) * float(np.log(worse / free.rest))
        missing = proved and share > usual.smallest_share
        return Quantity(kind, value, std_dev, unit, limit, share, score, missing)

    values, spread = free.values, free.std_devs
    change = (here.spool(band + STEP)[:, 0] - columns[:, SPOOL]) * gain / STEP
    band_std = float(np.sqrt(free.rest / max(float(change @ change), np.finfo(float).tiny)))
    found = (
        judged(ValveDeadZone, band, band_std, usual.dead_zone[here.joint], None),
        judged(
            *(ValveHysteresis, width * values[PLAY] / gain, width * spread[PLAY] / abs(gain)),
            *(usual.hysteresis, PLAY),
        ),
        judged(
            *(ValveAsymmetry, values[UNEVEN] / gain, spread[UNEVEN] / abs(gain)),
            *(usual.asymmetry, UNEVEN),
        ),
        judged(InternalLeakage, values[LEAK], spread[LEAK], usual.leakage, LEAK),
        judged(OilCompressibility, values[SOFT], spread[SOFT], 1.0 / usual.bulk_modulus, SOFT),
    )
    return Flow(here.joint, found, unexplained, usual.unexplained)


def _lowest(cost: Callable[[float], float], highest: float) -> float:
    """Where the cost is lowest between 0.001 and `highest`."""
    bounds, accuracy = (1e-3, highest), {"xatol": 1e-4}
    found = minimize_scalar(
        lambda x: cost(float(x)), bounds=bounds, method="bounded", options=accuracy
    )
    return float(found.x)


def _solved(columns: np.ndarray, flow: np.ndarray) -> _Fit:
    scaled, norms = normed(columns)
    values = np.linalg.lstsq(scaled, flow, rcond=1e-10)[0]
    rest = float(((flow - scaled @ values) ** 2).mean())
    spread = np.sqrt(rest * np.diag(np.linalg.pinv(scaled.T @ scaled, rcond=1e-10)))
    return _Fit(values / norms, spread / norms, max(rest, np.finfo(float).tiny))
