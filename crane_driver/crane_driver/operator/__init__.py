"""Words that bring-up, jog and panel share, and the rhythm of their commands."""

import re
from collections.abc import Mapping


def by_hand(text: str, controls: Mapping[str, str]) -> str:
    """`text` with "press CONTROL" in the place of "call SERVICE".

    controls: what is pressed, by the service of the driver that it calls; others stay.
    """
    if not controls:
        return text
    service = rf"\b(?:{'|'.join(map(re.escape, controls))})\b"
    return re.sub(
        rf"\bcall ({service}(?: and {service})*)",
        lambda found: (
            "press " + re.sub(service, lambda service_match: controls[service_match[0]], found[1])
        ),
        text,
    )
