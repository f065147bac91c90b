"""Faults, kept until they are reset."""

from collections import UserDict
from dataclasses import dataclass

from crane_driver.faults import IN_EVERY_STATE, Fault


@dataclass
class Latched:
    """A fault since the last reset: what was said first, and how often it came."""

    fault: Fault
    count: int = 1


class LatchedFaults(UserDict[str, Latched]):
    """By kind and source, in the order in which they came first."""

    @property
    def first(self) -> Fault | None:
        """The one that is told: others that are latched follow from it, most of the time."""
        faults = [one.fault for one in self.values()]
        return next((one for one in faults if one.kind in IN_EVERY_STATE), next(iter(faults), None))

    def add(self, fault: Fault) -> bool:
        """Whether it is a new one."""
        key = f"{fault.kind} {fault.source}".strip()
        if key in self:
            self[key].count += 1
            return False
        self[key] = Latched(fault)
        return True
