"""Encoders that the sensor monitor has found to lie: they lead the crane nowhere."""

from collections.abc import Mapping

from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.news import Level, News


class LyingEncoders:
    """Those that were found since the driver began, until the monitor forgets them.

    What was found before concerns readings that this driver never made: it is told, and nothing
    follows from it.
    """

    def __init__(self) -> None:
        self._standing: dict[str, str] = {}  # joint: what is wrong
        self._before: set[str] = set()  # joints

    def take(self, told: Mapping[str, str], before: bool) -> tuple[list[Fault], list[News]]:
        """What is new in all that the monitor has found, joint by joint, and what to log.

        before: whether it was found before the driver began.
        """
        old = set(told) if before else self._before & set(told)
        news = [
            News(Level.WARNING, f"{joint}: {told[joint]}, found before this driver began: not "
                 "heeded; if it is not mended, mend it, then let sensor_monitor forget it")
            for joint in sorted(old - self._before)
        ]  # fmt: skip
        faults = [
            Fault(FaultKind.LYING, what, joint)
            for joint, what in told.items()
            if joint not in old and joint not in self._standing
        ]
        self._before = old
        self._standing = {joint: what for joint, what in told.items() if joint not in old}
        return faults, news

    def problem(self, substituted: str) -> str:
        """Why the crane may not be enabled; empty if it may. The encoder that is substituted is not
        believed anyway.
        """
        wrong = [
            f"{joint}: {what}" for joint, what in self._standing.items() if joint != substituted
        ]
        if not wrong:
            return ""
        return (
            f"{'; '.join(wrong)}; mend it and let sensor_monitor forget it, or go on without it "
            "by substitute"
        )
