"""What is usual of valves and oil, in a file beside the code."""

from pathlib import Path
from typing import Self

from pydantic import model_validator

from crane_model.configuration import Positive, Schema, load
from crane_model.machine_files import machine_file


class Usual(Schema):
    """What is usual of valves and oil; `hydraulics.yaml` says what each is."""

    dead_zone: dict[str, Positive]
    hysteresis: Positive
    asymmetry: Positive
    leakage: Positive | dict[str, Positive]
    bulk_modulus: Positive

    @model_validator(mode="after")
    def _of_the_same_joints(self) -> Self:
        if isinstance(self.leakage, dict) and self.leakage.keys() != self.dead_zone.keys():
            raise ValueError(
                f"leakage is given of {', '.join(self.leakage)}, dead_zone of "
                f"{', '.join(self.dead_zone)}; give both of the same joints, or one leakage for all"
            )
        return self

    def leakage_of(self, joint: str) -> float:
        """Of a joint that has a dead zone [m3/(s Pa)]."""
        return self.leakage[joint] if isinstance(self.leakage, dict) else self.leakage


def load_usual(path: Path | None = None) -> Usual:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or machine_file("hydraulics.yaml"), Usual)
