"""Step responses, and the first gains of (36) by a rule.

Beyond the dead band a joint is an integrator with lag T and dead time L from command to position,

    K exp(-L s) / (s (T s + 1)).

The SIMC rule (Skogestad, Simple analytic rules for model reduction and PID controller tuning,
Journal of Process Control 13, 2003, table 1) for such a process gives kp = 1 / (K (tc + L)) and a
derivative time T, where tc is the wanted time constant of the closed loop; its integral part is
left out, since (36) has none. tc is at least `SLOWER` times L + T, so that kd K stays below one
half, and at least what the user asks: oil and booms swing, of which a step response of first order
knows nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from crane_driver.operator.bringup.samples import Trace
from crane_model.errors import DataError
from crane_model.result_file import ResultPart

SLOWER = 2.0
LONGEST = 0.5  # s, lag and dead time
POOR = 0.1  # of the way
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
    if rms > POOR:
        raise DataError(
            f"{name}: the response is none of an integrator with lag, residual {rms:.0%} of the "
            f"way, limit {POOR:.0%}; the joint sticks or is held back by a limit"
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
