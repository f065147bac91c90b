"""Other machines of the same make."""

from pathlib import Path

import numpy as np
import pytest

from crane_model import Machine
from crane_sim import SimulatedCrane, load_simulated_crane, save_simulated_crane
from crane_sim.parts.parameters import Edges, column, vary, vary_valves


def test_other_machines(simulated: SimulatedCrane, machine: Machine, tmp_path: Path) -> None:
    """Each seed its machine, within the spread; written and read as a file."""
    one, again, other = (vary(simulated, seed, 0.1) for seed in (1, 1, 2))
    assert one == again != other
    ratio = other.bodies["gripper"].mass / simulated.bodies["gripper"].mass
    assert 0.9 <= ratio <= 1.1 and ratio != 1.0
    ratios = column(other.friction, "f_c") / column(simulated.friction, "f_c")
    assert ((ratios >= 0.9) & (ratios <= 1.1)).all()
    assert len(np.unique(ratios)) == 4
    save_simulated_crane(tmp_path / "machine.yaml", other)
    assert load_simulated_crane(tmp_path / "machine.yaml") == other


def test_valves_for_differential_cylinders(simulated: SimulatedCrane, machine: Machine) -> None:
    """Edges by the areas of the cylinder and as fast as before; no dead band beyond its own."""
    one, again, other = (vary_valves(simulated, machine, seed, 0.1) for seed in (1, 1, 2))
    assert one == again != other
    exact = vary_valves(simulated, machine, 1, 0.0)
    for joint in machine.joint_names:
        given, valve, cylinder = (
            simulated.valves[joint],
            other.valves[joint],
            machine.cylinders[joint],
        )
        shares = exact.valves[joint].edges
        assert shares.supply_a == shares.a_tank and shares.supply_b == shares.b_tank
        assert shares.supply_a / shares.supply_b == pytest.approx(cylinder.area_a / cylinder.area_b)

        # what is left of the supply pressure drives (A_A/K_A)² + (A_B/K_B)² times speed squared
        resistance = (cylinder.area_a / shares.supply_a) ** 2 + (
            cylinder.area_b / shares.b_tank
        ) ** 2
        assert resistance == pytest.approx(cylinder.area_a**2 + cylinder.area_b**2)
        for edge in Edges.model_fields:
            assert 0.9 <= getattr(valve.edges, edge) / getattr(shares, edge) <= 1.1
        up, down = valve.dead_band + valve.null_bias, valve.dead_band - valve.null_bias
        assert up != down
        assert 0.85 * given.dead_band <= min(up, down) <= max(up, down) <= given.dead_band
