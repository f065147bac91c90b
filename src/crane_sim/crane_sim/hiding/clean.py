"""What truly happened in a recording: states, forces and the part of each hidden effect in them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from crane_model.cylinders import generalized_forces, lever_arms
from crane_model.machine import Machine
from crane_sim.effects.fault import SensorFault, measured_joints
from crane_sim.effects.form import Planted
from crane_sim.plant.closed_loop import States, TrueStates


@dataclass(frozen=True)
class Clean(States):
    """n samples without noise and quantisation, k effects."""

    drive: np.ndarray  # (n, j) generalized forces of the cylinders (27), N m, N
    seen_position: np.ndarray  # (n, j) with the faults of the sensors
    seen_drive: np.ndarray  # (n, j) generalized forces from pressures and positions as seen
    force: np.ndarray  # (k, n, j) part of each effect in `seen_drive`
    flow: np.ndarray  # (k, n, j) part of each effect in the flow into chamber A, m3/s
    strength_by_joint: np.ndarray  # (k, j) rms of the part over rms of the whole

    def strength(self, planted: Sequence[Planted], machine: Machine) -> np.ndarray:
        """(k,) on the joint of each effect; of the whole machine where it is strongest."""
        measured = [machine.index(joint) for joint in measured_joints(machine)]
        return np.array(
            [
                row[measured].max() if effect.joint is None else row[machine.index(effect.joint)]
                for effect, row in zip(planted, self.strength_by_joint, strict=True)
            ]
        )

    def save(self, path: Path | str) -> None:
        """As arrays of an npz file, each under its name."""
        np.savez_compressed(path, **asdict(self))


def clean(
    machine: Machine,
    planted: Sequence[Planted],
    faults: Sequence[SensorFault],
    truth: TrueStates,
    actual: Machine | None = None,
) -> Clean:
    """The parts of the effects `planted`, of which `faults` are those of sensors, in a recording.

    A fault's part is what it changes in the force that is computed from the readings, by the
    geometry of `machine`; that of the machine itself is `actual`, by default the same.
    """
    joints = machine.joint_names
    q, p_a, p_b = truth.position, truth.pressure_a, truth.pressure_b
    drive = seen = generalized_forces(machine, q, p_a, p_b, joints)
    force = np.zeros((len(planted), *drive.shape))
    flow = np.zeros_like(force)
    inside = [k for k, effect in enumerate(planted) if isinstance(effect.form.law, int)]
    force[inside] = truth.hidden_force
    if actual is not None and actual is not machine:
        force[inside] *= lever_arms(machine, q, joints) / lever_arms(actual, q, joints)
    flow[inside] = truth.hidden_flow
    outside = [k for k in range(len(planted)) if k not in inside]
    for k, fault in zip(outside, faults, strict=True):
        q = fault.positions(q)
        p_a, p_b = fault.pressures(truth.time, p_a, p_b)
        before, seen = seen, generalized_forces(machine, q, p_a, p_b, joints)
        force[k] = seen - before
    areas = np.array([machine.cylinders[joint].area_a for joint in joints])
    swept = areas * lever_arms(machine, truth.position, joints) * truth.velocity
    return Clean(
        time=truth.time,
        position=truth.position,
        velocity=truth.velocity,
        acceleration=truth.acceleration,
        pressure_a=truth.pressure_a,
        pressure_b=truth.pressure_b,
        drive=drive,
        seen_position=q,
        seen_drive=seen,
        force=force,
        flow=flow,
        strength_by_joint=_share(force, drive) + _share(flow, swept),
    )


def _share(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """(k, j): rms of (k, n, j) over rms of (n, j); 0 where the whole is nil."""
    rms = np.sqrt(np.mean(whole**2, axis=0))
    return np.sqrt(np.mean(part**2, axis=1)) / np.where(rms > 0.0, rms, np.inf)
