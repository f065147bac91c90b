"""The joints of the laboratory crane, for tests of it."""

JOINTS = ("slew", "inner_boom", "outer_boom", "telescope")
PLANAR_JOINTS = JOINTS[1:]
JOINT_UNITS = {"slew": "rad", "inner_boom": "rad", "outer_boom": "rad", "telescope": "m"}
