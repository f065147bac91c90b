"""What typed characters ask for. A terminal tells of keys that go down, never of keys let go: a
joint moves only while characters of its key keep coming.
"""

import math
from collections.abc import Sequence
from enum import StrEnum

from crane_driver.operator.jog.motion import Demand

PAIRS = (
    *(("h", "l"), ("j", "k"), ("u", "i"), ("n", "m")),
    *(("f", "g"), ("c", "v"), ("a", "s"), ("t", "y")),
)
"""Keys of the joints from the base to the tip: down, up. Further joints have a joystick alone."""

STEPS = "123456789"
FIRST_STEP = 3
STOP = "x"


class Request(StrEnum):
    """What else a key may ask for; the services of the driver by their names."""

    ENABLE = "enable"
    DISABLE = "disable"
    RESET = "reset_fault"
    EMERGENCY_STOP = "emergency_stop"
    QUIT = "quit"


REQUESTS = {
    "e": Request.ENABLE,
    "d": Request.DISABLE,
    "r": Request.RESET,
    STOP: Request.EMERGENCY_STOP,
    "q": Request.QUIT,
}
CONTROLS = {str(request): key for key, request in REQUESTS.items()}


class Keyboard:
    """Each character of a joint's key holds the joint for `hold` seconds (steady clock).

    So a tap is a nudge of that length. A key that is held moves the joint so long, then the joint
    waits for the first repeat of the terminal, and goes on while repeats come. Every other key, and
    what comes at once with other characters, such as pasted text, lets the joint go.
    """

    def __init__(self, hold: float, joints: Sequence[str]):
        self._hold = hold
        self.pairs = dict(zip(joints, PAIRS, strict=False))
        self._keys = {
            key: (joint, direction)
            for joint, pair in self.pairs.items()
            for key, direction in zip(pair, (-1, 1), strict=True)
        }
        self._joint, self._direction = "", 0
        self._until = -math.inf
        self.step = FIRST_STEP  # tenths of the fastest

    def typed(self, text: str, now: float) -> Request | None:
        """Take the characters that came at once, one or more."""
        if not text:
            return None
        self._until = -math.inf
        if STOP in text:  # even within what an arrow or Alt sends: one too many harms nobody
            return Request.EMERGENCY_STOP
        (key, *others) = set(text)
        if others:
            return None
        if key in self._keys:
            self._joint, self._direction = self._keys[key]
            self._until = now + self._hold
        elif key in STEPS:
            self.step = int(key)
        return REQUESTS.get(key)

    def demand(self, now: float) -> Demand | None:
        """What is held at `now`."""
        if now >= self._until:
            return None
        return Demand(self._joint, self._direction * self.step / 10)
