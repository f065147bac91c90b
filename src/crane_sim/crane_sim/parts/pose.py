"""A pose on the command line: `slew=0.3 telescope=0.6`."""

from collections.abc import Sequence

import numpy as np

from crane_model.errors import RangeError
from crane_model.machine import Machine


def parse_pose(words: Sequence[str], machine: Machine, rest: np.ndarray) -> np.ndarray:
    """(j,) coordinates [rad, m] from words JOINT=VALUE; joints that are not named are at `rest`.

    `RangeError` where a word is none of these.
    """
    q = rest.copy()
    for word in words:
        joint, _, value = word.partition("=")
        if joint not in machine.joint_names:
            raise RangeError(
                f"pose '{word}': no joint '{joint}'; write JOINT=VALUE with a joint of "
                f"{', '.join(machine.joint_names)} and its position in rad or m"
            )
        try:
            q[machine.index(joint)] = float(value)
        except ValueError:
            raise RangeError(f"pose '{word}': '{value}' is no number; write {joint}=0.5") from None
    return q
