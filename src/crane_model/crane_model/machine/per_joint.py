"""What stays for tables of the laboratory crane until every table asks its machine."""

from typing import Any, Generic, SupportsIndex, TypeVar

import numpy as np

from crane_model.configuration import Schema

JOINTS = ("slew", "inner_boom", "outer_boom", "telescope")
PLANAR_JOINTS = JOINTS[1:]
JOINT_UNITS = {"slew": "rad", "inner_boom": "rad", "outer_boom": "rad", "telescope": "m"}

Entry = TypeVar("Entry", bound=Schema | float)


class PerJoint(Schema, Generic[Entry]):
    """One entry a joint."""

    slew: Entry
    inner_boom: Entry
    outer_boom: Entry
    telescope: Entry

    def __getitem__(self, joint: str) -> Entry:
        entry: Entry = getattr(self, joint)
        return entry

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """A class such as `PerJoint[float]` is in no module, where pickle looks for classes."""
        kinds = type(self).__pydantic_generic_metadata__["args"]
        return (_per_joint, (*kinds, dict(self))) if kinds else super().__reduce_ex__(protocol)

    def array(self, key: str) -> np.ndarray:
        """(4,) the value `key` of every entry, in the order of JOINTS."""
        return np.array([getattr(self[joint], key) for joint in JOINTS], dtype=float)


def _per_joint(kind: Any, entries: dict[str, Any]) -> Any:
    return PerJoint[kind](**entries)
