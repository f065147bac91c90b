"""The packaged gains leave room for a loop that is late: oil and booms must not begin to swing."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_nodes.joint_notes import load_joint_notes
from crane_sim import Sensors, load_simulated_crane, record
from crane_sim.plant.closed_loop import LatePlant
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains

JOINTS = load_machine().joint_names

LATE = 0.05  # s
SWINGING = 0.05  # rad/s, m/s: rms over a second of what is faster than 2 Hz
MEAN = np.full(200, 1 / 200)  # over a second


def test_commands_that_are_50_ms_late_set_nothing_swinging() -> None:
    machine, parameters = load_machine(), load_simulated_crane()
    trajectory = load_trajectory(machine_file("excitation_20s.yaml"))
    motion = plan(
        machine, trajectory, parameters.start, 1, load_clearance(machine_file("clearance.yaml"))
    )
    plant = LatePlant(parameters, machine, motion.start, delay=LATE, spread=0.0)
    sensors = Sensors(parameters.sensors, machine, 1)
    recording = record(motion, plant, sensors, load_gains(machine_file("controller.yaml"), machine))

    band = butter(4, [2.0, 20.0], "bandpass", fs=200.0, output="sos")
    fast = sosfiltfilt(band, recording.truth.velocity, axis=0)
    notes = load_joint_notes(machine_file("joints.yaml"), machine.units)
    error = np.abs(recording.position - recording.reference.position).max(axis=0)
    for i, joint in enumerate(JOINTS):
        assert np.sqrt(np.convolve(fast[:, i] ** 2, MEAN, "valid").max()) < SWINGING, joint
        assert error[i] < notes[joint].tracking_tolerance, joint
