"""What the sensors of every machine do wrong a little: structured noise, no effect to be found."""

import numpy as np

from crane_model.machine import Machine
from crane_sim.effects.encoders import Eccentric
from crane_sim.effects.form import SensorFault, measured_joints

PISTON_RATE_HZ = (170.0, 260.0)  # strokes of the pump's pistons a second, far above the sampling
PULSATION_PA = (1e3, 6e3)  # in a chamber, below the noise of a transducer
SECOND = 0.4  # of the pulsation, twice as fast
DRIFT = 0.004  # of the rate: the motor slips as the load comes and goes
DRIFT_RAD_S = 0.5
ECCENTRICITY_RAD = (5e-5, 2e-4)  # 1 to 4 counts of an encoder


class PumpPulsation(SensorFault):
    """The pump's pulsation in all chambers, which the sampling aliases to wherever it falls.

    `values`: rate [Hz], then pulsation [Pa] and phase [rad] of chambers A and B of each joint.
    """

    def pressures(
        self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Two harmonics, the rate drifting."""
        rate, *rest = self.values
        each = np.array(rest).reshape(2, 2, -1)  # chamber, pulsation or phase, joint
        slip = DRIFT / DRIFT_RAD_S * np.cos(DRIFT_RAD_S * time)
        angle = 2.0 * np.pi * rate * (time + slip)[:, np.newaxis]
        shown = [
            pressure + size * (np.sin(angle + phase) + SECOND * np.sin(2.0 * angle + phase))
            for pressure, (size, phase) in zip((chamber_a, chamber_b), each, strict=True)
        ]
        return shown[0], shown[1]


def drawn_flaws(machine: Machine, seed: int) -> tuple[SensorFault, ...]:
    """Pulsation of the pump, and encoder disks a little off their centres; the same seed gives the
    same ones.
    """
    rng = np.random.default_rng([seed, 11])
    joints = measured_joints(machine)
    count = len(machine.joint_names)
    sizes, phases = rng.uniform(*PULSATION_PA, (2, count)), rng.uniform(0.0, 2 * np.pi, (2, count))
    chambers = np.stack([sizes, phases], axis=1).ravel()
    rate = rng.uniform(*PISTON_RATE_HZ)
    eccentric = [
        Eccentric(machine, joint, (rng.uniform(*ECCENTRICITY_RAD), 1.0, rng.uniform(0, 2 * np.pi)))
        for joint in joints
        if machine.units[joint] == "rad"
    ]
    return (*eccentric, PumpPulsation(machine, joints[0], (rate, *chambers)))
