"""How excitation trajectories are searched and judged: `design.yaml`."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from crane_model.configuration import Positive, Schema, load
from crane_trajectory.excitation.merit import PredictedRecording

Share = Annotated[float, Field(ge=0, lt=1)]
Count = Annotated[int, Field(ge=1)]


class Margins(Schema):
    """What a design keeps free, so that a machine that follows it inexactly stays within limits."""

    position: Annotated[float, Field(ge=0, lt=0.5)]  # of the range of Table 2, at both ends
    velocity: Share
    flow: Share
    room: Annotated[float, Field(ge=0)]  # m


class SearchStage(Schema):
    """How finely one stage of the search sees limits and criterion, and where it ends."""

    grid_per_harmonic: Annotated[int, Field(ge=4)]
    reversal_share: Positive
    power: Positive
    iterations: Count
    tolerance: Positive


class SearchSettings(Schema):
    """How the search samples, how it starts, and its two stages."""

    samples: Count
    start_amplitude: Annotated[float, Field(gt=0, le=1)]
    survivors: Count
    explore: SearchStage
    polish: SearchStage


class DesignSettings(Schema):
    """Everything of `design.yaml`."""

    search: SearchSettings
    margins: Margins
    experiment: PredictedRecording
    plausible: dict[str, float]


def load_design_settings(path: Path | str) -> DesignSettings:
    """The settings in `path`; `ConfigurationError` if wrong."""
    return load(path, DesignSettings)
