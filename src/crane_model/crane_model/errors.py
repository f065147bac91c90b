"""The exceptions of the suite: each message says which object, limit and value, and what to do."""


class CraneError(Exception):
    """Base of every error the suite raises on purpose; catching it catches all of them."""


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
