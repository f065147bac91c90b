"""Stamps of messages as whole numbers, and back."""

from builtin_interfaces.msg import Time

from crane_bags.clocks import NANOSECONDS


def nanoseconds(stamp: Time) -> int:
    """A stamp as one number."""
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


def stamp_of(time: int) -> Time:
    """The stamp of a time in nanoseconds."""
    seconds, nanosec = divmod(time, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanosec)
