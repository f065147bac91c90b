"""What is usual of valves and oil, in a file beside the code."""

from pathlib import Path

from crane_model.configuration import Positive, Schema, load, packaged


class Usual(Schema):
    """What is usual of valves and oil; `hydraulics.yaml` says what each is."""

    dead_zone: dict[str, Positive]
    hysteresis: Positive
    asymmetry: Positive
    leakage: Positive
    bulk_modulus: Positive


def load_usual(path: Path | None = None) -> Usual:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or packaged("crane_identification", "hydraulics.yaml"), Usual)
