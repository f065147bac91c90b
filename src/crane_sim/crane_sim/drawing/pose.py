"""A pose on the command line: `slew=0.3 telescope=0.6`."""

from collections.abc import Sequence

import numpy as np

from crane_model.errors import RangeError
from crane_model.machine import JOINTS


def parse_pose(words: Sequence[str], rest: np.ndarray) -> np.ndarray:
    """(4,) coordinates [rad, m] from words JOINT=VALUE; joints that are not named are at `rest`.

    `RangeError` where a word is none of these.
    """
    q = rest.copy()
    for word in words:
        joint, _, value = word.partition("=")
        if joint not in JOINTS:
            raise RangeError(
                f"pose '{word}': no joint '{joint}'; the joints are {', '.join(JOINTS)}"
            )
        try:
            q[JOINTS.index(joint)] = float(value)
        except ValueError:
            raise RangeError(f"pose '{word}': '{value}' is no number; write {joint}=0.5") from None
    return q
