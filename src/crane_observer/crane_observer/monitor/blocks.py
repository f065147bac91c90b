"""From samples to blocks: what encoders and flow say of every joint, 20 times a second.

In a block from t0 to t1 the piston of a joint moved, by its encoder and by either chamber,

    x_E = x(q(t1)) - x(q(t0)),    x_A = (int Q_A - V_A/beta [p_A]) / A_A,
    x_B = -(int Q_B - V_B/beta [p_B]) / A_B

with Q less leakage, of `crane_observer.position.flow`, and the supply stands at p_0 - droop Q_S.
Q is not known at the ends of what a chamber or its transducer can show, nor over an open edge that
has next to no drop: a boom that its load stalls has the supply in one chamber and the tank in the
other, and noise of the transducers alone would move it by tenths of a millimetre in a block. But if
the piston goes there as fast as it does by another drop only, d_E from x_E = W sqrt(d_E), further
from the d that is shown than zeros and noise are, one of them is faulty, and its error of d_E - d
made x_E - W sqrt(d).
A faulty sensor moves some of x_E - x_A, x_E - x_B and p_S - p_0 + droop Q_S, and leaves the others:
see `isolation`.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.cylinders import cylinder_length, lever_arm
from crane_model.errors import DataError
from crane_model.hydraulics.simulation import circuit_of, identified
from crane_model.hydraulics.stepping import LAMINAR_DROP_PA, Circuit, chamber_volumes, roots
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_observer.position.flow import (
    FAINT_DROP,
    FLOW_SUMS,
    SPOOL,
    Commands,
    Spools,
    add_interval,
    spools_of,
)

BLOCK = 0.05  # s; of sensors read at 200 Hz ten samples
SHORTEST_PERIOD = 5e-3  # s, of samples at the highest rate
SETTLING = 1.0  # s after the first sample or a gap, until it is known where the spools stand
LONGEST_SAMPLE_GAP = 0.1  # s, beyond which nothing is known of what was between two samples
FEEDING_DROOP = 1e4  # Pa, from which on the pump feeds a joint
LARGEST_SURPLUS = 1e4  # Pa s: what is drawn in a second by which the supply droops FEEDING_DROOP
ZEROS_AND_NOISE = 1e5  # Pa, by which a drop between two transducers may be off
SIDES = np.array([1.0, -1.0])  # of oil in chambers A and B


class SupplyLine:
    """Oil that was pressed back into the supply line, and stands there until it is drawn.

    A load that comes or goes lifts the pressure of a chamber beyond that of the supply. If the
    valve is open to it, oil flows back; the check valve of the pump keeps it in the line, which
    stands above p_0 by as much as it took. From then on the pump delivers nothing, and the line
    follows no droop, until as much was drawn again. Flows do not tell how much came back: a chamber
    may be beyond what its transducer can show, and the flow over an edge that hardly opens is not
    known. So whenever the line is above p_0 while nothing is drawn, it may be as full as its relief
    valve lets it; a transducer that shows too much is found by what it shows once so much was
    drawn.

    Volumes are measured by the droop that they would make in a second, Pa s: so a pump that
    delivers more, which droops less, has the larger line. What is in it at first is not known.
    """

    def __init__(self) -> None:
        self._surplus = LARGEST_SURPLUS

    def add(self, droop: float, above: float, span: float) -> bool:
        """Return whether there may be a surplus in a block of `span` [s] in which joints let the
        supply droop by `droop` [Pa], 0 if that is not known, and it was `above` p_0 [Pa] in the
        mean.
        """
        before = self._surplus
        if above + droop <= 0.0:  # the pump holds it
            self._surplus = 0.0
        elif droop > FEEDING_DROOP:
            self._surplus = max(before - droop * span, 0.0)
        else:
            self._surplus = LARGEST_SURPLUS
        return before > 0.0


def slopes_of_liars(
    missed: Array, wide: Array, from_supply: Flags, drop: Array
) -> tuple[Array, Flags]:
    """How far pistons go for 1 Pa that a faulty transducer shows too much, in the mean over its
    error [m/Pa], and where it is faulty over next to no `drop` [Pa]; all of one shape.

    The flow over such an edge is hardly known, but grows with the root r of the drop: the piston
    asks for a drop d_E, by W r(d_E). They went `missed` [m] further than by these drops; `wide` is
    W [m/Pa^0.5], 0 of an edge that was shut.
    """
    error = error_of_drop(missed, wide, drop) * np.where(from_supply, -1.0, 1.0)
    faulty = (drop < FAINT_DROP) & (np.abs(error) > ZEROS_AND_NOISE)
    return np.divide(missed, error, out=np.zeros_like(missed), where=faulty), faulty


def error_of_drop(missed: Array, wide: Array, drop: Array) -> Array:
    """d - d_E [Pa], NaN of an edge that was shut; see `slopes_of_liars`."""
    asked = roots(drop) + missed / np.where(wide == 0.0, np.nan, wide)
    fourth = asked**4
    square = 0.5 * (fourth + np.sqrt(fourth**2 + 4.0 * fourth * LAMINAR_DROP_PA**2))
    return np.asarray(drop - np.copysign(np.sqrt(square), asked))


class Sample(NamedTuple):
    """Readings of the sensors of j joints at one time; SI units."""

    time: float  # s
    position: Array  # (j,)
    chamber_a: Array  # (j,) Pa
    chamber_b: Array  # (j,) Pa
    supply: float  # Pa

    def exchanged(self, crossed: Flags) -> "Sample":
        """With the transducers of chambers A and B exchanged of joints that are `crossed` (j,)."""
        a, b = self.chamber_a, self.chamber_b
        return self._replace(chamber_a=np.where(crossed, b, a), chamber_b=np.where(crossed, a, b))


class FlowBlock(NamedTuple):
    """Flow balance of j joints over BLOCK, from `begin` to `time` [s].

    An axis of 2 holds chambers A and B.
    """

    begin: float
    time: float
    encoder: Array  # (j,) m, x_E
    flow: Array  # (j, 2) m, x_A and x_B
    crossed: Array  # (j, 2) m, the same if each transducer is in the other chamber
    fed: Array  # (j, 2) m/Pa, by how much x_E - x_A, x_E - x_B grow where p_S is 1 Pa too high
    drop: Array  # (j, 2) m/Pa, the same where p_A, p_B are
    softness: Array  # (j, 2) m/Pa, by how much they jump where p_A, p_B do
    squeezed: Array  # (j, 2) m, by how much they grow where the oil is twice as soft
    leak: Array  # (j, 2) m s-1 Pa m3, by how much for a leak of 1 m3/s/Pa past the piston
    late: Array  # (j, 2) m/s, by how much they grow where the spool moves 1 s later
    null: Array  # (j, 2) m, by how much they go either way if a valve opens sooner by its stroke
    edge: Array  # (j, 2) m that the piston goes by edges which may be open, or not
    known: Flags  # (j, 2) whether the flow is known, or that its transducer is faulty
    pressure: Array  # (j, 2) Pa, mean
    last: Array  # (j, 2) Pa, of the last sample
    supply: float  # Pa, mean, less what the flow that is drawn leaves of it
    drawn: Array  # (j,) Pa, by how much each joint lets the supply droop
    metered: bool  # whether what is drawn is known: each flow is
    surplus: bool  # whether the supply line may hold oil that was pressed back into it
    stroke: Array  # (j,) Pa s/m, by how much it would for 1 m/s
    lever: Array  # (j,) m of the piston for 1 rad or m of the joint
    turned: Array  # (j, 2) m/s by which the speed of flow changed since the last that is known

    @property
    def feeding(self) -> bool:
        """Return whether the pump feeds a joint: else its line may stand at any pressure."""
        fed = float(self.drawn.sum()) > FEEDING_DROOP
        return self.metered and fed and not self.surplus


@dataclass(frozen=True)
class KnownFlow:
    """Values of the model file."""

    model: Model
    machine: Machine
    circuit: Circuit
    spools: Spools

    @classmethod
    def of(cls, model: Model) -> "KnownFlow":
        """`ConfigurationError` names what the model does not hold."""
        machine, _ = identified(model)
        return cls(model, machine, circuit_of(model), spools_of(model))

    @property
    def joints(self) -> tuple[str, ...]:
        return self.model.joints

    def lengths(self, q: Array) -> Array:
        """(j,) of the cylinders [m] at coordinates (j,)."""
        parts = (cylinder_length(self.machine, j, q[i]) for i, j in enumerate(self.joints))
        return np.array([float(part) for part in parts])

    def levers(self, q: Array) -> Array:
        """(j,) of the cylinders [m, 1] at coordinates (j,)."""
        parts = (lever_arm(self.machine, j, q[i : i + 1]) for i, j in enumerate(self.joints))
        return np.concatenate(list(parts))


class Blocks:
    """Gathers samples; the sums of flow are compiled."""

    def __init__(self, physics: KnownFlow):
        self.physics = physics
        joints = len(physics.joints)
        self._commands = Commands.none(joints)
        self._spool = np.zeros(joints, SPOOL)
        self._gathered: list[Sample] = []
        self._shown = np.zeros((2, joints))  # Pa, of the last sample
        self._crossed = np.zeros(joints, dtype=bool)  # whose transducers are exchanged
        self._sums, self._crossed_sums = np.zeros((2, joints), FLOW_SUMS)
        self._length: Array | None = None
        self._speed = np.full((joints, 2), np.nan)  # m/s of flow, the last that is known
        self._line = SupplyLine()
        self._begun: float | None = None

    def exchange(self, joint: int) -> None:
        """From now on, each chamber of a joint is what the transducer of the other shows."""
        self._crossed[joint] = not self._crossed[joint]
        crossed = np.arange(len(self._crossed)) == joint
        self._gathered = [sample.exchanged(crossed) for sample in self._gathered]
        self._shown[:, joint] = self._shown[::-1, joint].copy()

    def command(self, stamp: float, command: Array) -> None:
        """In force from its stamp [s] until the next; (j,) -1..1."""
        self._commands.add(stamp, np.where(np.isfinite(command), command, 0.0))

    def add(self, sample: Sample) -> FlowBlock | None:
        """The block that ends with this sample, if one does, and the spools have settled.

        `DataError` if a sample is incomplete, comes out of order, or behind a gap: the sample is
        not used, and after a gap the next block begins anew.
        """
        gathered, before = self._gathered, self._shown
        if self._crossed.any():
            sample = sample.exchanged(self._crossed)
        shown = np.array([sample.chamber_a, sample.chamber_b])
        readings = shown.sum() + sample.position.sum() + sample.supply
        if not math.isfinite(readings):
            raise DataError(f"sample at {sample.time:.3f} s: a reading is missing")
        if gathered and sample.time <= gathered[-1].time:
            raise DataError(f"sample at {sample.time:.4f} s: out of order or twice")
        if gathered and sample.time - gathered[-1].time > LONGEST_SAMPLE_GAP:
            gap = sample.time - gathered[-1].time
            self._gathered, self._length, self._begun = [sample], None, sample.time
            self._speed[:] = np.nan
            self._line = SupplyLine()
            self._shown = shown
            self._sums[:] = self._crossed_sums[:] = 0.0
            raise DataError(f"no sample for {gap:.3f} s before {sample.time:.3f} s")
        if gathered:
            self._add_flow(gathered[0].time, gathered[-1], sample, before, shown)
        gathered.append(sample)
        self._shown = shown
        if self._begun is None:
            self._begun = sample.time
        if sample.time - gathered[0].time < BLOCK - 0.5 * SHORTEST_PERIOD:
            return None
        block = self._block(gathered)
        self._gathered = [sample]
        self._sums[:] = self._crossed_sums[:] = 0.0
        return None if sample.time < self._begun + SETTLING else block

    def _add_flow(
        self, since: float, last: Sample, sample: Sample, before: Array, shown: Array
    ) -> None:
        supply, spool = 0.5 * (last.supply + sample.supply), self._spool.copy()
        largest = self.physics.machine.hydraulics.transducer_range
        for moved, begun, ended, sums in (
            (self._spool, before, shown, self._sums),
            (spool, before[::-1].copy(), shown[::-1].copy(), self._crossed_sums),
        ):
            add_interval(
                self.physics.circuit, self.physics.spools, self._commands, moved, since,
                last.time, sample.time, begun, ended, supply, largest, sums,
            )  # fmt: skip

    def _block(self, samples: list[Sample]) -> FlowBlock:
        circuit, sums = self.physics.circuit, self._sums
        first, last, inner = samples[0], samples[-1], samples[1:]
        span = last.time - first.time
        before = self.physics.lengths(first.position) if self._length is None else self._length
        x = self._length = self.physics.lengths(last.position)
        areas = np.stack([circuit.area_a, circuit.area_b], axis=1)
        oil = np.stack(chamber_volumes(circuit, x), axis=1)
        softness = oil / circuit.bulk_modulus[:, None] / areas * SIDES
        begun = np.stack([first.chamber_a, first.chamber_b], axis=1)
        ended = np.stack([last.chamber_a, last.chamber_b], axis=1)
        drop = sums["drop"] / areas * SIDES
        p_a = np.mean([sample.chamber_a for sample in inner], axis=0)
        p_b = np.mean([sample.chamber_b for sample in inner], axis=0)
        shown = np.stack([p_a, p_b], axis=1)
        supply = float(np.mean([sample.supply for sample in inner]))
        squeezed = softness * (ended - begun)
        flow = sums["flow"] / areas * SIDES - squeezed
        lost, faint, passed = sums["lost"] > 0.0, sums["faint"] > 0.0, sums["wide"]
        from_supply = passed > 0.0
        left = np.where(from_supply, supply - shown, shown - circuit.tank_pressure)
        wide, missed = passed / areas * SIDES, (x - before)[:, None] - flow
        slope, faulty = slopes_of_liars(missed, wide, from_supply, left)
        drop = np.where(faulty, slope, drop)
        certain = ~lost & ~faint
        turned = np.where(certain, np.nan_to_num(np.abs(flow / span - self._speed)), 0.0)
        self._speed = np.where(certain, flow / span, self._speed)
        drawn = circuit.droop * np.maximum(sums["flow"], 0.0).sum(axis=1) / span
        droop = float(drawn.sum())
        above = supply - circuit.supply_pressure
        crossed = self._crossed_sums["flow"] / areas * SIDES
        return FlowBlock(
            begin=first.time,
            time=last.time,
            encoder=x - before,
            flow=flow,
            crossed=crossed - softness * (ended - begun)[:, ::-1],
            fed=-drop * from_supply,
            drop=drop,
            softness=softness,
            squeezed=-squeezed,
            leak=-((p_a - p_b) * span)[:, None] / areas,
            late=sums["sooner"] / areas * -SIDES,
            null=sums["null"] / areas * SIDES,
            edge=sums["edge"] / areas,
            known=~lost & (~faint | faulty),
            pressure=shown,
            last=ended,
            supply=above + droop,
            drawn=drawn,
            metered=bool(certain.all()),
            surplus=self._line.add(droop if certain.all() else 0.0, above, span),
            stroke=circuit.droop * areas.mean(axis=1),
            lever=self.physics.levers(last.position),
            turned=turned,
        )
