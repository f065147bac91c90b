"""What every command line of the suite does with errors and interrupts."""

import sys
from collections.abc import Callable

from crane_model.errors import CraneError

INTERRUPTED = 130  # the shell's convention: 128 + SIGINT


def run(body: Callable[[], None]) -> int:
    """Run a command's body and turn what the suite raises into a message and an exit status."""
    try:
        body()
    except CraneError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0
