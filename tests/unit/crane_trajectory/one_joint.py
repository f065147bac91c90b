"""A boom on one cylinder, whose valve is a source of speed, under a controller."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from crane_model import Machine, Model, load_machine
from crane_model.terms.friction import Coulomb, Viscous
from crane_model.terms.single_axis import Gravity, Inertia
from crane_model.terms.term import Setting
from crane_trajectory.control.controller import (
    ControlCondition,
    Controller,
    Point,
    SensorReading,
    Wanted,
)
from crane_trajectory.control.flow_feedforward import ReferenceLoad
from crane_trajectory.control.valves_and_oil import (
    ValvesAndOil,
    edges,
    length_and_lever,
    speed_under_load,
    tables,
)

DT = 0.005  # s
MACHINE: Machine = load_machine("single_axis")
JOINT = MACHINE.joint_names[0]
PERIOD = 4.0  # s
REACH = 0.15  # rad


def model() -> Model:
    """Inertia, weight and friction of the boom."""
    terms = (Inertia(joint=JOINT), Gravity(joint=JOINT), Coulomb(joint=JOINT), Viscous(joint=JOINT))
    empty = Model("boom", Setting(MACHINE.units, MACHINE), terms)
    values = {"inertia": 150.0, "g_s": 0.0, "g_c": 600.0, "f_c": 100.0, "f_v": 200.0}
    theta = [values[p.name.split(".")[0]] for p in empty.parameters]
    return empty.with_estimate(np.array(theta), np.zeros(len(theta)), "by hand")


def hydraulics(**changes: float) -> ValvesAndOil:
    """Of the boom, but for `changes`."""
    actuator = MACHINE.cylinders[JOINT]
    values = {
        "sense": 1.0, "area_a": actuator.area_a, "area_b": actuator.area_b,
        "length_min": actuator.length_min, "length_max": actuator.length_max,
        "dead_volume_a": 1e-4, "dead_volume_b": 1e-4, "bulk_modulus": 1.2e9, "leakage": 0.0,
        "supply_a": 1e-7, "a_tank": 1e-7, "supply_b": 1e-7, "b_tank": 1e-7,
        "dead_band_extend": 0.06, "dead_band_retract": 0.05, "play": 0.0, "lag": 0.015,
        "supply_pressure": 16e6, "tank_pressure": 2e5,
    }  # fmt: skip
    return ValvesAndOil(**{name: np.array([v]) for name, v in (values | changes).items()})


def swing(time: float) -> Point:
    """To and fro from rest, once in `PERIOD`."""
    omega = 2.0 * np.pi / PERIOD
    moving = float(time > 0.0)
    phase = moving * omega * time
    return Point(
        np.array([REACH * (1.0 - np.cos(phase))]),
        np.array([moving * REACH * omega * np.sin(phase)]),
        np.array([moving * REACH * omega**2 * np.cos(phase)]),
    )


class Course(NamedTuple):
    """A run of n cycles."""

    time: np.ndarray  # (n,) s
    error: np.ndarray  # (n,) rad
    command: np.ndarray  # (n,)
    condition: list[ControlCondition]

    def rms(self, begin: float = 0.0, end: float = np.inf) -> float:
        """Of the error between two times."""
        inside = (self.time >= begin) & (self.time < end)
        return float(np.sqrt(np.mean(self.error[inside] ** 2)))

    def had(self, begin: float, end: float) -> set[ControlCondition]:
        """Conditions between two times."""
        pairs = zip(self.time, self.condition, strict=True)
        return {condition for time, condition in pairs if begin <= time < end}


@dataclass
class Boom:
    """The boom itself: `true` hydraulics, late by `delay`; it starts at q = 0."""

    controller: Controller
    true: ValvesAndOil = field(default_factory=hydraulics)
    delay: float = 0.015  # s, from a reading until the spool is there
    answers: Callable[[float], float] = lambda time: 1.0  # what the valve makes of its command
    tamper: Callable[[float, SensorReading], SensorReading] = lambda time, reading: reading
    reference: Callable[[float], Point] = swing
    resolution: float = 4.8e-5  # rad
    noise: float = 1e4  # Pa

    def run(self, duration: float, begin: float = -0.2) -> Course:
        """From `begin` [s] on; the reference moves from 0 on."""
        h = self.true.records()[0]
        table, load = tables(MACHINE)[0], ReferenceLoad(model(), MACHINE)
        rng = np.random.default_rng(0)
        q, v, edge = 0.0, 0.0, 0.0
        commands = [0.0] * round(self.delay / DT)
        times = np.arange(begin, begin + duration, DT)
        rows = []
        for time in times:
            y = h["sense"] * commands[-round(self.delay / DT)] * self.answers(time)
            half = 0.5 * h["play"]
            edge = min(max(edge, y - half), y + half)
            extends = edge > 0.0
            dead = h["dead_band_extend"] if extends else h["dead_band_retract"]
            opening = np.sign(edge) * max(abs(edge) - dead, 0.0) / (1.0 - dead)
            at = self.reference(time)
            _, lever = length_and_lever(table, q)
            force = load(np.array([q]), np.array([v]), at.acceleration)[0] / lever
            gains = edges(h, extends)
            speed = speed_under_load(h, extends, *gains, force, h["supply_pressure"])
            piston = opening * speed
            v = piston / lever
            p_a, p_b = self._pressures(h, extends, gains, opening, piston, force)
            noise = rng.normal(0.0, self.noise, 2)
            measured = round(q / self.resolution) * self.resolution
            reading = SensorReading(
                np.array([measured]), np.array([v]), np.array([p_a + noise[0]]),
                np.array([p_b + noise[1]]), float(h["supply_pressure"]),
            )  # fmt: skip
            ahead = self.reference(time + self.controller.preview)
            wanted = Wanted(at, ahead, time % PERIOD if time >= 0.0 else np.nan)
            u = float(self.controller.command(DT, self.tamper(time, reading), wanted)[0])
            commands.append(u)
            rows.append((at.position[0] - q, u, max(self.controller.conditions)))
            q += DT * v
        error, command, conditions = zip(*rows, strict=True)
        return Course(times, np.array(error), np.array(command), list(conditions))

    @staticmethod
    def _pressures(
        h: np.void, extends: bool, gains: tuple[float, float], opening: float, speed: float,
        force: float,
    ) -> tuple[float, float]:  # fmt: skip
        """Of both chambers, where the valve lets the piston pass at that speed."""
        a, b, supply, tank = h["area_a"], h["area_b"], h["supply_pressure"], h["tank_pressure"]
        if opening == 0.0:
            p_b = 0.3 * supply
            return (force + b * p_b) / a, p_b
        drop_a = (a * speed / (gains[0] * opening)) ** 2
        drop_b = (b * speed / (gains[1] * opening)) ** 2
        return (supply - drop_a, tank + drop_b) if extends else (tank + drop_a, supply - drop_b)
