"""Chamber pressures of a cylinder that a valve with four equal edges moves steadily.

Both edges pass what the piston sweeps: with A the areas, p_S and p_T supply and tank, F of (19),

    (p_S - p_A)/A_A^2 = (p_B - p_T)/A_B^2 = y, F = A_A p_S - A_B p_T - y (A_A^3 + A_B^3), extending
    (p_A - p_T)/A_A^2 = (p_S - p_B)/A_B^2 = y, F = A_A p_T - A_B p_S + y (A_A^3 + A_B^3), else
"""

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine


def steady_pressures(
    machine: Machine,
    joint: str,
    position: np.ndarray,
    velocity: np.ndarray,
    force: np.ndarray,
    raised: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """p_A and p_B (n,) [Pa] at positions and velocities (n,) and a generalized force (n,).

    `raised` [Pa] is added to the pressure of the tank: back-pressure.
    """
    cylinder, supply = machine.cylinders[joint], machine.hydraulics
    a, b = cylinder.area_a, cylinder.area_b
    high, low = supply.supply_pressure, supply.tank_pressure + raised
    arm = lever_arm(machine, joint, position)
    own = force / arm
    extending = arm * velocity > 0.0
    cubes = a**3 + b**3
    y = np.where(extending, a * high - b * low - own, own - a * low + b * high) / cubes
    pressure_a = np.where(extending, high - a**2 * y, low + a**2 * y)
    pressure_b = np.where(extending, low + b**2 * y, high - b**2 * y)
    return pressure_a, pressure_b
