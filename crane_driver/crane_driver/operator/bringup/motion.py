"""Small motions of one joint, each bounded, watched and brought to rest. No ROS."""

from typing import NamedTuple, Protocol

import numpy as np

from crane_driver import constants
from crane_driver.operator.bringup.estimates import JointInstant, Nudge, Rest, Trace
from crane_model.errors import CraneError, DataError


class MotionError(CraneError):
    """The crane did what it should not; it was brought to neutral.

    Examples: another joint moves than the one that is commanded, a joint goes further than it may.
    """


class StoppedError(MotionError):
    """A motion that was cut off by what is not of the crane: it may be made again.

    Examples: this computer stalled, no joint states came, the driver has a fault.
    """


class Tick(NamedTuple):
    """When a command was sent [s, the clock of the samples], and the samples until the next."""

    sent: float
    samples: list[JointInstant]


class Drive(Protocol):
    """Sends one command at a time to one valve, all others neutral."""

    def tick(self, command: float) -> Tick:
        """Send a command -1 to 1; returns when the next one is due. Raises if it cannot."""

    def leave(self) -> None:
        """Neutral commands for a while, whatever else is wrong."""

    def recover(self) -> None:
        """Reset the fault of the driver and enable it again."""


class Mover:
    """Moves one joint through a drive, and lets go as soon as something is not as expected."""

    def __init__(
        self, drive: Drive, joints: tuple[str, ...], joint: str, rests: list[Rest], travel: float
    ):
        """rests: of all joints, before any motion; travel: of the joint from there [rad, m]."""
        self.joint, self.rest = joint, rests[joints.index(joint)]
        self.drive, self._joints, self._index = drive, joints, joints.index(joint)
        self._start = np.array([rest.position for rest in rests])
        self._sinking = constants.FASTEST_SINKING * (np.arange(len(joints)) != self._index)
        self._allowed = constants.SHAKEN_MOVEMENTS * np.array([rest.movement for rest in rests])
        self._allowed[self._index] = travel
        self.samples: list[JointInstant] = []
        self._sent: list[tuple[float, float]] = []

    def tick(self, command: float) -> None:
        """One cycle of a command; `MotionError` if the crane goes where it should not."""
        tick = self.drive.tick(command)
        self._sent.append((tick.sent, command))
        before = self.samples[-1:]
        self.samples += tick.samples
        self._watch(before)
        if before and (leap := before[0].time - self.samples[-1].time) > constants.CLOCK_SET_BACK_S:
            raise MotionError(  # by that clock commands rise and fall
                f"the clock of the joint states was set back by {leap:.3g} s; measure again"
            )

    @property
    def position(self) -> float:
        return float(self.samples[-1].position[self._index])

    @property
    def speed(self) -> float:
        return float(self.samples[-1].velocity[self._index])

    @property
    def displacement(self) -> float:
        """From where it was before anything moved [rad, m]."""
        return self.position - self.rest.position

    def trace(self, first: int) -> Trace:
        """The samples from the one with the number `first` on."""
        samples = self.samples[first:]
        time = np.array([sample.time for sample in samples])
        sent = np.array([(-np.inf, 0.0), *self._sent])
        command = sent[np.searchsorted(sent[:, 0], time, side="right") - 1, 1]
        return Trace(time, np.array([sample.position[self._index] for sample in samples]), command)

    def settle(self) -> None:
        begun = self.samples[-1].time if self.samples else None
        while True:
            self.tick(0.0)
            if not self.samples:
                continue
            now = self.samples[-1].time
            begun = now if begun is None else begun
            recent = [
                sample.position[self._index]
                for sample in self.samples
                if sample.time > now - constants.STILL_S
            ]
            if now - begun >= constants.STILL_S and np.ptp(recent) <= self.rest.movement:
                return
            if now - begun > constants.MOTION_TIMEOUT_S:
                raise MotionError(
                    f"{self.joint} does not come to rest within {constants.MOTION_TIMEOUT_S:g} s "
                    "of neutral; it sinks or swings, and nothing can be measured on it"
                )

    def _watch(self, before: list[JointInstant]) -> None:
        if not self.samples:
            return
        now = self.samples[-1]
        if before:
            sinking = self._sinking * (now.time - before[0].time)
            self._start = _followed(self._start, now.position, sinking)
        moved = now.position - self._start
        for i in np.flatnonzero(~(np.abs(moved) <= self._allowed)):  # what is no number, too
            if i == self._index:
                raise MotionError(
                    f"{self.joint} has moved by {moved[i]:+.3g}, allowed ±{self._allowed[i]:.3g}"
                )
            raise MotionError(
                f"{self._joints[i]} has moved by {moved[i]:+.3g} while {self.joint} was commanded, "
                f"allowed ±{self._allowed[i]:.3g} and what sinks at {constants.FASTEST_SINKING:g} "
                "per second; are signals, hoses or plugs exchanged, or does it sink faster?"
            )


