"""What findings.json says of flows of oil and of loads of single recordings.

They are found beside the effects of the force, with which they do not compete.
"""

from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.findings_file import (
    EdgeGain,
    FindingEntry,
    FlowBalance,
    FoundParameter,
    HydraulicQuantity,
)
from crane_identification.diagnosis.flow.flow import Flow, Quantity
from crane_identification.diagnosis.search.candidates import WHOLE, Candidate
from crane_identification.diagnosis.search.loads import MASS_SIGMAS, NO_LOAD, Weighed
from crane_identification.notation import is_determined


def of_load(diagnosis: Diagnosis, one: Weighed) -> FindingEntry:
    """A load that a held-out recording alone carries, by the same keys."""
    cls = next(type(term) for term in diagnosis.gap.carried.terms if term.carries_loads)
    mass = FoundParameter(
        name="m_payload",
        value=one.mass,
        std_dev=one.std_dev,
        unit="kg",
        minimum=None,
        determined=is_determined(one.mass, one.std_dev),
    )
    return _by_itself(
        diagnosis,
        Candidate(cls, None),
        WHOLE,
        mass,
        (one.mass / one.std_dev) ** 2,
        MASS_SIGMAS**2,
        None,
        {mass.name: [one.recording], NO_LOAD: sorted(diagnosis.training.sources)},
    )


def of_flow(diagnosis: Diagnosis, joint: str, one: Quantity) -> FindingEntry:
    """A finding of the flow balance, by the same keys; it adds nothing to the model of forces."""
    sigmas = diagnosis.thresholds.method.flow_sigmas
    threshold = (sigmas * one.std_dev / one.value) ** 2 * one.score
    return _by_itself(diagnosis, one, joint, of_quantity(one), one.score, threshold, one.share)


def _by_itself(
    diagnosis: Diagnosis,
    what: Candidate | Quantity,
    joint: str,
    value: FoundParameter,
    score: float,
    threshold: float,
    visible_strength: float | None,
    carried_in: dict[str, list[str]] | None = None,
) -> FindingEntry:
    """A finding with one parameter, which competed with no other effect."""
    return FindingEntry(
        effect=what.type,
        name=what.effect.name,
        joint=joint,
        class_members=[],
        parameters=[value],
        carried_in=carried_in or {},
        score=score,
        threshold=threshold,
        false_alarm_rate=diagnosis.thresholds.method.false_alarm_rate,
        runner_up=None,
        margin=score,
        margin_needed=0.0,
        visibility=1.0,
        strength=None,  # rms over that of the drive force, as of effects that compete
        visible_strength=visible_strength,
        held_out_gains={},
        settled_by=what.effect.settled_by,
    )


def balance(flow: Flow) -> FlowBalance:
    """Everything the flow balance says of a joint."""
    return FlowBalance(
        unexplained_share=flow.unexplained,
        correlation_left=flow.correlation,
        worn=flow.worn,
        known_time=flow.known,
        recorded_time=flow.recorded,
        edge_gains={
            one.edge: EdgeGain(
                value=one.value, std_dev=one.std_dev, determined=bool(one.determined)
            )
            for one in flow.gains
        },
        quantities={
            one.type: HydraulicQuantity(
                **dict(of_quantity(one)),
                usual_limit=one.usual,
                own=one.own,
                share_beyond_usual=one.share,
            )
            for one in flow.quantities
        },
    )


def of_quantity(one: Quantity) -> FoundParameter:
    """A value of the hydraulics, by the keys of a parameter."""
    return FoundParameter(
        name=one.type,
        value=one.value,
        std_dev=one.std_dev,
        unit=one.unit,
        minimum=None,
        determined=bool(one.determined),
    )
