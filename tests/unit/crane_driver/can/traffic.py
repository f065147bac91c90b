"""Frames of two encoders on a bus that is not as it should be."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_driver import load_layout
from crane_driver.can.assembly import Assembly
from crane_driver.can.codec import Readings
from crane_model import load_machine
from crane_model.machine_files import machine_file

CRANE = load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
CYCLE = 0.005  # s
COUNT = 15  # values of a counter
BEGIN = 1e6  # s: of a computer that has been on for days
JOINTS = {"EncoderBase": ("slew", "inner_boom"), "EncoderBoom": ("outer_boom", "telescope")}
OUTAGES = (0.03, 0.06, 0.075, 0.08, 0.15, 0.5)  # s
RESTARTS = (0.11, 0.3, 1.0)  # s: longer than what counts as missing


class Sent(NamedTuple):
    """One frame: reception [s], message, number of its cycle, counter, when it was sampled [s]."""

    received: float
    message: str
    cycle: int
    counter: int
    sampled: float


@dataclass(frozen=True)
class Bus:
    """Chances of each frame or cycle: to be lost, late (by `delay` [s] on average), overtaken by up
    to 15 ms; of all to be held up (20 ms on average), of an outage, of a device to restart.
    """

    loss: float = 0.0
    late: float = 0.0
    delay: float = 0.005
    overtaken: float = 0.0
    held_up: float = 0.0
    outage: float = 0.0
    restart: float = 0.0

    def frames(
        self, rng: np.random.Generator, cycles: int, messages: Sequence[str] = tuple(JOINTS)
    ) -> list[Sent]:
        """Of so many cycles, as they are received."""
        sent = []
        counters = {message: int(rng.integers(COUNT)) for message in messages}
        newest, silent = dict.fromkeys(messages, 0.0), dict.fromkeys(messages, 0.0)
        held_up, drift = 0.0, rng.uniform(-1e-4, 1e-4)
        for cycle in range(cycles):
            sampled = BEGIN + cycle * CYCLE * (1.0 + drift)
            if rng.random() < self.held_up:
                held_up = sampled + rng.exponential(0.02)
            if rng.random() < self.outage:
                outage = sampled + rng.choice(OUTAGES)
                silent = {message: max(until, outage) for message, until in silent.items()}
            if rng.random() < self.restart:
                message = str(rng.choice(list(messages)))
                silent[message] = max(silent[message], sampled + rng.choice(RESTARTS))
                counters[message] = int(rng.integers(COUNT))
            for message in messages:
                if sampled < silent[message] or rng.random() < self.loss:
                    continue
                late = rng.exponential(self.delay) if rng.random() < self.late else 0.0
                received = max(sampled + 2e-4 + late, held_up, newest[message] + 1e-5)
                newest[message] = received
                if rng.random() < self.overtaken:
                    received += rng.uniform(0.0, 0.015)
                counter = (counters[message] + cycle) % COUNT
                sent.append(Sent(received, message, cycle, counter, sampled))
        return sorted(sent)


BUSES = {
    "good": Bus(),
    "lossy": Bus(loss=0.2),
    "late": Bus(late=0.3, held_up=0.01),
    "reordered": Bus(overtaken=0.3),
    "interrupted": Bus(loss=0.05, outage=0.003),
    "restarting": Bus(loss=0.05, late=0.3, restart=0.002),
}


def any_bus(rng: np.random.Generator) -> Bus:
    """Several troubles at once, each in every other bus."""

    def chance(most: float) -> float:
        return most * rng.random() ** 2 if rng.random() < 0.5 else 0.0

    return Bus(
        loss=chance(0.5),
        late=chance(0.6),
        delay=float(rng.choice([0.002, 0.005, 0.01])),
        overtaken=chance(0.5),
        held_up=chance(0.05),
        outage=chance(0.01),
        restart=chance(0.005),
    )


class Outcome(NamedTuple):
    """Sets put together, and of these: of several cycles, with a stamp that does not increase, with
    one before their sampling; cycles that came whole but made no set; cycles given up.
    """

    sets: int
    mixed: int
    stepping_back: int
    early: int
    whole: int
    incomplete: int


def put_together(frames: list[Sent]) -> Outcome:
    """What an assembly makes of the frames, whose values are the numbers of their cycles."""
    assembly, made, sampled = Assembly(CRANE, "positions"), [], {}
    came: dict[int, set[str]] = {}
    for frame in frames:
        sampled[frame.cycle] = frame.sampled
        came.setdefault(frame.cycle, set()).add(frame.message)
        made += assembly.add(readings(frame))
    made += assembly.finish()
    stamps = [one.stamp for one in made]
    cycles = [set(one.values.values()) for one in made]
    return Outcome(
        sets=len(made),
        mixed=sum(len(one) > 1 for one in cycles),
        stepping_back=int((np.diff(stamps) <= 0).sum()),
        early=sum(
            stamp * 1e-9 < sampled[int(min(one))] - 1e-6
            for stamp, one in zip(stamps, cycles, strict=True)
        ),
        whole=sum(len(messages) == len(JOINTS) for messages in came.values()),
        incomplete=assembly.incomplete,
    )


def readings(frame: Sent) -> Readings:
    values = dict.fromkeys(JOINTS[frame.message], float(frame.cycle))
    stamp = round(frame.received * 1e9)
    return Readings(frame.message, stamp, frame.received, frame.counter, values)
