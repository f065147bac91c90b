"""Thresholds of a diagnosis, in a file beside the code."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from crane_model.configuration import Schema, load, packaged

Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]


class Thresholds(Schema):
    """What an effect must reach to be named; `discrepancy.yaml` says what each is for."""

    false_alarm_rate: Share
    score_factor: Positive
    smallest_strength: Share
    further_share: Share
    elsewhere_share: Share
    form_share: Share
    folds_share: Share
    lead_share: Share
    alike: Share
    explained_share: Share
    left_share: Share
    closed_share: Share
    simple_share: Share
    floor_factor: Positive
    testable_share: Share
    detectable_strength: Share


def load_thresholds(path: Path | None = None) -> Thresholds:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or packaged("crane_identification", "discrepancy.yaml"), Thresholds)
