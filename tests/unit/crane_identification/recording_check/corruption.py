"""What people do to recordings without noticing: each function spoils a good log."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crane_identification import Log, Signal

PRESSURES = ("pressure_a", "pressure_b")
CHAMBERS = (*PRESSURES, "supply_pressure", "tank_pressure")


def each(log: Log, names: tuple[str, ...], by: Callable[[np.ndarray], np.ndarray]) -> Log:
    """`by` applied to the values of some signals."""
    signals = {name: getattr(log, name) for name in names}
    return replace(log, **{n: replace(s, value=by(s.value)) for n, s in signals.items() if s})


def column(j: int, by: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """`by` applied to column j alone."""

    def changed(values: np.ndarray) -> np.ndarray:
        out = values.copy()
        out[:, j] = by(values[:, j])
        return out

    return changed


def exchanged(i: int, k: int) -> Callable[[np.ndarray], np.ndarray]:
    """Two columns exchanged."""

    def changed(values: np.ndarray) -> np.ndarray:
        out = values.copy()
        out[:, [i, k]] = values[:, [k, i]]
        return out

    return changed


def chambers(log: Log, j: int) -> Log:
    """Chambers A and B of joint j exchanged."""
    a, b = log.pressure_a, log.pressure_b
    assert a is not None and b is not None
    first, second = a.value.copy(), b.value.copy()
    first[:, j], second[:, j] = b.value[:, j], a.value[:, j]
    return replace(log, pressure_a=replace(a, value=first), pressure_b=replace(b, value=second))


def timed(log: Log, names: tuple[str, ...], by: Callable[[np.ndarray], np.ndarray]) -> Log:
    """The stamps of some signals changed."""
    signals = {name: getattr(log, name) for name in names}
    return replace(log, **{n: replace(s, time=by(s.time)) for n, s in signals.items() if s})


def unreceived(log: Log) -> Log:
    """Without the times of the recorder, as a table."""
    logged = {name: getattr(log, name) for name in ("position", *CHAMBERS, "command")}
    return replace(log, **{n: replace(s, received=None) for n, s in logged.items() if s})


def thinned(log: Log, names: tuple[str, ...], every: int) -> Log:
    """Only every so many-th sample of some signals."""

    def fewer(signal: Signal) -> Signal:
        received = None if signal.received is None else signal.received[::every]
        return replace(
            signal, time=signal.time[::every], value=signal.value[::every], received=received
        )

    signals = {name: getattr(log, name) for name in names}
    return replace(log, **{n: fewer(s) for n, s in signals.items() if s})


def held(every: int) -> Callable[[np.ndarray], np.ndarray]:
    """Each of every so many-th sample sent again and again."""
    return lambda values: values[np.arange(len(values)) // every * every]


def stuck(values: np.ndarray) -> np.ndarray:
    """The last two thirds at one reading."""
    third = len(values) // 3
    return np.where(np.arange(len(values)) < third, values, values[third])


def clipped(values: np.ndarray) -> np.ndarray:
    """A tenth of the readings at the end of the range."""
    return np.minimum(values, np.percentile(values, 90))
