"""Samples in, findings out; the same on the machine and on bags."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_observer.monitor.blocks import BLOCK, Blocks, FlowBlock, KnownFlow, Sample
from crane_observer.monitor.finding import (
    COVERED,
    TRANSDUCERS,
    Part,
    RivalEncoder,
    SensorFinding,
    Wrong,
)
from crane_observer.monitor.isolation import (
    DOUBTED,
    Alarm,
    Suspect,
    encoder_behind,
    isolate,
    named,
    outdone,
)
from crane_observer.monitor.readings import ReadingWatch, StandingWatch
from crane_observer.monitor.tolerance import TOLERANCE_FIELDS, History, Tolerance, excess

BLOCKS_WAITED = 2  # after an alarm, in which others that have the same cause follow
MOST_BLOCKS_WAITED = 16  # of a fault that grew slowly
REFINED = 40  # blocks after which kind and size of what was found are looked at again
EXPLAINED_MISFIT = 0.5  # below which noise does not do what is seen
STUCK_REPEATS = 15  # of a reading, that are as good as stuck once residuals say so
CREEP = TOLERANCE_FIELDS.index("creep")


class SensorsAlone:
    """The monitor of a machine whose hydraulics are not identified: every sensor by itself.

    Takes what `SensorComparison` takes, and finds what readings alone tell.
    """

    def __init__(self, model: Model):
        self._model = model
        self.taken: Array = np.zeros(0)  # nothing is compared
        self.forget()

    def forget(self) -> None:
        """Begin anew: sensors were repaired."""
        joints, units = self._model.joints, self._model.setting.units
        names = [units[joint] for joint in joints]
        self.readings = ReadingWatch(joints, names, self._model.machine)
        self._standing, self._command = StandingWatch(len(joints)), np.zeros(len(joints))
        self.findings: list[SensorFinding] = []
        self._looked = -np.inf

    def take_block(self) -> FlowBlock | None:
        return None

    def command(self, stamp: float, command: Array) -> None:
        """Valve commands (j,) in -1..1; how late they reach the valves is not known."""
        self._command = command

    def add(self, sample: Sample) -> list[SensorFinding]:
        """Add a sample; return the first finding of each sensor so far."""
        self._standing.add(sample, self._command)
        if sample.time < self._looked + BLOCK:
            return []
        self._looked = sample.time
        known = {finding.sensor for finding in self.findings}
        found = [*self.readings.found(sample.time), *self._stuck(sample.time)]
        found = [finding for finding in found if finding.sensor not in known]
        self.findings += found
        return found

    def _stuck(self, time: float) -> list[SensorFinding]:
        """Valves that do not open, or encoders that do not show it."""
        return [
            SensorFinding(
                Part.VALVE, self._model.joints[j], Wrong.STUCK, "", 1.0, 1.0, 1.0,
                float(self._standing.since[j]), time,
                RivalEncoder(self._model.joints[j], Wrong.STUCK),
            )
            for j in np.flatnonzero(self._standing.standing).tolist()
        ]  # fmt: skip

    def interrupted(self) -> list[SensorFinding]:
        return []


class SecondLook(NamedTuple):
    """A finding that is looked at again after some blocks, and how it was isolated."""

    blocks_left: int
    finding: SensorFinding
    alarmed: Array
    watched: Flags


class SensorComparison:
    """The monitor of a machine; the joints of every sample are those of the model, in its order.

    A sensor that was found is not watched any more until `forget`, nor is what is compared with it
    alone. All else is: an encoder with the other chamber, with both once those that were swapped
    are taken for each other, and with chambers that are emptied where the supply is not known.
    """

    def __init__(self, physics: KnownFlow, tolerance: Tolerance):
        """`DataError` if the tolerance is that of other joints."""
        joints = physics.joints
        if tuple(tolerance.joints) != joints:
            raise DataError(
                f"tolerances are those of {', '.join(tolerance.joints)}, the model has "
                f"{', '.join(joints)}; learn them with this model"
            )
        self.physics = physics
        self._learnt, self._trim, self._level = tolerance.rows, tolerance.trim, tolerance.level
        assert physics.model.hydraulics is not None  # else `physics` could not be
        if physics.model.hydraulics.supply is None:
            self._learnt[-1, 0] = np.inf  # how far it droops is not known
        units = physics.model.setting.units
        self._units = tuple(units[joint] for joint in joints)
        self.forget()

    def forget(self) -> None:
        channels = 2 * len(self.physics.joints) + 1
        self._blocks = Blocks(self.physics)
        self._history = History(self._trim)
        self._tolerance = self._learnt.copy()
        self.readings = ReadingWatch(self.physics.joints, self._units, self.physics.machine)
        self._watched = np.ones(channels, dtype=bool)
        self._waiting: int | None = None
        self._span, self._since = 1, 0
        self._trusted = np.ones(channels, dtype=bool)  # transducers
        self._again: SecondLook | None = None
        self._alarmed = np.zeros(channels, dtype=bool)
        self._block: FlowBlock | None = None
        self._newest: FlowBlock | None = None
        self.taken = np.zeros(channels)  # share of what makes an alarm, of each channel
        self.findings: list[SensorFinding] = []

    def take_block(self) -> FlowBlock | None:
        """The block that was completed since this was asked last, if one was."""
        block, self._block = self._block, None
        return block

    def command(self, stamp: float, command: Array) -> None:
        """Valve commands (j,) in -1..1, in force from `stamp` [s] on."""
        self._blocks.command(stamp, command)

    def add(self, sample: Sample) -> list[SensorFinding]:
        """Add a sample and return its new findings; `DataError` names a sample that is not used."""
        block = self._blocks.add(sample)
        if block is None:
            return []
        self._history.add(block, self._trusted)
        self._block = self._newest = block
        found = self._by_readings(block) + self._by_residuals(block)
        self.findings += found
        return found + self._refined(block)

    def _by_readings(self, block: FlowBlock) -> list[SensorFinding]:
        found = []
        for finding in self.readings.found(block.time):
            if self._watched[self._channels(finding.part, finding.joint)].any():
                self._leave(finding.part, finding.joint)
                found.append(finding)
        return found

    def _by_residuals(self, block: FlowBlock) -> list[SensorFinding]:
        taken, spans = excess(self._tolerance, self._history)
        self.taken = taken / self._level
        self._since += 1
        over = (self.taken > 1.0) & self._watched
        if over.any():
            self._alarmed |= over
            if self._waiting is None:
                self._span, self._since = int(spans[over].max()), 0
                self._waiting = min(BLOCKS_WAITED + self._span // 2, MOST_BLOCKS_WAITED)
        if self._waiting is None:
            return []
        if self._waiting:
            self._waiting -= 1
            return []
        return self._judged(block)

    def interrupted(self) -> list[SensorFinding]:
        """End an alarm whose readings stopped; do not report an encoder that others found."""
        if self._waiting is None or self._newest is None:
            return []
        found = self._judged(self._newest)
        self.findings += found
        return found

    def _judged(self, block: FlowBlock) -> list[SensorFinding]:
        alarmed, self._waiting = self._alarmed.copy(), None
        self._alarmed[:] = False
        if not alarmed.any():
            return []
        watched = self._watched.copy()
        suspects = self._suspects(alarmed, watched)
        explained = bool(suspects) and suspects[0].misfit < EXPLAINED_MISFIT
        encoder = encoder_behind(suspects)
        stands = encoder is not None and encoder.kind is Wrong.STUCK  # a loop over it shakes
        if not explained and not stands and (noisy := self._noisy(alarmed, block)):
            return [noisy._replace(rival=self._rival(suspects))]
        if not suspects or not suspects[0].certain:
            return []  # as from stamps that were off: it comes again if it stays
        first = named(suspects)
        self._leave(first.part, first.joint)
        finding = self._told(first, block)
        if finding.part is not Part.ENCODER:
            finding = finding._replace(rival=self._rival(suspects))
        if finding.part is Part.SUPPLY:
            watched[:-1] = False  # what it feeds is compared no more
        elif finding.part in TRANSDUCERS:
            watched[-1] = False  # nor what feeds it, whose sums begin anew
        if finding.kind is not Wrong.SWAPPED:
            self._again = SecondLook(REFINED, finding, alarmed, watched)
        return [finding]

    def _suspects(self, alarmed: Array, watched: Flags) -> list[Suspect]:
        return isolate(
            Alarm(
                self._history, self._tolerance, self.physics.joints, alarmed, watched, self._span,
                self._since,
            )
        )  # fmt: skip

    def _rival(self, suspects: Sequence[Suspect]) -> RivalEncoder | None:
        """The encoder that may be faulty instead of what is named and left. One that is compared
        on, and would be off by less than DOUBTED by now, is none: its fault is found as that grows.
        What a chamber missed of it, because its flow was not known, that comparison does not see.
        """
        encoder = encoder_behind(suspects)
        if encoder is None:
            return None
        j = self.physics.joints.index(encoder.joint)
        known = self._history.known_since(encoder.onset)[j]
        compared = self._watched[self._channels(Part.ENCODER, encoder.joint)] & known
        if compared.any() and encoder.error < DOUBTED:
            return None
        return RivalEncoder(encoder.joint, encoder.kind)

    def _refined(self, block: FlowBlock) -> list[SensorFinding]:
        """The earlier finding with present data; another sensor only if it is clearly better."""
        if self._again is None:
            return []
        left, before, alarmed, watched = self._again
        if left:
            self._again = self._again._replace(blocks_left=left - 1)
            return []
        self._again = None
        self._span = max(self._span, REFINED)
        found = [suspect for suspect in self._suspects(alarmed, watched) if suspect.certain]
        if not found:
            return []
        sensor = before.part, before.joint
        same = next((s for s in found if (s.part, s.joint) == sensor), None)
        alone = before is self.findings[-1] and before.part is not Part.SUPPLY
        first = named(found)
        if alone and (same is None or first.part is not found[0].part or outdone(same, first)):
            self._watched = watched.copy()
            self._leave(first.part, first.joint)
            same = first
        elif same is None:
            return []
        finding, rival = self._told(same, block)._replace(found=before.found), before.rival
        if finding.part is not Part.ENCODER:  # what was a danger stays one
            was = RivalEncoder(before.joint, before.kind) if before.part is Part.ENCODER else rival
            finding = finding._replace(rival=was or self._rival(found))
        self.findings = [finding if known is before else known for known in self.findings]
        return [finding]

    def _noisy(self, alarmed: Array, block: FlowBlock) -> SensorFinding | None:
        """The sensor of an alarmed joint that grew noisy, if one did."""
        noisy = self.readings.noisy_now
        for k, (part, joint) in enumerate(self.readings.sensors):
            if noisy[k] and alarmed[self._channels(part, joint)].any():
                self._leave(part, joint)
                return self.readings.noise(k, block.time)
        return None

    def _told(self, suspect: Suspect, block: FlowBlock) -> SensorFinding:
        kind, unit, size = suspect.kind, suspect.unit, suspect.size
        if suspect.part in (*TRANSDUCERS, Part.SUPPLY):
            sensor = self.readings.sensors.index((suspect.part, suspect.joint))
            if self.readings.repeated[sensor] >= STUCK_REPEATS:
                kind, unit = Wrong.STUCK, ""
        spread = COVERED * suspect.deviation
        return SensorFinding(
            suspect.part, suspect.joint, kind, unit, size, size - spread, size + spread,
            suspect.onset, block.time,
        )  # fmt: skip

    def _channels(self, part: Part, joint: str) -> slice:
        if part is Part.SUPPLY:
            return slice(2 * len(self.physics.joints), None)
        j = self.physics.joints.index(joint)
        begin = 2 * j + (part is Part.PRESSURE_B)
        return slice(begin, begin + (1 if part in TRANSDUCERS else 2))

    def _leave(self, part: Part, joint: str) -> None:
        """Watch no more what is compared with a faulty sensor."""
        channels = self._channels(part, joint)
        if part is Part.PRESSURES:
            self._blocks.exchange(self.physics.joints.index(joint))
            self._history.forget(channels)
            return
        self._watched[channels] = self._alarmed[channels] = False
        if part in (Part.SUPPLY, *TRANSDUCERS):
            self._trusted[channels] = False
        if part is Part.SUPPLY:
            self._history.forget(slice(0, -1))
        elif part in TRANSDUCERS:
            self._history.forget(slice(-1, None))
            self._doubt_leak(part, self.physics.joints.index(joint))
        elif part is Part.VALVE or part is Part.ENCODER:
            self._watched[-1] = False

    def _doubt_leak(self, faulty: Part, joint: int) -> None:
        """Widen the leakage past a piston with a faulty transducer, for the other chamber."""
        circuit = self.physics.circuit
        of_a = faulty is Part.PRESSURE_A
        area = (circuit.area_b if of_a else circuit.area_a)[joint]
        leak = circuit.leakage[joint] * circuit.supply_pressure / area  # m/s
        self._tolerance[2 * joint + of_a, CREEP] += leak
