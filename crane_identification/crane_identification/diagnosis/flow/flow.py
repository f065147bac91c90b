"""The second residual: what the flow of oil tells of valves and oil, joint by joint.

Measured pressures are the input of the torque model, so that valves, leakage and compressibility
cannot show in its residual. They do in the balance of flow, which is fitted as a whole: every
machine has some of each, and an effect is missing where a value is not the usual one.
"""

from collections.abc import Sequence

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.flow.flow_balance import ProvedBalance, balance_of, with_wear
from crane_identification.diagnosis.flow.flow_rows import FlowRows
from crane_identification.diagnosis.flow.hydraulics import Flow, Flows, Gain
from crane_identification.diagnosis.flow.quantities import Quantities
from crane_identification.diagnosis.flow.usual import JointUsual, Usual, usual_of
from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.thresholds import Method, Thresholds
from crane_model.errors import DataError
from crane_model.flow import FLOW_EFFECTS
from crane_model.flow.valve import EDGES


def examine(
    evidence: Evidence,
    held_out: Evidence,
    usual: Usual,
    thresholds: Thresholds,
    named: Sequence[Candidate] = (),
) -> Flows:
    """Each joint whose flow was recorded, and why effects are not observable on the others.

    An effect is missing where its value lies beyond what is usual, and where the usual value
    predicts the flow of the `held_out` recordings clearly worse. Where effects
    that are `named` are of sensors, what these measure tells nothing of the flow.
    """
    distrusted = {one.where for one in named if one.term.is_of_sensors()}
    found: list[Flow] = []
    absent: dict[tuple[str, str], str] = {}
    for joint in evidence.joints:
        try:
            here, there = FlowRows(evidence, joint), FlowRows(held_out, joint)
            if joint in distrusted:
                raise DataError(f"flow of '{joint}': its sensors may be wrong; settle that first")
            own = usual_of(joint, usual, evidence.model.hydraulics)
            found.append(_flow(here, there, own, thresholds))
        except DataError as error:
            absent |= {(effect, joint): str(error) for effect in sorted(FLOW_EFFECTS)}
    return Flows(tuple(found), absent)


def _flow(here: FlowRows, there: FlowRows, usual: JointUsual, thresholds: Thresholds) -> Flow:
    """What the balance of a joint says; `DataError` if it says nothing."""
    gates, method = thresholds.gates, thresholds.method
    balance = balance_of(here, there)
    if balance.unexplained > gates.unexplained_flow:
        balance = with_wear(balance, method.flow_named_share)
    noise = balance.unexplained > method.flow_noise_share
    if noise and balance.correlation < method.flow_law_correlation:
        raise DataError(
            f"flow of '{here.joint}': {balance.unexplained:.0%} of it is noise, at most "
            f"{method.flow_noise_share:.0%} allowed; move faster"
        )
    gains = _gains(balance, here.joint, method)
    return Flow(
        joint=here.joint,
        quantities=() if noise else Quantities(balance, usual, thresholds).all(),
        gains=gains,
        unexplained=balance.unexplained,
        usual=gates.unexplained_flow,
        correlation=balance.correlation,
        air=_air(balance),
        known=here.known,
        recorded=here.recorded,
        method=method,
    )


def _air(balance: ProvedBalance) -> float:
    """Share of what is left that air in the oil would explain."""
    share, values = balance.beside(balance.here.rows.air, balance.there.rows.air)
    return share if values[-1] > 0.0 else 0.0


def _gains(balance: ProvedBalance, joint: str, method: Method) -> tuple[Gain, ...]:
    """Of the metering edges; `DataError` if the flow does not follow them."""
    gains = tuple(_gain(balance, k, edge, method) for k, edge in enumerate(EDGES))
    known = [gain for gain in gains if gain.determined]
    wrong = [gain.edge for gain in known if gain.value < 0.0]
    if wrong or not known:
        raise DataError(
            f"flow of '{joint}': it does not follow the valve"
            + (f", and runs against it at the edge {', '.join(wrong)}" if wrong else "")
            + "; check sign and log of its command, and that its chambers are not exchanged"
        )
    return gains


def _gain(balance: ProvedBalance, column: int, edge: str, method: Method) -> Gain:
    value = float(balance.fitted.values[column])
    std_dev = balance.std_dev(balance.unit(column))
    return Gain(edge, value, std_dev, abs(value) >= method.flow_sigmas * std_dev)
