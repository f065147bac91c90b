"""Serial chains of rigid bodies in space, compiled: kinematics and dynamics of any machine.

Here are the constants of a chain, which `Machine` needs; the modules hold the compiled functions.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array, Flags


class SerialChain(NamedTuple):
    """m joints from the base to the tip, each with the body that it moves; j coordinates q.

    The frame of a body is that of its joint after it has moved; joint i stands in the frame of
    body i - 1, or of the base, at `translation` and turned by `rotation`, and moves body i along
    or about `axis` by `ratio` q[`leader`]. Several joints may have one leader.
    """

    rotation: Array  # (m, 3, 3)
    translation: Array  # (m, 3) m
    axis: Array  # (m, 3) unit vectors in the joint's frame
    slides: Flags  # (m,) prismatic
    leader: NDArray[np.int64]  # (m,) whole numbers
    ratio: Array  # (m,)
    gravity: Array  # (3,) in the base's frame, m/s2
    tip_rotation: Array  # (3, 3) in the frame of the last body
    tip_translation: Array  # (3,) m
