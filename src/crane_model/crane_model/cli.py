"""What every command line of the suite does with errors and interrupts."""

import os
import sys
from collections.abc import Callable

from crane_model.errors import CraneError

INTERRUPTED = 130  # the shell's convention: 128 + SIGINT


def run(body: Callable[[], None]) -> int:
    """Run a command's body and turn what the suite raises into a message and an exit status."""
    try:
        body()
        sys.stdout.flush()
    except CraneError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader, say `head`, has seen enough; nothing is left to flush
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0
