"""What bring-up, jog and panel share: words, and the rhythm of their commands."""

import re
from collections.abc import Mapping

# How bring-up and jog send commands: often, and never after a pause that the driver minds.

COMMAND_PERIOD_S = 0.01
LONGEST_PAUSE_S = 0.08  # between two commands; the driver refuses the next unless it is neutral


# One wording of what to do: the driver names its services, a hand has buttons or keys for them.


def by_hand(text: str, controls: Mapping[str, str]) -> str:
    """`text` with "press CONTROL" in the place of "call SERVICE".

    controls: what is pressed, by the service of the driver that it calls; others stay.
    """
    if not controls:
        return text
    service = rf"\b(?:{'|'.join(map(re.escape, controls))})\b"
    return re.sub(
        rf"\bcall ({service}(?: and {service})*)",
        lambda found: "press " + re.sub(service, lambda one: controls[one[0]], found[1]),
        text,
    )
