"""Thresholds of a diagnosis, read from discrepancy.yaml."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from crane_model.configuration import Positive, Schema, load, packaged

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]


class Gates(Schema):
    """Limits that machines with a complete model must not exceed; calibrated, then locked."""

    score_factor: Positive
    smallest_strength: Share
    floor_factor: Positive
    sample_noise_factor: Positive
    pulsation_clearness: Positive
    smallest_flow_share: Share
    unexplained_flow: Share


class Method(Schema):
    """Thresholds of the methods that answers are compared with."""

    false_alarm_rate: Share
    further_share: Share
    elsewhere_share: Share
    reading_share: Share
    folds_share: Share
    folds_to_fail: Count
    lead_share: Share
    kin_lead_share: Share
    alike_correlation: Share
    rival_correlation: Share
    form_correlation: Share
    parameter_sigmas: Positive
    explained_share: Share
    left_share: Share
    closed_share: Share
    simple_share: Share
    explainable_share: Share
    surveyed_error: Share
    clean_factor: Positive
    worse_factor: Positive
    testable_share: Share
    detectable_strength: Share
    pulsation_recordings: Count
    flow_sigmas: Positive
    flow_proof_factor: Positive
    flow_noise_share: Share
    flow_law_correlation: Share
    flow_named_share: Share


class Thresholds(Schema):
    """All of it; `discrepancy.yaml` says what each is for."""

    gates: Gates
    method: Method


def load_thresholds(path: Path | None = None) -> Thresholds:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or packaged("crane_identification", "discrepancy.yaml"), Thresholds)
