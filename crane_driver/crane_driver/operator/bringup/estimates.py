"""Estimates of a bring-up from its records: rest, encoders, transducers, valves. No ROS."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from crane_driver import constants
from crane_model.errors import DataError
from crane_model.result_file import ResultPart

ENCODER_TURN_RAD = 2.0 * np.pi  # rad, after which an encoder of one turn begins anew


class JointInstant(NamedTuple):
    """The joints at one instant, in the order of the crane's joints."""

    time: float  # s
    position: np.ndarray  # (j,) rad, m
    velocity: np.ndarray  # (j,) rad/s, m/s


@dataclass(frozen=True)
class Trace:
    """n samples of one joint while it was commanded."""

    time: np.ndarray  # (n,) s, rising
    position: np.ndarray  # (n,) rad, m
    command: np.ndarray  # (n,) -1..1, the one that stood at `time`

    def turned(self, direction: int) -> "Trace":
        """The trace as it is when positive and negative are exchanged, for `direction` -1."""
        return Trace(self.time, direction * self.position, direction * self.command)


@dataclass(frozen=True)
class Rest:
    """A joint that stands, or sinks by leakage, at the beginning of a record."""

    position: float  # rad, m: at the beginning
    noise: float  # rad, m: standard deviation of one reading
    resolution: float  # rad, m
    sinking: float = 0.0  # rad/s, m/s

    @property
    def movement(self) -> float:
        """The least displacement that cannot be noise [rad, m]."""
        return constants.MOVEMENT_STEPS * max(self.noise, self.resolution)


def at_rest(
    name: str, time: np.ndarray, readings: np.ndarray, resolution: float, period: float | None
) -> Rest:
    """A line through readings (n,) of a joint at rest [rad, m] at `time` [s], at least
    `FEWEST_READINGS`.

    With a `period` the mean is that of the circle, so that readings to either side of the wrap of
    an encoder do not cancel. `DataError` if the joint moved meanwhile, and not as one that sinks.
    """
    if period is not None:
        angle = np.angle(np.mean(np.exp(2j * np.pi * (readings - readings[0]) / period)))
        middle = float(readings[0] + angle * period / (2.0 * np.pi))
        readings = middle + (readings - middle + period / 2.0) % period - period / 2.0
    since = time - time[0]
    seconds = float(np.ptp(since))
    rate, first = (float(coefficient) for coefficient in np.polyfit(since, readings, 1))
    noise = float(np.std(readings - first - rate * since))
    drift, allowed = (
        rate * seconds,
        max(constants.MOVEMENT_STEPS * resolution, constants.FASTEST_SINKING * seconds),
    )
    # not in units of the noise, which a motion would itself raise
    if not abs(drift) <= allowed:
        raise DataError(
            f"{name} is not at rest: it drifted by {drift:+.3g} in {seconds:.3g} s, allowed "
            f"±{allowed:.3g}; let it settle and measure again. If it sinks so fast by itself, "
            "support it, or repair the leak"
        )
    return Rest(first, noise, resolution, rate)


