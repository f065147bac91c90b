"""CPU time a cycle of an experiment without ROS, by part, beside a loop that tells the computer.

`python trajectory_cycle.py` leads an ideal laboratory crane, which is always where the reference
is, through its excitation trajectory by the PD controller and by `flow_feedforward`.
"""

import time
from collections.abc import Callable
from timeit import repeat

import numpy as np
from known_crane import known_model
from sensor_msgs.msg import JointState

from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_trajectory import Experiment, load_clearance, load_trajectory, plan
from crane_trajectory.control.choice import controller
from crane_trajectory.control.controller import Controller, Tuning, load_gains
from crane_trajectory.motion.motion import ReferenceClock
from crane_trajectory.trajectory_topics import command_message, reference_message, sample

PERIOD = 0.005  # s
CYCLES = 4000
MACHINE = load_machine()
JOINTS = MACHINE.joint_names
GAINS = load_gains(machine_file("controller.yaml"), MACHINE).arrays
TUNING = Tuning(GAINS, 1.0, np.full(len(JOINTS), 0.2))
TRAJECTORY = load_trajectory(machine_file("excitation_20s.yaml"))
MOTION = plan(
    MACHINE,
    TRAJECTORY,
    np.array([0.0, *TRAJECTORY.evaluate(np.zeros(1)).position[0]])[: len(JOINTS)],
    1,
    load_clearance(machine_file("clearance.yaml")),
)


def cost(cycle: Callable[[int], object]) -> float:
    """CPU time of `cycle` [us], in the median of ten parts of all cycles."""
    cycle(0)
    spent = []
    for part in np.array_split(np.arange(1, CYCLES + 1), 10):
        began = time.thread_time()
        for k in part.tolist():
            cycle(k)
        spent.append((time.thread_time() - began) / len(part))
    return 1e6 * float(np.median(spent))


def led(by: Controller | None) -> Callable[[int], object]:
    """A cycle of an experiment that `by` leads."""
    experiment = Experiment(MOTION, TUNING, 0.06, 0.0, by)
    rest = MOTION.start, np.zeros(len(JOINTS))

    def cycle(k: int) -> None:
        target = experiment.target
        q, v = rest if target is None else target[:2]
        experiment.sample(k * PERIOD, q, v, k * PERIOD)
        assert k == 0 or experiment.target is not None, experiment.account

    return cycle


def main() -> None:
    loop = np.median(
        repeat("for i in range(1000000): i * i", time.process_time, number=1, repeat=9)
    )
    model = known_model()
    clock, rest = ReferenceClock(10.0), np.zeros(len(JOINTS))
    target = clock.target(MOTION)
    state = JointState(name=list(JOINTS), position=[0.1] * len(JOINTS), velocity=rest.tolist())
    stamp = state.header.stamp

    def reference(_: int) -> None:
        clock.advance(PERIOD)
        clock.target(MOTION)

    parts = {
        "reference": reference,
        "joint state to arrays": lambda _: sample(state, JOINTS),
        "message of the reference": lambda _: reference_message(target, stamp, JOINTS),
        "message of the command": lambda _: command_message(rest, stamp, JOINTS),
        "experiment, pd_dead_band": led(None),
        "experiment, flow_feedforward": led(controller("flow_feedforward", MACHINE, GAINS, model)),
    }
    print(f"a million i * i: {1e3 * loop:.0f} ms; {CYCLES} cycles")
    for name, cycle in parts.items():
        print(f"{name:30s} {cost(cycle):7.1f} us")


if __name__ == "__main__":
    main()
