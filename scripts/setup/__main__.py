"""Sets up this clone: virtual environment, pinned packages, `colcon build`; extras as arguments.

Only the standard library is imported: this runs before any package is installed. Every step looks
first whether its work is done already.
"""

import fcntl
import sys
from pathlib import Path

import packages
import prerequisites
import workspace
from machine import Machine, SetupError

ROOT = Path(__file__).resolve().parents[2]


def main() -> int:
    """Run the steps in order; 0, or 1 with one line per reason on standard error."""
    with (ROOT / "Makefile").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two calls at once: the second waits, then has no work
        try:
            machine = Machine.this(ROOT)
            if not packages.up_to_date(machine):
                prerequisites.check(machine)
                packages.install(machine)
            if not workspace.up_to_date(machine):
                prerequisites.check(machine)
                workspace.build(machine)
            workspace.forget_compiled(machine)
            for extra in sys.argv[1:]:
                packages.install_extra(machine, extra)
        except SetupError as error:
            for line in error.args:
                print(f"error: {line}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
