"""rehearsal.json: what a rehearsal found."""

from typing import Self

from crane_benchmark.rehearsal.bring_up import RehearsedValve
from crane_benchmark.rehearsal.tried import RehearsedFault, RehearsedMargin, StoppingDistance
from crane_identification.report.summary import ParameterSummary
from crane_model.result_file import Number, NumberByJoint, ResultFile, ResultPart

SIGMAS = 3.0
"""Standard deviations within which the true value counts as recovered."""
EXACT_SHARE = 0.02
"""Share of the true value within which it counts as recovered, however small the deviation."""


class RehearsedParameter(ResultPart):
    """A parameter of mechanics or hydraulics."""

    name: str
    """Name of the parameter in model files."""
    unit: str
    """SI."""
    true_value: float
    """In the simulated crane [unit]."""
    value: Number
    """Estimate [unit]; null if its standard deviation exceeds the true value."""
    std_dev: Number
    """Standard deviation of the estimate [unit]."""
    recovered: bool
    """The estimate is within 3 σ or 2 % of the true value."""

    @classmethod
    def of(cls, found: ParameterSummary, true: float) -> Self:
        value, std_dev = found.value, found.std_dev
        if value is None or std_dev is None or std_dev > abs(true) > 0.0:
            value = std_dev = None
        recovered = (
            value is not None
            and std_dev is not None
            and abs(value - true) <= max(SIGMAS * std_dev, EXACT_SHARE * abs(true))
        )
        return cls(
            name=found.name,
            unit=found.unit,
            true_value=true,
            value=value,
            std_dev=std_dev,
            recovered=recovered,
        )


class LostEncoder(ResultPart):
    """The reaction of the suite to an encoder that froze in motion."""

    joint: str
    """Joint whose encoder froze."""
    named_by: str
    """Node that named it first."""
    seconds_to_name: float
    """From the fault on [s]."""
    seconds_to_neutral: float
    """From the fault until all valves were commanded neutral [s]."""


class Rehearsal(ResultFile):
    """The results of a rehearsal on the simulated crane of a machine folder."""

    machine: str
    """Name of the machine."""
    date: str
    """When the rehearsal ended, UTC."""
    digest: str
    """SHA-256 of the files of the machine."""
    failed: dict[str, str]
    """Errors by step; empty if the rehearsal is complete."""
    seed: int
    """Seed of the sensor noise [-]."""
    wall_seconds: float
    """How long the rehearsal took [s]."""
    valves: list[RehearsedValve] = []
    """By bring-up."""
    parameters: list[RehearsedParameter] = []
    """By identification."""
    heldout_relative_error: NumberByJoint = {}
    """‖τ - τ̂‖/‖τ‖ on the recording that was not used for fitting [-]."""
    noise_floor: NumberByJoint = {}
    """Scatter of τ from period to period over ‖τ‖ [-]."""
    tracking: dict[str, NumberByJoint] = {}
    """Rms tracking error by controller [rad, m]."""
    margins: list[RehearsedMargin] = []
    """By controller and joint."""
    stopping: list[StoppingDistance] = []
    """By joint and direction."""
    lost_encoder: LostEncoder | None = None
    """With the driver; null if this was not tried."""
    faults: list[RehearsedFault] = []
    """In recordings, without a driver."""