def moved(time: np.ndarray, position: np.ndarray, rest: Rest) -> float:
    """How far a joint went (n,) [rad, m] that was moved, without what it sank before and after.

    It sinks for as long as the operator takes; what goes faster than `FASTEST_SINKING` was
    moved. Means of `BLOCK_S` take shaking out.
    """
    since = time - time[0]
    _, block, count = np.unique(since // constants.BLOCK_S, return_inverse=True, return_counts=True)
    at, where = (np.bincount(block, values) / count for values in (since, position))
    displacement = np.diff(where)
    fast = np.abs(displacement) > constants.FASTEST_SINKING * np.diff(at) + 2.0 * max(
        rest.noise, rest.resolution
    )
    return float(displacement[fast].sum())


class EncoderResult(ResultPart):
    """Sign and zero of an encoder: joint = sign * (reading - zero)."""

    sign: Literal[-1, 1]
    """Sign of the encoder [-]."""
    zero: float
    """Reading where the joint stands at 0 [rad, m]."""
    noise: float
    """Standard deviation of one reading [rad, m]."""
    resolution: float
    """Resolution of the readings [rad, m]."""
    moved: float
    """Displacement by the readings, in the positive direction [rad, m]."""
    scale: float | None = None
    """Displacement by the readings over that by the second known pose; absent without one [-]."""
    sinking: float
    """In the positive direction, at the known pose [rad/s, m/s]."""


def find_encoder(
    joint: str,
    rest: Rest,
    known: float,
    moved: float,
    displacement: float,
    moved_to: float | None = None,
) -> EncoderResult:
    """Zero and sign of the encoder of `joint`.

    rest: readings at the pose where the joint is known to be at `known` [rad, m]
    moved: by the readings, by how much it was moved from there in its positive direction [rad, m]
    displacement: by the readings, from there to the end, with what it sank meanwhile [rad, m]
    moved_to: where it is known to be at the end [rad, m]
    `DataError` if the movement was too small to tell it from noise, or contradicts `moved_to`.
    """
    smallest = constants.SMALLEST_MOVEMENTS * rest.movement
    if abs(moved) < smallest:
        raise DataError(
            f"{joint}: the encoder was moved by {abs(moved):.3g}, at least {smallest:.3g} is "
            "needed for the direction; move the joint further, faster than "
            f"{constants.FASTEST_SINKING:g} per second (slower, it counts as sinking), and no "
            "other one"
        )
    sign: Literal[-1, 1] = 1 if moved > 0 else -1
    scale = None
    if moved_to is not None:
        if abs(moved_to - known) < smallest:
            raise DataError(
                f"{joint}: moved from {known:.4g} to {moved_to:.4g}, at least {smallest:.3g} "
                "is needed for the scale; move it further, and check the two values"
            )
        scale = sign * displacement / (moved_to - known)
        if scale <= 0.0:
            raise DataError(
                f"{joint}: moved from {known:.4g} to {moved_to:.4g}, which is not the direction "
                "in which it was moved; move it in its positive direction, and check the two values"
            )
        if abs(scale - 1.0) > constants.SCALE_TOLERANCE:
            raise DataError(
                f"{joint}: the encoder shows {sign * displacement:.4g}, but the joint moved by "
                f"{moved_to - known:.4g}: a ratio of {scale:.3f}, allowed 1 ± "
                f"{constants.SCALE_TOLERANCE}; check unit and scale of the signal in the DBC, the "
                "gear of the encoder, and the two values"
            )
    return EncoderResult(
        sign=sign,
        zero=rest.position - sign * known,
        noise=rest.noise,
        resolution=rest.resolution,
        moved=sign * displacement,
        scale=scale,
        sinking=sign * rest.sinking,
    )


class PressureResult(ResultPart):
    """Zero and noise of a transducer that is vented."""

    offset: float
    """Mean reading [Pa]."""
    spread: float
    """Standard deviation of one reading [Pa]."""
    std: float
    """Standard deviation of the offset [Pa]."""
    stuck: bool
    """All readings are the same: at the end of the range, or not alive."""


def find_offset(name: str, readings: np.ndarray) -> PressureResult:
    """Offset of one transducer from readings (n,) [Pa] with its chamber vented.

    `DataError` if the pressure was not at rest, or too far from that of the air for an offset.
    """
    offset, spread = float(np.mean(readings)), float(np.std(readings))
    half = len(readings) // 2
    drift = abs(float(np.mean(readings[half:]) - np.mean(readings[:half])))
    if not np.isfinite(offset):
        raise DataError(f"{name}: some of its readings are missing; see /diagnostics")
    if abs(offset) > constants.LARGEST_OFFSET_PA:
        raise DataError(
            f"{name} reads {offset / 1e5:.2f} bar, an offset is at most "
            f"{constants.LARGEST_OFFSET_PA / 1e5:g} bar; the chamber is not vented: stop the "
            "engine, lower the crane onto its supports and let the pressure off"
        )
    if spread > constants.LARGEST_SPREAD_PA or drift > constants.LARGEST_DRIFT_PA:
        raise DataError(
            f"{name} is not at rest: spread {spread / 1e5:.2f} bar, limit "
            f"{constants.LARGEST_SPREAD_PA / 1e5:g}; drift {drift / 1e5:.2f} bar, limit "
            f"{constants.LARGEST_DRIFT_PA / 1e5:g}; wait, and measure again"
        )
    stuck = bool(np.ptp(readings) == 0.0)
    return PressureResult(
        offset=offset, spread=spread, std=spread / np.sqrt(len(readings)), stuck=stuck
    )


class Nudge(ResultPart):
    """The first movement of a joint under a command that rose slowly from 0."""

    command: float
    """At which the movement was seen, -1 to 1 [-]."""
    moved: float
    """Displacement until it was seen [rad, m]."""
    displacement: float
    """Displacement until the joint stood again [rad, m]."""


class PolarityResult(ResultPart):
    """Polarity of a valve."""

    polarity: Literal[-1, 1]
    """Factor of the sign of its command [-]."""
    up: Nudge
    """By a positive command."""
    down: Nudge
    """By a negative command."""


def find_polarity(joint: str, up: Nudge, down: Nudge) -> PolarityResult:
    """`DataError` if both commands moved the joint in the same direction."""
    if up.moved * down.moved >= 0.0:
        raise DataError(
            f"{joint}: moved by {up.moved:+.3g} at the command {up.command:+.3f} and by "
            f"{down.moved:+.3g} at {down.command:+.3f}, both in one direction; it sinks by itself, "
            "or one side of its valve does not work"
        )
    return PolarityResult(polarity=1 if up.moved > 0.0 else -1, up=up, down=down)


@dataclass(frozen=True)
class DeadBandFit:
    """One triangle in one direction; values and standard deviations of the fit."""

    dead_band: float  # command, positive
    gain: float  # rad/s, m/s per command beyond the dead band
    lag: float  # s
    dead_band_std: float
    fitted: np.ndarray  # (n,) rad, m: position by the fit; NaN where samples were left out
    opened: float  # s, for which the valve was open

    @property
    def hurried(self) -> bool:
        return self.lag > constants.LONGEST_LAG_SHARE * self.opened

    def agrees(self, other_rate: "DeadBandFit") -> bool:
        pairs = (self.dead_band, other_rate.dead_band), (self.gain, other_rate.gain)
        return all(
            abs(faster - slower) <= constants.RATE_TOLERANCE * max(faster, slower)
            for faster, slower in pairs
        )


class RampFit(NamedTuple):
    """A ramp of the command, and what was fitted to it."""

    trace: Trace
    fit: DeadBandFit


class DeadBandResult(ResultPart):
    """All repeats of one direction."""

    dead_band: float
    """Mean command at which the joint begins to move, positive [-]."""
    dead_band_std: float
    """Standard deviation between repeats; with one repeat, of its fit [-]."""
    gain: float
    """Mean speed per command beyond the dead band [rad/s, m/s]."""
    lag: float
    """Mean lag of the speed behind the command [s]."""
    repeats: int
    """How many [-]."""
    gain_std: float | None = None
    """Standard deviation of the gain between repeats; absent with one repeat [rad/s, m/s]."""
    rate: float | None = None
    """Rate of the ramps; slower than asked if the joint answers late [1/s]."""


def fit_dead_band(name: str, trace: Trace, direction: int) -> DeadBandFit:
    """Fit a triangle of the command in `direction` (1, -1), from rest to rest.

    Beyond the dead band u0 the speed is K (u(t - τ) - u0). While the command rises, the lag τ makes
    the valve seem to open late, by the rate of the ramp times τ; while it falls, to close late. A
    triangle has both, so u0, K and τ are determined together; u0 is the command extrapolated to
    zero speed. The first part of the displacement is left out: there the oil is compressed until
    friction gives way. A heavy joint on soft oil answers by no lag alone: unless the valve opens
    and closes much more slowly than it answers, u0 and K are those of the ramp, not of the valve.

    `DataError` if the joint did not move in that direction, or not as a valve moves it.
    """
    from scipy.integrate import cumulative_trapezoid  # half a second to import
    from scipy.optimize import least_squares

    turned = trace.turned(direction)
    time = turned.time - turned.time[0]
    position = turned.position - turned.position[0]
    displacement = float(position.max())
    if displacement <= -float(position.min()):
        raise DataError(f"{name}: no movement in the direction of the command; check its polarity")
    start = int(np.argmax(position > constants.LEFT_OUT_SHARE * displacement))
    used = np.arange(len(position)) >= start
    scale = displacement / max(float(cumulative_trapezoid(turned.command, time)[-1]), 1e-9)
    peak = float(turned.command.max())

    def modelled(parameters: np.ndarray) -> np.ndarray:
        dead_band, gain, lag, offset = parameters
        command = np.interp(time - lag, time, turned.command)
        speed = gain * np.maximum(command - dead_band, 0.0)
        return offset + cumulative_trapezoid(speed, time, initial=0.0)

    def residual(parameters: np.ndarray) -> np.ndarray:
        return (modelled(parameters) - position)[used] / displacement

    fit = least_squares(
        residual,
        x0=[0.5 * peak, 2.0 * scale, 0.05, 0.0],
        bounds=(
            [0.0, 0.0, 0.0, -displacement],
            [peak, np.inf, constants.LONGEST_LAG_S, displacement],
        ),
        x_scale=[peak, scale, 0.05, displacement],
    )
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    if rms > constants.WORST_RAMP_RESIDUAL:
        raise DataError(
            f"{name}: the displacement does not follow the command, residual {rms:.0%} of it, "
            f"limit {constants.WORST_RAMP_RESIDUAL:.0%}; the joint sticks, is held back by a "
            "limit, or the ramp is too fast"
        )
    opened = float(np.sum(np.diff(time)[turned.command[1:] > fit.x[0]]))
    covariance = rms**2 * np.linalg.pinv(fit.jac.T @ fit.jac)
    fitted = direction * modelled(fit.x) + trace.position[0]
    return DeadBandFit(
        dead_band=float(fit.x[0]),
        gain=float(fit.x[1]),
        lag=float(fit.x[2]),
        dead_band_std=float(np.sqrt(covariance[0, 0])),
        fitted=np.where(used, fitted, np.nan),
        opened=opened,
    )


def average(fits: list[DeadBandFit], rate: float) -> DeadBandResult:
    """Mean and scatter of the repeats at `rate` [1/s]; of one alone, that of its fit."""
    bands, gains = np.array([fit.dead_band for fit in fits]), np.array([fit.gain for fit in fits])
    several = len(fits) > 1
    return DeadBandResult(
        dead_band=float(bands.mean()),
        dead_band_std=float(bands.std(ddof=1)) if several else fits[0].dead_band_std,
        gain=float(gains.mean()),
        gain_std=float(gains.std(ddof=1)) if several else None,
        lag=float(np.mean([fit.lag for fit in fits])),
        repeats=len(fits),
        rate=rate,
    )


@dataclass(frozen=True)
class StepFit:
    """The response to one step of the command beyond the dead band."""

    gain: float  # rad/s, m/s per command beyond the dead band
    dead_time: float  # s
    lag: float  # s
    fitted: np.ndarray  # (n,) rad, m


class StepResponse(NamedTuple):
    """A step of the command, and what was fitted to it."""

    trace: Trace
    fit: StepFit


class FirstGains(ResultPart):
    """Gains of (36) for one joint."""

    kp: float
    """Gain of the position error [1/rad, 1/m]."""
    kd: float
    """Gain of the velocity error [s/rad, s/m]."""
    time_constant: float
    """Time constant of the closed loop [s]."""
    position_tolerance: float
    """Error that is left alone [rad, m]."""


def fit_step(name: str, trace: Trace, beyond: float) -> StepFit:
    """Fit a step that begins with the trace, from rest; `beyond` (signed) is the command beyond
    the dead band.

    `DataError` if the joint did not follow as an integrator with lag does.
    """
    from scipy.optimize import least_squares  # half a second to import

    time = trace.time - trace.time[0]
    position = trace.position - trace.position[0]
    displacement = float(abs(position[-1]))
    if position[-1] * beyond <= 0.0:
        raise DataError(f"{name}: did not move in the direction of the command; check its polarity")
    guess = displacement / (abs(beyond) * time[-1])

    def modelled(parameters: np.ndarray) -> np.ndarray:
        gain, dead_time, lag = parameters
        since = np.maximum(time - dead_time, 0.0)
        return gain * beyond * (since - lag * -np.expm1(-since / lag))

    fit = least_squares(
        lambda parameters: (modelled(parameters) - position) / displacement,
        x0=[1.2 * guess, 0.03, 0.05],
        bounds=(
            [0.0, 0.0, 1e-3],
            [np.inf, constants.LONGEST_RESPONSE_S, constants.LONGEST_RESPONSE_S],
        ),
        x_scale=[guess, 0.05, 0.05],
    )
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    if rms > constants.WORST_STEP_RESIDUAL:
        raise DataError(
            f"{name}: the response is none of an integrator with lag, residual {rms:.0%} of the "
            f"displacement, limit {constants.WORST_STEP_RESIDUAL:.0%}; the joint sticks or is held "
            "back by a limit"
        )
    gain, dead_time, lag = (float(value) for value in fit.x)
    return StepFit(gain, dead_time, lag, trace.position[0] + modelled(fit.x))


def first_gains(
    fits: list[StepFit], fastest: float, smallest_dead_band: float, tolerance: float
) -> FirstGains:
    """Gains of (36) for the worst of the responses, by the SIMC rule.

    Beyond the dead band a joint is an integrator with lag T and dead time L from command to
    position, K exp(-L s) / (s (T s + 1)). For such a process the rule gives kp = 1 / (K (tc + L))
    and a derivative time T, where tc is the wanted time constant of the closed loop; its integral
    part is left out, since (36) has none. tc is at least `CLOSED_LOOP_RATIO` times L + T,
    so that kd K stays below one half, and at least what the user asks: oil and booms swing, of
    which a step response of first order knows nothing. Source: Skogestad, Simple analytic rules for
    model reduction and PID controller tuning, Journal of Process Control 13, 2003, table 1.

    fastest: least time constant of the closed loop [s]
    tolerance: position tolerance of (36) [rad, m]; lowered if kp times it would open the valve
    """
    gain = max(fit.gain for fit in fits)
    dead_time = max(fit.dead_time for fit in fits)
    lag = max(fit.lag for fit in fits)
    time_constant = max(fastest, constants.CLOSED_LOOP_RATIO * (dead_time + lag))
    kp = 1.0 / (gain * (time_constant + dead_time))
    return FirstGains(
        kp=kp,
        kd=kp * lag,
        time_constant=time_constant,
        position_tolerance=min(tolerance, constants.DEAD_BAND_SHARE * smallest_dead_band / kp),
    )
