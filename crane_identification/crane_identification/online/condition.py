"""What /diagnostics says of the identification."""

import math

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from crane_identification.online.estimator import OnlineEstimator
from crane_identification.online.recursion import Solution
from crane_identification.recording_check.suspicion import Checked

MATCHED_SHARE = 0.99
"""Share of positions with pressures below which something is wrong with stamps or topics."""


class Condition:
    """When the topics were last heard, by the steady clock, and what was wrong with them."""

    def __init__(self, timeout: float = 1.0):
        self.timeout = timeout
        self.problems: dict[str, str] = {}
        self._heard: dict[str, float] = {}

    def listen(self, now: float, *topics: str) -> None:
        """From now on, these topics and no others are expected."""
        self._heard = dict.fromkeys(topics, now)
        self.problems = {}

    def arrived(self, topic: str, now: float) -> None:
        """A message came."""
        self._heard[topic] = now

    def problem(self, topic: str, text: str) -> bool:
        """Something is wrong with a topic; True if that is news."""
        known = self.problems.get(topic)
        self.problems[topic] = text
        return known != text

    def well(self, topic: str) -> None:
        """A message was as it should be."""
        self.problems.pop(topic, None)

    def silent(self, now: float) -> list[str]:
        """Topics that were not heard for too long, and for how long."""
        return [
            f"{topic} silent for {now - heard:.1f} s"
            for topic, heard in self._heard.items()
            if now - heard > self.timeout
        ]


def status(
    name: str,
    condition: Condition,
    estimator: OnlineEstimator | None,
    solution: Solution | None,
    now: float,
) -> DiagnosticStatus:
    """The state of the estimation in one line, and its counters."""
    found = DiagnosticStatus(name=f"{name}: recursion", level=DiagnosticStatus.OK)
    if estimator is None:
        found.message = "not configured"
        return found
    matcher = estimator.matcher
    seen = matcher.matched + matcher.unmatched
    unknown = len(estimator.model.parameters)
    if solution is not None:
        unknown = int((~solution.determined).sum())
    warnings = condition.silent(now)
    if seen and matcher.matched < MATCHED_SHARE * seen:
        warnings.append(f"{matcher.unmatched} of {seen} positions without pressures of their time")
    if condition.problems:
        found.level = DiagnosticStatus.ERROR
        found.message = "; ".join(condition.problems.values())
    elif warnings:
        found.level = DiagnosticStatus.WARN
        found.message = "; ".join(warnings)
    elif unknown:
        found.message = f"{unknown} parameters not determined yet"
    else:
        found.message = "all parameters determined"
    values = {
        "samples [-]": estimator.samples,
        "gated share [-]": f"{estimator.gated_share:.3f}",
        "unmatched [-]": matcher.unmatched,
        "repeated [-]": matcher.repeated + estimator.smoother.repeated,
        "invalid [-]": estimator.invalid,
        "runs [-]": estimator.smoother.run + 1,
        "undetermined [-]": unknown,
        "condition number, normalised [-]": f"{_condition_number(solution):.4g}",
    }
    found.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return found


def recording(name: str, found: Checked | None) -> DiagnosticStatus:
    """What is suspicious of the signals themselves."""
    told = DiagnosticStatus(name=f"{name}: recording", level=DiagnosticStatus.OK)
    if found is None:
        told.message = "too little heard yet"
    elif found.suspicions:
        told.level = DiagnosticStatus.ERROR if found.decisive else DiagnosticStatus.WARN
        told.message = "; ".join(str(one) for one in found.suspicions)
    else:
        told.message = f"nothing suspicious in {found.source}"
    if found is not None:
        told.values = [KeyValue(key="not checked", value="; ".join(found.unchecked))]
    return told


def _condition_number(solution: Solution | None) -> float:
    return math.inf if solution is None else solution.condition_number
