"""The exceptions of the suite: each message says which object, limit and value, and what to do."""

MAX_LINE_CHARACTERS = 2000
MAX_MESSAGE_LINES = 50


class CraneError(Exception):
    """Base of every error the suite raises on purpose; catching it catches all of them.

    What came from outside may be of any length; a message that holds it stays readable.
    """

    def __str__(self) -> str:
        lines = super().__str__().split("\n")
        if (more := len(lines) - MAX_MESSAGE_LINES) > 0:
            lines[MAX_MESSAGE_LINES:] = [f"and {more} more"]
        return "\n".join(map(_shortened, lines))


def _shortened(line: str) -> str:
    """Without its middle if it is long: the beginning says what it is about, the end what to do."""
    if len(line) <= MAX_LINE_CHARACTERS:
        return line
    half = MAX_LINE_CHARACTERS // 2
    return f"{line[:half]} ... [{len(line) - 2 * half} characters left out] ... {line[-half:]}"


class ConfigurationError(CraneError):
    """A configuration file is wrong.

    Examples: a key is misspelt, an area is negative, a linkage does not close over the range of
    its joint, a trajectory names a joint that the machine does not have.
    """


class RangeError(CraneError):
    """A physical quantity is outside the range in which the equations hold.

    Examples: a joint angle at which the linkage cannot be assembled, a reference that passes a
    limit of Table 2, a command that is not a finite number.
    """


class DataError(CraneError):
    """Recorded data are missing, damaged or insufficient.

    Examples: a bag without joint states, a table without the column that the map names, a fit of
    parameters that the motion does not excite.
    """


class NoMotionError(DataError):
    """No joint of the model moves in a recording: it tells nothing of the mechanics."""
