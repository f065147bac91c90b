"""What bring-up measures of a valve: polarity, dead band, response and first gains."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares

from crane_driver.operator.bringup.samples import Trace
from crane_model.errors import DataError
from crane_model.result_file import ResultPart

# Polarity of a valve: which way a joint moves at the smallest opening that moves it.


class Nudge(ResultPart):
    """The first movement of a joint under a command that rose slowly from 0."""

    command: float
    """At which the movement was seen, -1 to 1 [-]."""
    moved: float
    """Way until it was seen [rad, m]."""
    way: float
    """Way until the joint stood again [rad, m]."""


class PolarityResult(ResultPart):
    """Of a valve."""

    polarity: Literal[-1, 1]
    """What the sign of its command has to be multiplied by [-]."""
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


# The dead band of a valve in one direction, from a slow triangle of the command.
#
# Beyond the dead band u0 the speed is K (u(t - τ) - u0). While the command rises, the lag τ makes
# the valve seem to open late, by the rate of the ramp times τ; while it falls, to close late. A
# triangle has both, so u0, K and τ are determined together; u0 is the command extrapolated to zero
# speed. The first part of the way is left out: there the oil is compressed until friction gives
# way. A heavy joint on soft oil answers by no lag alone: unless the valve opens and closes much
# more slowly than it answers, u0 and K are those of the ramp and not of the valve.

LEFT_OUT = 0.25  # of the way, at its beginning
LONGEST_LAG = 0.5  # s
POOR = 0.1  # of the way: residual of a fit that means nothing
PROMPT = 0.02  # of the time for which the valve is open: a longer lag bends u0 and K
SAME = 0.05  # of u0 and of K, between two rates of which neither bends them


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
        """Whether the ramp was too fast for this joint."""
        return self.lag > PROMPT * self.opened

    def agrees(self, other: "DeadBandFit") -> bool:
        """Whether both tell the same valve."""
        pairs = (self.dead_band, other.dead_band), (self.gain, other.gain)
        return all(abs(one - two) <= SAME * max(one, two) for one, two in pairs)


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
    """Of the ramps; slower than asked where the joint answers late [1/s]."""


def fit_dead_band(name: str, trace: Trace, direction: int) -> DeadBandFit:
    """Fit a triangle of the command in `direction` (1, -1), from rest to rest.

    `DataError` if the joint did not move in that direction, or not as a valve moves it.
    """
    one = trace.turned(direction)
    time = one.time - one.time[0]
    position = one.position - one.position[0]
    way = float(position.max())
    if way <= -float(position.min()):
        raise DataError(f"{name}: no movement in the direction of the command; check its polarity")
    start = int(np.argmax(position > LEFT_OUT * way))
    used = np.arange(len(position)) >= start
    scale = way / max(float(cumulative_trapezoid(one.command, time)[-1]), 1e-9)
    peak = float(one.command.max())

    def modelled(parameters: np.ndarray) -> np.ndarray:
        dead_band, gain, lag, offset = parameters
        command = np.interp(time - lag, time, one.command)
        speed = gain * np.maximum(command - dead_band, 0.0)
        return offset + cumulative_trapezoid(speed, time, initial=0.0)

    def residual(parameters: np.ndarray) -> np.ndarray:
        return (modelled(parameters) - position)[used] / way

    fit = least_squares(
        residual,
        x0=[0.5 * peak, 2.0 * scale, 0.05, 0.0],
        bounds=([0.0, 0.0, 0.0, -way], [peak, np.inf, LONGEST_LAG, way]),
        x_scale=[peak, scale, 0.05, way],
    )
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    if rms > POOR:
        raise DataError(
            f"{name}: the way does not follow the command, residual {rms:.0%} of it, limit "
            f"{POOR:.0%}; the joint sticks, is held back by a limit, or the ramp is too fast"
        )
    opened = float(np.sum(np.diff(time)[one.command[1:] > fit.x[0]]))
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
    """Mean of the repeats, run at `rate` [1/s]; their scatter, or with one alone the standard
    deviation of its fit.
    """
    bands, gains = np.array([one.dead_band for one in fits]), np.array([one.gain for one in fits])
    several = len(fits) > 1
    return DeadBandResult(
        dead_band=float(bands.mean()),
        dead_band_std=float(bands.std(ddof=1)) if several else fits[0].dead_band_std,
        gain=float(gains.mean()),
        gain_std=float(gains.std(ddof=1)) if several else None,
        lag=float(np.mean([one.lag for one in fits])),
        repeats=len(fits),
        rate=rate,
    )


# Step responses, and the first gains of (36) by a rule.
#
# Beyond the dead band a joint is an integrator with lag T and dead time L from command to position,
#
#     K exp(-L s) / (s (T s + 1)).
#
# The SIMC rule (Skogestad, Simple analytic rules for model reduction and PID controller tuning,
# Journal of Process Control 13, 2003, table 1) for such a process gives kp = 1 / (K (tc + L)) and a
# derivative time T, where tc is the wanted time constant of the closed loop; its integral part is
# left out, since (36) has none. tc is at least `SLOWER` times L + T, so that kd K stays below one
# half, and at least what the user asks: oil and booms swing, of which a step response of first
# order knows nothing.

SLOWER = 2.0
LONGEST = 0.5  # s, lag and dead time
POOR_RESPONSE = 0.1  # of the way
CLOSED = 0.5  # of the dead band, that kp times the position tolerance may reach


@dataclass(frozen=True)
class StepFit:
    """The response to one step of the command beyond the dead band."""

    gain: float  # rad/s, m/s per command beyond the dead band
    dead_time: float  # s
    lag: float  # s
    fitted: np.ndarray  # (n,) rad, m


class FirstGains(ResultPart):
    """Gains of (36) for one joint."""

    kp: float
    """Of the position error [1/rad, 1/m]."""
    kd: float
    """Of the velocity error [s/rad, s/m]."""
    time_constant: float
    """Of the closed loop [s]."""
    position_tolerance: float
    """Error that is left alone [rad, m]."""


def fit_step(name: str, trace: Trace, beyond: float) -> StepFit:
    """Fit a step that begins with the trace, from rest; `beyond` (signed) is the command beyond
    the dead band.

    `DataError` if the joint did not follow as an integrator with lag does.
    """
    time = trace.time - trace.time[0]
    position = trace.position - trace.position[0]
    way = float(abs(position[-1]))
    if position[-1] * beyond <= 0.0:
        raise DataError(f"{name}: did not move in the direction of the command; check its polarity")
    guess = way / (abs(beyond) * time[-1])

    def modelled(parameters: np.ndarray) -> np.ndarray:
        gain, dead_time, lag = parameters
        since = np.maximum(time - dead_time, 0.0)
        return gain * beyond * (since - lag * -np.expm1(-since / lag))

    fit = least_squares(
        lambda parameters: (modelled(parameters) - position) / way,
        x0=[1.2 * guess, 0.03, 0.05],
        bounds=([0.0, 0.0, 1e-3], [np.inf, LONGEST, LONGEST]),
        x_scale=[guess, 0.05, 0.05],
    )
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    if rms > POOR_RESPONSE:
        raise DataError(
            f"{name}: the response is none of an integrator with lag, residual {rms:.0%} of the "
            f"way, limit {POOR_RESPONSE:.0%}; the joint sticks or is held back by a limit"
        )
    gain, dead_time, lag = (float(value) for value in fit.x)
    return StepFit(gain, dead_time, lag, trace.position[0] + modelled(fit.x))


def first_gains(
    fits: list[StepFit], fastest: float, smallest_dead_band: float, tolerance: float
) -> FirstGains:
    """Gains by the rule above for the worst of the responses.

    fastest: least time constant of the closed loop [s]
    tolerance: position tolerance of (36) [rad, m]; lowered where kp times it would open the valve
    """
    gain = max(one.gain for one in fits)
    dead_time = max(one.dead_time for one in fits)
    lag = max(one.lag for one in fits)
    time_constant = max(fastest, SLOWER * (dead_time + lag))
    kp = 1.0 / (gain * (time_constant + dead_time))
    return FirstGains(
        kp=kp,
        kd=kp * lag,
        time_constant=time_constant,
        position_tolerance=min(tolerance, CLOSED * smallest_dead_band / kp),
    )
