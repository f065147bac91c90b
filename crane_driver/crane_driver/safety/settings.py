"""The settings of the safety functions, from `safety.yaml`."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError
from crane_model.joint_tables import of_every_joint
from crane_model.machine import Machine

Spool = Annotated[float, Field(gt=0, lt=1)]


class DegradedSettings(Schema):
    """When a joint may go on by an estimate in the place of its encoder."""

    speed: Annotated[float, Field(gt=0, le=1)]  # share of that of Table 2, of every joint
    timeout: Positive  # s
    deviation: dict[str, Positive]  # joint: rad, m; others have no substitute


class SafetySettings(Schema):
    """Times [s], spool commands -1 to 1, decelerations [SI]; meaning in the file."""

    command_timeout: Positive
    ramp_time: Positive
    neutral: Spool
    settling_time: Positive
    deceleration: dict[str, Positive]  # joint
    reaction_time: Positive
    correction_time: Positive
    opening: Spool
    opening_time: Positive
    jump_speed: Annotated[float, Field(ge=1)]
    still_time: Positive
    still_pressure: Positive
    degraded: DegradedSettings | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.neutral >= self.opening:
            raise ValueError(
                f"neutral is {self.neutral}, it must be less than opening, {self.opening}: what "
                "moves nothing cannot surely move a joint"
            )
        return self


def load_safety(path: Path | str, machine: Machine) -> SafetySettings:
    """The settings in `path`; `ConfigurationError` if wrong, or not of the joints of `machine`."""
    settings = load(path, SafetySettings)
    of_every_joint(settings.deceleration, machine.joint_names, f"{path}: key 'deceleration'")
    permitted = settings.degraded.deviation if settings.degraded else {}
    if unknown := [joint for joint in permitted if joint not in machine.joint_names]:
        raise ConfigurationError(
            f"{path}: key 'degraded.deviation' names {', '.join(unknown)}; the joints are "
            f"{', '.join(machine.joint_names)}"
        )
    return settings
