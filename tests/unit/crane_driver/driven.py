"""A driver on a bad bus, and what it makes of the frames."""

import time
from collections import Counter, defaultdict
from functools import cache

import numpy as np
from unit.crane_driver.can.traffic import BEGIN, CRANE, Bus, Sent

from crane_driver import MachineCodec, load_safety
from crane_driver.can.codec import SignalBits, frame_crc
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout
from crane_driver.driver_loop import DriverLoop, JointSample, PressureSample
from crane_model import load_machine
from crane_model.machine_files import machine_file

MACHINE, SAFETY = load_machine(), load_safety(machine_file("safety.yaml"), load_machine())
MESSAGES = ("EncoderBase", "EncoderBoom", "PressureBooms", "PressureTelescope")
DENSITY = {"slew": 0.01, "inner_boom": 0.01, "outer_boom": 0.02, "telescope": 0.05}
POSE = {"slew": 0.0, "inner_boom": 0.35, "outer_boom": -1.5, "telescope": 0.4}  # rad, m
PRESSURE = 1e6  # Pa
STEP, PRESSURE_STEP = 1e-3, 6105.006105006105  # rad, m; Pa: what a cycle adds to every reading
DAMAGED = 0.02  # part of the frames
FOREIGN = 0.02  # frames with other identifiers and random bytes, as a part of all
FOREIGN_ID = 0x7E0
PROTECTION = {one.name: one.protection for one in CRANE.readings}
COUNTER_BYTE = 1  # of all messages, in its lower half
AT_ONCE = 8  # frames that the driver takes at a time


class Driven:
    """Readings grow by a step in each cycle, so that a sample shows of which ones it is."""

    def __init__(self) -> None:
        self._driver = DriverLoop(CRANE, MACHINE, SAFETY, DENSITY, BEGIN)
        self._sampled: dict[int, float] = {}  # s, by cycle
        self._stamps: defaultdict[str, int] = defaultdict(int)
        self.frames, self.seconds = 0, 0.0  # of processor time in the driver
        self.found: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()

    def drive(self, bus: Bus, rng: np.random.Generator, cycles: int) -> None:
        """Receive what the bus makes of so many cycles, damaged at times, among others."""
        frames = self._frames(bus, rng, cycles)
        samples: list[JointSample | PressureSample] = []
        begin = time.process_time()
        for first in range(0, len(frames), AT_ONCE):
            some = frames[first : first + AT_ONCE]
            joints, pressures = self._driver.receive(some, [], some[-1].steady)
            samples += [*joints, *pressures]
        self.seconds += time.process_time() - begin
        self.frames += len(frames)
        for sample in samples:
            self._judge(sample)
        self.found["given up"] = self._driver.incomplete

    def _frames(self, bus: Bus, rng: np.random.Generator, cycles: int) -> list[Frame]:
        sent = bus.frames(rng, cycles, MESSAGES)
        self._sampled = {one.cycle: one.sampled for one in sent}
        kinds = rng.random(len(sent))
        frames = []
        for one, kind in zip(sent, kinds, strict=True):
            frame = encoded(one)
            if kind < DAMAGED:
                data = bytearray(frame.data)
                data[rng.integers(len(data))] ^= int(rng.integers(1, 256))
                frame = frame._replace(data=bytes(data))
            frames.append(frame)
            if kind > 1.0 - FOREIGN:
                frames.append(frame._replace(id=FOREIGN_ID, data=rng.bytes(8)))
        return frames

    def _judge(self, sample: JointSample | PressureSample) -> None:
        if isinstance(sample, JointSample):
            kind, start, step = "positions", list(POSE.values()), STEP
            values = sample.position
        else:
            kind, start, step = "pressures", [PRESSURE] * 8, PRESSURE_STEP
            values = [*sample.chamber_a, *sample.chamber_b, sample.supply, sample.tank]
        cycles = {round((value - at) / step) for value, at in zip(values, start, strict=True)}
        self.found[kind] += 1
        self.wrong[f"{kind} of two cycles"] += len(cycles) > 1
        self.wrong[f"{kind} stamped before sampling"] += (
            sample.stamp * 1e-9 < self._sampled[min(cycles)] - 1e-6
        )
        self.wrong[f"{kind} stamped before the last"] += sample.stamp <= self._stamps[kind]
        self._stamps[kind] = sample.stamp
        self.wrong = +self.wrong


@cache
def template(message: str, cycle: int) -> Frame:
    """With any counter and checksum."""
    positions = {joint: value + STEP * cycle for joint, value in POSE.items()}
    pressures = dict.fromkeys(CRANE.pressures, PRESSURE + PRESSURE_STEP * cycle)
    return MachineCodec(CRANE).reading_frame(message, positions, pressures, {})


def encoded(one: Sent) -> Frame:
    """The frame as it is received."""
    frame, protection = template(one.message, one.cycle), PROTECTION[one.message]
    data = bytearray(frame.data)
    data[COUNTER_BYTE] = data[COUNTER_BYTE] & 0xF0 | one.counter
    data[protection.crc_byte] = frame_crc(data, protection.crc_byte, protection.data_id)
    stamp = round(one.received * 1e9)
    return frame._replace(data=bytes(data), stamp=stamp, steady=one.received)


def disowned(frame: Frame, readings: tuple[str, ...], layout: Layout = CRANE) -> Frame:
    """The frame as sensors send it that mark these readings as faulty."""
    (message,) = (one for one in layout.readings if one.message.frame_id == frame.id)
    bits, protection = SignalBits(message.message), message.protection
    raw = dict(bits.unpack(frame.data))
    for channel in (*message.positions, *message.pressures):
        if channel.fault and channel.name in readings:
            raw[channel.fault] = 1
    data = bytearray(bits.pack(raw))
    if protection.crc:
        data[protection.crc_byte] = frame_crc(data, protection.crc_byte, protection.data_id)
    return frame._replace(data=bytes(data))
