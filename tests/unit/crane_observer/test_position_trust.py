"""How far the position estimator trusts flow: as far as the model file says it was identified."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from unit.crane_observer.observed import JOINTS, known

from crane_model import Model
from crane_observer.position.balance import Known, Stroke, stroke_of
from crane_observer.position.flow import FLOW_SUMS, SPOOL, Commands, add_interval, spools_of
from crane_observer.position.state import FLOW_SHARES, UNEXPLAINED_OF_TRUST, FlowWindow, flow_share

OFFSET = 2e4  # Pa
OPENING, SECONDS = 0.4, 0.05
SUPPLY = known().machine.hydraulics.supply_pressure
JOINT = JOINTS.index("outer_boom")


def with_hydraulics(**changes: Any) -> Model:
    """The known model, with other values of the hydraulics of one joint."""
    model = known()
    joint = model.hydraulics.joints[JOINTS[JOINT]]
    joints = model.hydraulics.joints | {JOINTS[JOINT]: joint.model_copy(update=changes)}
    return replace(model, hydraulics=model.hydraulics.model_copy(update={"joints": joints}))


def dead_bands(std_dev: float) -> dict[str, Any]:
    valve = known().hydraulics.joints[JOINTS[JOINT]].valve
    found = {
        name: getattr(valve, name).model_copy(update={"std_dev": std_dev})
        for name in ("dead_band_a", "dead_band_b")
    }
    return {"valve": valve.model_copy(update=found)}


def null_of(model: Model) -> float:
    of = Known.of(model, np.zeros(len(JOINTS)))
    return float(of.spread[of.layout.null][JOINT])


def test_a_null_is_as_sure_as_the_dead_bands_were_identified() -> None:
    for std_dev in (1e-5, 1e-3):
        assert null_of(with_hydraulics(**dead_bands(std_dev))) == pytest.approx(std_dev, rel=0.1)


def test_flow_that_is_left_unexplained_makes_a_null_less_sure() -> None:
    poor = with_hydraulics(unexplained=UNEXPLAINED_OF_TRUST, lack_of_fit=0.0)
    assert null_of(poor) > 100.0 * null_of(known())


@pytest.mark.parametrize(
    ("probability", "share"), [(None, 0.5), (1e-4, 0.5), (0.5, FLOW_SHARES[0])]
)
def test_what_noise_alone_leaves_unexplained_is_no_doubt(
    probability: float | None, share: float
) -> None:
    model = with_hydraulics(unexplained=0.5 * UNEXPLAINED_OF_TRUST, lack_of_fit=probability)
    assert flow_share(model)[JOINT] == pytest.approx(share)


def stroke(of: Known, p_a: float, gain: float) -> Stroke:
    """Of a window at pressure p_a [Pa] in all chambers A, whose supply edges have `gain` times what
    they are known to let through; B sucks, and is not used.
    """
    spools, circuit = spools_of(known()), of.circuit
    joints = len(JOINTS)
    spool, sums, commands = (
        np.zeros(joints, SPOOL),
        np.zeros(joints, FLOW_SUMS),
        Commands.none(joints),
    )
    spool["position"] = spool["edge"] = OPENING
    commands.add(-1.0, spools.sense * OPENING)
    pressures = np.array([[p_a] * joints, [circuit.tank_pressure] * joints])
    add_interval(
        circuit._replace(supply_a=gain * circuit.supply_a), spools, commands, spool, 0.0, 0.0,
        SECONDS, pressures, pressures, SUPPLY, 3e7, sums,
    )  # fmt: skip
    blind = np.zeros(joints)
    window = FlowWindow(SECONDS, SECONDS, sums, pressures, pressures, np.nan * blind, blind, True)
    length, lever, _ = of.mechanics.cylinders(np.array([[0.4, -1.3, 0.5]]))[0].T
    return stroke_of(of, length, lever, window)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7, 0.9])  # of the supply, in chamber A
def test_gains_make_up_for_a_transducer_at_half_the_supply_pressure(share: float) -> None:
    """They were identified there with the transducer as it is: by an orifice's square root."""
    half, p_a = 0.5 * SUPPLY, share * SUPPLY
    of = Known.of(known(), np.zeros(len(JOINTS)))
    true = stroke(of, p_a, 1.0)
    told = stroke(of, p_a + OFFSET, np.sqrt(half / (half - OFFSET)))
    found = told.by_offset_a * OFFSET / of.trust.transducer
    least = 1e-5 * true.stroke.max()
    np.testing.assert_allclose(found, true.stroke - told.stroke, rtol=0.03, atol=least)
    assert (true.stroke > 0.0).all()
