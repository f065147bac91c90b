"""A trajectory file read in a process of its own, where no thread of this one waits for it.

A few kB of YAML with aliases take a second to check, and hold the lock of the interpreter all the
time: a node that leads a crane cannot afford that.
"""

import json
import resource
import subprocess
import sys
from pathlib import Path

from crane_model.configuration import validate
from crane_model.errors import ConfigurationError
from crane_trajectory.motion.fourier import FourierTrajectory
from crane_trajectory.motion.periodic import load_trajectory, schema_of
from crane_trajectory.motion.sweep import SweepTrajectory

READING_TIME = 10  # s, of the processor
LONGEST_WAIT = 60  # s, by the clock: a busy computer gives little time to what is not urgent
MEMORY = 2**32  # bytes
LARGEST_ANSWER = 1_000_000  # characters
REFUSED = 3  # exit status: standard output says why


def read_apart(path: Path | str) -> FourierTrajectory | SweepTrajectory:
    """As `load_trajectory`; `ConfigurationError` too if it takes more time or memory than any
    trajectory does.
    """
    reader = sys.executable, "-m", __name__, str(path)
    try:
        done = subprocess.run(reader, capture_output=True, text=True, timeout=LONGEST_WAIT)
    except subprocess.TimeoutExpired:
        raise ConfigurationError(
            f"{path}: cannot be read within {LONGEST_WAIT} s; is it the right file?"
        ) from None
    except (ValueError, OSError) as error:  # no path at all, or longer than any
        raise ConfigurationError(f"{path!r}: cannot be read: {error}") from None
    if done.returncode == REFUSED:
        raise ConfigurationError(done.stdout)
    if done.returncode or len(done.stdout) > LARGEST_ANSWER:
        why = (done.stderr.strip().splitlines() or ["it is too large"])[-1]
        raise ConfigurationError(f"{path}: cannot be read: {why}")
    content = json.loads(done.stdout)
    return validate(content, schema_of(content), path)


def main() -> int:
    """Tell the content of a trajectory file as JSON, or why it is none."""
    resource.setrlimit(resource.RLIMIT_CPU, (READING_TIME, READING_TIME))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    try:
        trajectory = load_trajectory(sys.argv[1])
    except ConfigurationError as error:
        sys.stdout.write(str(error)[:LARGEST_ANSWER])
        return REFUSED
    sys.stdout.write(json.dumps(trajectory.model_dump(mode="json", exclude_none=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
