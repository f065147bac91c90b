"""Limits of Table 2 against simple machines of every kind, and against the simulated crane."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from crane_driver.safety.limits import JointLimiter
from crane_driver.safety.settings import load_safety
from crane_driver.velocity_filter import VelocityFilter
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_sim.parts.parameters import load_stand_in
from crane_sim.plant.plant import Plant

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
    st.floats(0.0, 0.1),  # dead zone
    st.floats(0.005, 0.05),  # s, lag of the valve
    st.lists(commands, min_size=1, max_size=12),
)
def test_no_machine_is_driven_beyond_a_limit(
    joint: str, gain: float, dead_zone: float, lag: float, levels: list[float]
) -> None:
    limits, one = MACHINE.limits[joint], limiter(joint)
    span = limits.position_max - limits.position_min
    fastest = max(limits.velocity_max, -limits.velocity_min)
    position, spool = (limits.position_min + limits.position_max) / 2, 0.0
    per_level = int(1.5 * span / fastest / CYCLE / len(levels)) + 1
    for level in levels:
        for _ in range(per_level):
            opened = math.copysign(max(abs(spool) - dead_zone, 0.0), spool)
            speed = gain * fastest * opened / (1.0 - dead_zone)
            command = one.limit(level, position, speed, CYCLE)
            spool += (command - spool) * min(1.0, CYCLE / lag)
            position += CYCLE * speed
            assert limits.position_min - ROUNDING <= position <= limits.position_max + ROUNDING


@pytest.mark.parametrize("direction", [-1.0, 1.0])
@pytest.mark.parametrize("joint", JOINTS)
def test_the_simulated_crane_at_full_spool_stays_within_table_2(
    joint: str, direction: float
) -> None:
    """The hardest case: full spool into the limit, with load and oil."""
    stand_in, i = load_stand_in(), JOINTS.index(joint)
    limits = MACHINE.limits[joint]
    fastest = limits.velocity_max if direction > 0 else -limits.velocity_min
    end = limits.position_max if direction > 0 else limits.position_min
    pose = stand_in.start
    pose[i] = end - direction * 1.5 * fastest
    plant = Plant(stand_in, MACHINE, pose)
    chain = stand_in.sensors
    velocity_filter = VelocityFilter(
        [stand_in.jerk_density[one] for one in JOINTS],
        [chain.encoder_resolution[one] for one in JOINTS],
    )
    one, u, fastest_seen = limiter(joint), np.zeros(4), 0.0
    for _ in range(600):
        plant.advance(u, CYCLE)
        position, velocity, _ = velocity_filter.update(
            plant.time, chain.measure_positions(JOINTS, plant.q)
        )
        if np.isfinite(velocity[i]):
            u[i] = one.limit(direction, position[i], velocity[i], CYCLE)
        beyond = direction * (plant.q[i] - end)
        assert beyond <= SWING, f"{beyond} rad or m beyond the limit"
        fastest_seen = max(fastest_seen, direction * plant.v[i])
    assert 0.7 * fastest <= fastest_seen
    assert fastest_seen <= 1.3 * fastest  # for a moment, until the correction has closed the spool
    assert direction * (end - plant.q[i]) <= 0.1 * fastest  # it does arrive
