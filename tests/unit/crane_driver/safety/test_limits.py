"""Limits of Table 2 against simple machines of every kind, and against the simulated crane."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from crane_driver import VelocityFilter, load_safety
from crane_driver.safety.commands import JointLimiter
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_model.sensors import in_counts
from crane_sim import Plant, load_simulated_crane

JOINTS = load_machine().joint_names
MACHINE, SAFETY = load_machine(), load_safety(machine_file("safety.yaml"), load_machine())
CYCLE = 0.005  # s
ROUNDING = 1e-6  # rad, m
SWING = 0.005  # rad, m, by which the load swings on the oil when it is stopped


def limiter(joint: str) -> JointLimiter:
    return JointLimiter(MACHINE.limits[joint], SAFETY.deceleration[joint], SAFETY)


joints = st.sampled_from(JOINTS)
commands = st.floats(-1.0, 1.0)


@given(joints, commands, st.floats(-4.0, 4.0), st.floats(-2.0, 2.0))
def test_a_limited_command_is_never_larger_nor_of_the_other_sign(
    joint: str, command: float, position: float, velocity: float
) -> None:
    limited = limiter(joint).limit(command, position, velocity, CYCLE)
    assert abs(limited) <= abs(command)
    assert limited * command >= 0.0


@given(joints, st.floats(0.01, 1.0), st.floats(0.0, 3.0), st.floats(-2.0, 2.0))
def test_at_a_limit_only_the_way_back_is_open(
    joint: str, size: float, beyond: float, velocity: float
) -> None:
    limits = MACHINE.limits[joint]
    above, below = limits.position_max + beyond, limits.position_min - beyond
    assert limiter(joint).limit(size, above, velocity, CYCLE) == 0.0
    assert limiter(joint).limit(-size, below, velocity, CYCLE) == 0.0
    assert limiter(joint).limit(-size, above, 0.0, SAFETY.opening_time) == -size
    assert limiter(joint).limit(size, below, 0.0, SAFETY.opening_time) == size


@given(joints, st.floats(0.0, 0.99), st.sampled_from((-1.0, 1.0)), st.floats(0.0, 1.0))
def test_within_table_2_commands_pass_unchanged(
    joint: str, share: float, direction: float, size: float
) -> None:
    limits = MACHINE.limits[joint]
    fastest = limits.velocity_max if direction > 0 else -limits.velocity_min
    middle = (limits.position_min + limits.position_max) / 2
    one, command = limiter(joint), direction * size
    one.limit(command, middle, 0.0, SAFETY.opening_time)
    for _ in range(20):
        assert one.limit(command, middle, share * direction * fastest, CYCLE) == command


@example("slew", 3.94, 0.001, 0.0122, [1.0, 1.0, 1.0, 0.3, 0.3, 0.0, 1.0])  # again, close by
@settings(max_examples=40, deadline=None)
@given(
    joints,
    st.floats(0.5, 4.0),  # speed at full spool, times that of Table 2
    st.floats(0.0, 0.1),  # dead band
    st.floats(0.005, 0.05),  # s, lag of the valve
    st.lists(commands, min_size=1, max_size=12),
)
def test_no_machine_is_driven_beyond_a_limit(
    joint: str, gain: float, dead_band: float, lag: float, levels: list[float]
) -> None:
    limits, one = MACHINE.limits[joint], limiter(joint)
    span = limits.position_max - limits.position_min
    fastest = max(limits.velocity_max, -limits.velocity_min)
    position, spool = (limits.position_min + limits.position_max) / 2, 0.0
    per_level = int(1.5 * span / fastest / CYCLE / len(levels)) + 1
    for level in levels:
        for _ in range(per_level):
            opened = math.copysign(max(abs(spool) - dead_band, 0.0), spool)
            speed = gain * fastest * opened / (1.0 - dead_band)
            command = one.limit(level, position, speed, CYCLE)
            spool += (command - spool) * min(1.0, CYCLE / lag)
            position += CYCLE * speed
            assert limits.position_min - ROUNDING <= position <= limits.position_max + ROUNDING


class Driven(NamedTuple):
    """What a joint of the simulated crane did at full spool, positive towards a limit."""

    way: np.ndarray  # (n,) rad, m, of the joint to the limit
    speed: np.ndarray  # (n,)
    fastest: float  # rad/s, m/s, Table 2


def driven(
    joint: str, direction: float, way: float, cycles: int, share: float = 1.0, late: int = 0
) -> Driven:
    """From a `way` before its limit, with a share of the speed of Table 2; the limiter knows the
    motion `late` cycles later than the encoders.
    """
    simulated, i = load_simulated_crane(), JOINTS.index(joint)
    limits = MACHINE.limits[joint]
    end = limits.position_max if direction > 0 else limits.position_min
    pose = simulated.start
    pose[i] = end - direction * way
    plant = Plant(simulated, MACHINE, pose)
    chain = simulated.sensors
    velocity_filter = VelocityFilter(
        [simulated.jerk_density[one] for one in JOINTS],
        [chain.encoder_resolution[one] for one in JOINTS],
    )
    one, u, told, rows = limiter(joint), np.zeros(4), [(pose[i], math.nan)] * late, []
    one.restart(share)
    for _ in range(cycles):
        plant.advance(u, CYCLE)
        position, velocity, _ = velocity_filter.update(
            plant.time, in_counts(plant.q, chain.counts(JOINTS))
        )
        told.append((position[i], velocity[i]))
        known = told[-1 - late]
        if np.isfinite(known[1]):
            u[i] = one.limit(direction, *known, CYCLE)
        rows.append((direction * (end - plant.q[i]), direction * plant.v[i]))
    ways, speeds = np.array(rows).T
    return Driven(ways, speeds, limits.velocity_max if direction > 0 else -limits.velocity_min)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
@pytest.mark.parametrize("joint", JOINTS)
def test_the_simulated_crane_at_full_spool_stays_within_table_2(
    joint: str, direction: float
) -> None:
    """The hardest case: full spool into the limit, with load and oil."""
    limits = MACHINE.limits[joint]
    fastest = limits.velocity_max if direction > 0 else -limits.velocity_min
    done = driven(joint, direction, 1.5 * fastest, 600)
    assert -done.way.min() <= SWING, f"{-done.way.min()} rad or m beyond the limit"
    assert 0.7 * fastest <= done.speed.max()
    assert done.speed.max() <= 1.3 * fastest  # for a moment, until the correction has closed it
    assert done.way[-1] <= 0.1 * fastest  # it does arrive


@pytest.mark.parametrize("late", [0, 10])  # cycles; an estimate is 50 ms behind
@pytest.mark.parametrize("direction", [-1.0, 1.0])
@pytest.mark.parametrize("joint", JOINTS)
def test_a_degraded_crane_goes_evenly_at_the_speed_it_may(
    joint: str, direction: float, late: int
) -> None:
    """Asked for full spool. A limit that followed each swing of a load on its oil drove it to four
    times what was permitted and back, three times in a second.
    """
    share = 0.3
    limits = MACHINE.limits[joint]
    done = driven(joint, direction, 0.8 * (limits.position_max - limits.position_min), 800, share,
                  late)  # fmt: skip
    speed = done.speed / (share * done.fastest)
    assert speed.max() <= 1.6  # as it begins, before the speed that the spool gives is known
    steady = speed[400:]
    assert steady.min() >= 0.85 and steady.max() <= 1.1
