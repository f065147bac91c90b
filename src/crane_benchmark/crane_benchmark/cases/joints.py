"""The joints of the laboratory crane that the benchmark is about: their pressures are measured."""

from crane_model.machine import load_machine

LABORATORY_CRANE = load_machine()
PLANAR_JOINTS = LABORATORY_CRANE.as_planar().joints
PLANAR = [LABORATORY_CRANE.index(joint) for joint in PLANAR_JOINTS]
