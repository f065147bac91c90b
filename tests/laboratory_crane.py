"""The joints of the laboratory crane and its linkages, for tests of it."""

from crane_model import Machine

JOINTS = ("slew", "inner_boom", "outer_boom", "telescope")
PLANAR_JOINTS = JOINTS[1:]
JOINT_UNITS = {"slew": "rad", "inner_boom": "rad", "outer_boom": "rad", "telescope": "m"}

LINKAGES = {
    "inner_boom": ("j1", "j2", "length_min", "length_max"),
    "outer_boom": ("s22", "s23", "c1", "c2", "s31", "s32", "length_min", "length_max"),
}
"""The lengths of what a cylinder turns, of each joint that has such a linkage."""


def with_linkage(machine: Machine, joint: str, factor: float) -> Machine:
    """The machine with all lengths of one linkage `factor` times as large; angles stay."""
    content = machine.model_dump(by_alias=True)
    (actuator,) = (one["actuator"] for one in content["joints"] if one["name"] == joint)
    for length in LINKAGES[joint]:
        actuator[length] *= factor
    return Machine.model_validate(content)