def nudge(mover: Mover, direction: int, rate: float, limit: float) -> Nudge:
    """Open the valve slowly in a direction until the joint moves, then neutral at once.

    rate: of the command [1/s]; limit: of the command; `DataError` if nothing moves up to it.
    """
    mover.settle()
    start, begun = mover.position, mover.samples[-1].time
    command = 0.0
    while abs(mover.position - start) <= mover.rest.movement:
        now = mover.samples[-1].time
        command = _within(mover, rate * (now - begun), limit)
        mover.tick(direction * command)
        sinking = constants.FASTEST_SINKING * (mover.samples[-1].time - now)
        start = float(_followed(start, mover.position, sinking))
    moved = mover.position - start
    mover.settle()
    return Nudge(command=direction * command, moved=moved, displacement=mover.position - start)


def triangle(mover: Mover, direction: int, rate: float, speed: float, limit: float) -> Trace:
    """Open the valve slowly until the joint has a speed and has moved far enough to be measured,
    then close it as slowly; from rest to rest.

    rate: of the command [1/s]; speed: [rad/s, m/s]; limit: of the command. `MotionError` if the
    joint moves the other way.
    """
    mover.settle()
    first, start, begun = len(mover.samples), mover.position, mover.samples[-1].time
    command = 0.0
    while not (
        direction * mover.speed >= speed
        and abs(mover.position - start) > constants.TRIANGLE_MOVEMENTS * mover.rest.movement
    ):
        command = _within(mover, rate * (mover.samples[-1].time - begun), limit)
        mover.tick(direction * command)
        if (
            direction * (moved := mover.position - start)
            < -constants.TRIANGLE_MOVEMENTS * mover.rest.movement
        ):
            raise MotionError(
                f"{mover.joint} moves against its command: by {moved:+.3g} at "
                f"{direction * command:+.3g}; find its polarity first: bringup valves"
            )
    peak, turned = command, mover.samples[-1].time
    while command > 0.0:
        command = max(0.0, peak - rate * (mover.samples[-1].time - turned))
        mover.tick(direction * command)
    mover.settle()
    return mover.trace(first)


def step(mover: Mover, command: float, duration: float, limit: float) -> Trace:
    """From rest, a command at once and for `duration` [s]; the trace ends with it.

    `DataError` if the command is beyond `limit`; then nothing moves.
    """
    if abs(command) > limit:
        raise DataError(
            f"{mover.joint}: a step of {abs(command):.3g}, limit {limit:g}; lower --speed, or "
            "allow more with --limit"
        )
    mover.settle()
    first, begun = len(mover.samples), mover.samples[-1].time
    while mover.samples[-1].time - begun < duration:
        mover.tick(command)
    trace = mover.trace(first)
    mover.settle()
    return trace


def back(mover: Mover, upwards: float, downwards: float) -> None:
    """Return to where the joint was before anything moved, by commands that move it slowly.

    `MotionError` if it comes no nearer for `MOTION_TIMEOUT_S`: a command that is left standing
    would move it when the oil comes back.
    """
    if abs(mover.displacement) <= mover.rest.movement:
        return
    sign = np.sign(mover.displacement)
    command = downwards if sign > 0 else upwards
    nearest, since = sign * mover.displacement, mover.samples[-1].time
    while (left := sign * mover.displacement) > 0.0:
        now = mover.samples[-1].time
        if left < nearest - mover.rest.movement:
            nearest, since = left, now
        elif now - since > constants.MOTION_TIMEOUT_S:
            raise MotionError(
                f"{mover.joint} does not come back by a command of {command:.3g} in "
                f"{constants.MOTION_TIMEOUT_S:g} s"
            )
        mover.tick(command)
    mover.settle()


def _followed(
    reference: float | np.ndarray, position: float | np.ndarray, most: float | np.ndarray
) -> np.ndarray:
    """Joints that only sank, moved towards `position` by at most `most` [rad, m]."""
    most = np.maximum(most, 0.0)  # stamps may be set back
    return reference + np.clip(position - reference, -most, most)


def _within(mover: Mover, command: float, limit: float) -> float:
    if command > limit:
        raise DataError(
            f"{mover.joint} does not move as asked up to a command of {limit:g}; is the engine "
            "running, the supply on, the driver enabled, the joint away from its limits "
            "(/diagnostics)? Else allow more with --limit"
        )
    return command
