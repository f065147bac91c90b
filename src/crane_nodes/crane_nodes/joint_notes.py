"""Notes on each joint of a machine, for nodes and operators: its `joints.yaml`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field, RootModel

from crane_model.configuration import Positive, Schema, load
from crane_model.machine_files import of_every_joint


class JointNote(Schema):
    """An entry of `joints.yaml`, where the units are."""

    jerk_density: Positive
    tracking_tolerance: Annotated[float, Field(ge=1e-4, le=2.0)]
    joystick_axis: Annotated[int, Field(ge=0, le=63)]
    positive: str
    ruler: str


class JointNotes(RootModel[dict[str, JointNote]]):
    """The whole file."""


def load_joint_notes(path: Path | str, joints: Mapping[str, str]) -> dict[str, JointNote]:
    """The notes of the `joints` of a machine, in their order; `ConfigurationError` if wrong."""
    return of_every_joint(load(path, JointNotes).root, tuple(joints), str(path))
