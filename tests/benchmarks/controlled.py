"""The stand-in machine under a controller of `crane_trajectory.control`, in a loop with delay.

200 Hz; the command that answers a reading is in force 5 ms + U(0, 10) ms later and held.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from crane_driver.velocity_filter import VelocityFilter
from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.effects.form import Planted
from crane_sim.parts.parameters import StandIn
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Sensors
from crane_trajectory.control.hydraulics import Hydraulics
from crane_trajectory.control.interface import Controller, Point, Reading, Wanted

REST = 1.0  # s before and after the motion
DELAY, SPREAD = 0.005, 0.010  # s


class Run(NamedTuple):
    """What truly happened at n readings, (n, j) each."""

    time: np.ndarray  # (n,) s of the motion
    error: np.ndarray  # reference minus true position
    reference_speed: np.ndarray
    velocity: np.ndarray
    command: np.ndarray
    condition: np.ndarray
    power: np.ndarray  # (n,) W that the pump gives


class Loop(NamedTuple):
    """What may be wrong with a loop: additional delay [s]; what a reading becomes."""

    late: float = 0.0
    tamper: Callable[[float, Reading], Reading] | None = None


def true_hydraulics(stand_in: StandIn, machine: Machine, delay: float = 0.0) -> Hydraulics:
    """What the stand-in's file says of its valves and oil."""
    joints = machine.joint_names
    valves = [stand_in.valves[joint] for joint in joints]
    actuators = [machine.cylinders[joint] for joint in joints]
    inside = [stand_in.cylinders[joint] for joint in joints]
    sense = np.array(
        [
            np.sign(lever_arm(machine, joint, np.array([q]))[0])
            for joint, q in zip(joints, stand_in.start, strict=True)
        ]
    )

    def edge(name: str) -> np.ndarray:
        return np.array(
            [
                valve.rated_flow / np.sqrt(valve.rated_drop) * getattr(valve.edges, name)
                for valve in valves
            ]
        )  # fmt: skip

    def of(rows: list, name: str) -> np.ndarray:
        return np.array([getattr(row, name) for row in rows])

    lag = 2.0 * of(valves, "damping_ratio") / (2.0 * np.pi * of(valves, "natural_frequency"))
    null = sense * of(valves, "null_bias")
    same = np.ones(len(joints))
    return Hydraulics(
        sense=sense,
        area_a=of(actuators, "area_a"),
        area_b=of(actuators, "area_b"),
        length_min=of(actuators, "length_min"),
        length_max=of(actuators, "length_max"),
        dead_volume_a=of(inside, "dead_volume_a"),
        dead_volume_b=of(inside, "dead_volume_b"),
        bulk_modulus=stand_in.oil.bulk_modulus * same,
        leakage=of(inside, "leakage"),
        **{name: edge(name) for name in ("supply_a", "a_tank", "supply_b", "b_tank")},
        dead_zone_extend=of(valves, "dead_zone") + null,
        dead_zone_retract=of(valves, "dead_zone") - null,
        play=0.0 * same,
        lag=lag + DELAY + SPREAD / 2.0 + delay,
        supply_pressure=machine.hydraulics.supply_pressure * same,
        tank_pressure=machine.hydraulics.tank_pressure * same,
    )


def drive(
    motion,
    stand_in: StandIn,
    machine: Machine,
    controller: Controller,
    loop: Loop = Loop(),
    planted: tuple[Planted, ...] = (),
    plant: Plant | None = None,
    seed: int = 0,
) -> Run:
    """One run through a motion, from rest to rest."""
    plant = plant or Plant(stand_in, machine, motion.start, planted)
    sensors = Sensors(stand_in.sensors, machine, seed)
    joints, chain = machine.joint_names, stand_in.sensors
    fitted = [joints.index(name) for name in sensors.cylinders]
    rng = np.random.default_rng([seed, 7])
    count = round((motion.duration + 2.0 * REST) / chain.period)
    begin = plant.time
    times = sensors.instants(begin + chain.period, count)
    now = motion.reference(times - begin - REST)
    ahead = motion.reference(times - begin - REST + controller.preview)
    delays = DELAY + loop.late + rng.uniform(0.0, SPREAD, count)
    effect = np.maximum.accumulate(times + delays)
    filtered = VelocityFilter(
        [stand_in.jerk_density[joint] for joint in joints],
        [chain.encoder_resolution[joint] for joint in joints],
    )
    error, speed, velocity, commands, conditions = np.zeros((5, count, len(joints)))
    power = np.zeros(count)
    hydraulics, oil = machine.hydraulics, stand_in.supply
    controller.start(np.zeros(len(joints)))
    u, waiting = np.zeros(len(joints)), []
    period = getattr(getattr(motion, "trajectory", None), "period", 0.0)
    origin = getattr(motion, "excitation_start", 0.0)
    for k in range(count):
        time = float(times[k])
        while waiting and waiting[0][0] <= time:
            due, command = waiting.pop(0)
            if due > plant.time:
                plant.advance(u, due - plant.time)
            u = command
        plant.advance(u, time - plant.time)
        q, v, supply = plant.q, plant.v, plant.supply_pressure
        measured = sensors.positions(q)
        _, slope, _ = filtered.update(time, measured)
        shown = sensors.pressures(
            plant.pressure_a[None], plant.pressure_b[None], np.array([supply]), plant.tank_pressure
        )
        p_a, p_b = np.full((2, len(joints)), np.nan)
        p_a[fitted], p_b[fitted] = shown.chamber_a[0], shown.chamber_b[0]
        reading = Reading(measured, slope, p_a, p_b, float(shown.supply[0]))
        at = time - begin - REST
        if loop.tamper is not None:
            reading = loop.tamper(at, reading)
        phase = (at - origin) % period if period and at >= origin else np.nan
        wanted = Wanted(
            Point(now.position[k], now.velocity[k], now.acceleration[k]),
            Point(ahead.position[k], ahead.velocity[k], ahead.acceleration[k]),
            phase,
        )
        command = controller.command(
            time - float(times[k - 1]) if k else chain.period, reading, wanted
        )
        waiting.append((float(effect[k]), command.copy()))
        error[k], velocity[k], commands[k] = now.position[k] - q, v, command
        speed[k], conditions[k] = now.velocity[k], controller.conditions
        share = np.clip((hydraulics.supply_pressure - supply) / oil.pump_droop, 0.0, 1.0)
        power[k] = supply * hydraulics.pump_flow * share
    return Run(times - begin - REST, error, speed, velocity, commands, conditions, power)
