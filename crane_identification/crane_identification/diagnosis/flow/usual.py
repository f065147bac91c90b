"""What is usual of valves and oil, in a file beside the code."""

from pathlib import Path

from crane_model.configuration import Positive, Schema, load
from crane_model.machine_files import machine_file


class Usual(Schema):
    """What is usual of valves and oil; `hydraulics.yaml` says what each is."""

    dead_zone: dict[str, Positive]
    hysteresis: Positive
    asymmetry: Positive
    leakage: Positive
    bulk_modulus: Positive


def load_usual(path: Path | None = None) -> Usual:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or machine_file("hydraulics.yaml"), Usual)
