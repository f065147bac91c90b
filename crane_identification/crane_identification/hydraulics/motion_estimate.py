"""The valve of a joint without pressure transducers: dead zones, gains and lag from its motion."""

from collections.abc import Sequence

import numpy as np

from crane_identification.data.log import Log
from crane_identification.hydraulics.balance import DAMPING_RATIO, Balance, MotionRows
from crane_identification.hydraulics.joint_estimate import (
    LARGEST_UNEXPLAINED,
    SIGMAS,
    measured_spool,
    settled_by,
    undetermined,
)
from crane_identification.hydraulics.passage import passages
from crane_identification.hydraulics.projection import project
from crane_model.errors import DataError
from crane_model.hydraulics.values import GAIN, JointHydraulics, Measured, ValveValues
from crane_model.machine import Machine


def identify_motion(machine: Machine, joint: str, logs: Sequence[Log]) -> JointHydraulics:
    """Its valve, as if the load were nil; `DataError` says why the recordings do not tell it.

    The gains hold for the load against which it moved, friction above all, and the lag includes
    that of its oil; what else oil and load do stays in what is unexplained.
    """
    cylinder = machine.cylinders[joint]
    balance = Balance([MotionRows(part, cylinder) for part in passages(machine, joint, logs)])
    found = project(balance)
    gains = found.linear
    std_devs = np.sqrt(np.diag(found.covariance))[-len(gains) :]
    if (gains <= SIGMAS * std_devs).any() or found.unexplained > LARGEST_UNEXPLAINED:
        raise DataError(
            f"hydraulics of '{joint}': its speed does not follow its valve "
            f"({found.unexplained:.0%} unexplained); check sign and log of its command, or record "
            "slow ramps of it both ways"
        )
    forth, back = (
        Measured(value=float(gain), std_dev=float(std), unit=GAIN)
        for gain, std in zip(gains, std_devs, strict=True)
    )
    values = measured_spool(found)
    valve = ValveValues(
        **values,
        damping_ratio=Measured(value=DAMPING_RATIO, unit="1"),
        supply_a=forth,
        b_tank=forth,
        supply_b=back,
        a_tank=back,
    )
    oil = ("bulk_modulus", "dead_volume_a", "dead_volume_b", "leakage")
    return JointHydraulics(
        valve=valve,
        undetermined=undetermined(valve.by_name)
        | {name: f"pressure transducers, then {settled_by(name)}" for name in oil},
        unexplained=found.unexplained,
    )
