"""Where flow moves the cylinders in a window, and how sure that is."""

from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.hydraulics.stepping import chamber_volumes
from crane_observer.position.assumed import NULL_DOUBT
from crane_observer.position.flow import (
    DROP_A,
    DROP_B,
    FLOW_A,
    FLOW_B,
    LOST_A,
    LOST_B,
    NULL_A,
    NULL_B,
    OPEN,
)
from crane_observer.position.known import SMALLEST, Known
from crane_observer.position.state import EXTENDING, NULL, OFFSET_A, OFFSET_B, RETRACTING, UNEVEN
from crane_observer.position.window import FlowWindow

WHITE = 0.1  # of the variance by transducers that are off, how much is new in each window
CLEAR = 2.0  # times its doubt, a stroke or velocity that is one: a joint may stall
STEEPEST = 2.0  # times, by which a lever arm changes in a window


class Stroke(NamedTuple):
    """Of j cylinders, both chambers together."""

    stroke: Array  # (j,) m, by the flow that the model has
    by_null: Array  # (j,) m for a null of 1
    by_offset_a: Array  # (j,) m for transducers of chambers A off by as much as they are trusted
    by_offset_b: Array  # (j,) m, the same for B
    doubt: Array  # (j,) m, by these, and by nulls that nobody identified
    jitter: Array  # (j,) m for noise of 1 Pa of each pressure
    extends: Flags  # (j,)


class Moved(NamedTuple):
    """Where the joints come to."""

    way: Array  # (j,) rad, m
    slopes: Array  # (j, size) of the new coordinates against the states before
    noise: Array  # (j,) variance
    jitter: Array  # (j,) rad, m: by noise of the readings of pressure
    doubt: Array  # (j,) rad, m: by transducers that are off, also for long


def stroke_of(known: Known, length: Array, lever: Array, window: FlowWindow) -> Stroke:
    """Each chamber counts by what a transducer's error does to it."""
    circuit, trust, sums = known.circuit, known.trust, window.sums
    volume_a, volume_b = chamber_volumes(circuit, length)
    rise_a, rise_b = window.after - window.before
    swept_a = sums[:, FLOW_A] - volume_a / circuit.bulk_modulus * rise_a
    swept_b = -sums[:, FLOW_B] + volume_b / circuit.bulk_modulus * rise_b
    fastest = known.fastest * np.abs(lever)
    # of a flow Q over a drop D, an offset of 1 Pa makes Q / (2 D); gains were identified with the
    # same offset, at half the supply pressure on the mean, and make up for it there
    supply = circuit.supply_pressure
    off_a = (sums[:, DROP_A] - np.abs(sums[:, FLOW_A]) / supply) * trust.transducer / circuit.area_a
    off_b = (sums[:, DROP_B] - np.abs(sums[:, FLOW_B]) / supply) * trust.transducer / circuit.area_b
    kept_a = UNEVEN * trust.transducer * sums[:, DROP_A] / circuit.area_a
    kept_b = UNEVEN * trust.transducer * sums[:, DROP_B] / circuit.area_b
    doubt_a = np.hypot(off_a, kept_a) + SMALLEST
    doubt_b = np.hypot(off_b, kept_b) + SMALLEST
    lost_a, lost_b = sums[:, LOST_A] * fastest, sums[:, LOST_B] * fastest
    doubt_a, doubt_b = doubt_a + lost_a, doubt_b + lost_b
    weight_a = doubt_b**2 / (doubt_a**2 + doubt_b**2)
    part_a, part_b = weight_a / circuit.area_a, (1.0 - weight_a) / circuit.area_b
    by_null = part_a * sums[:, NULL_A] - part_b * sums[:, NULL_B]
    doubt = 1.0 / np.sqrt(1.0 / doubt_a**2 + 1.0 / doubt_b**2)
    return Stroke(
        part_a * swept_a + part_b * swept_b,
        by_null,
        weight_a * (off_a + lost_a),
        (weight_a - 1.0) * (off_b + lost_b),
        np.where(known.assumed, np.hypot(doubt, NULL_DOUBT * by_null), doubt),
        (part_a * volume_a + part_b * volume_b) / circuit.bulk_modulus,
        sums[:, OPEN] > 0.0,
    )


def moved(known: Known, x: Array, q: Array, window: FlowWindow) -> Moved:
    """From coordinates q (j,), with errors of gains and nulls as the states x (size,) have them."""
    layout, trust, cylinders = known.layout, known.trust, known.mechanics.cylinders
    length, lever, bend = cylinders(q[np.newaxis])[0].T
    made = stroke_of(known, length, lever, window)
    gains = np.where(made.extends, x[layout.of(EXTENDING)], x[layout.of(RETRACTING)])
    whole = made.stroke * (1.0 + gains) + made.by_null * x[layout.of(NULL)]
    way = whole / lever
    for _ in range(2):  # steps of Newton's method
        after = cylinders((q + way)[np.newaxis])[0].T
        if not np.isfinite(after).all():
            after = np.stack([length + lever * way, lever, bend])
        way = way - (after[0] - length - whole) / after[1]
    slopes, rows = np.zeros((layout.joints, layout.size)), np.arange(layout.joints)
    slopes[rows, rows] = np.clip(lever / after[1], 1.0 / STEEPEST, STEEPEST)
    gain = np.where(made.extends, layout.of(EXTENDING).start, layout.of(RETRACTING).start) + rows
    slopes[rows, gain] = made.stroke / after[1]
    slopes[rows, layout.of(NULL).start + rows] = made.by_null / after[1]
    slopes[rows, layout.of(OFFSET_A).start + rows] = made.by_offset_a / after[1]
    slopes[rows, layout.of(OFFSET_B).start + rows] = made.by_offset_b / after[1]
    noise = ((known.stroke * made.stroke) ** 2 + WHITE * made.doubt**2) / after[1] ** 2
    noise = noise + (known.standing * window.duration) ** 2 * 1e-4
    noise = noise + (known.fastest * window.blind) ** 2
    jitter, doubt = trust.reading * made.jitter, made.doubt
    return Moved(way, slopes, noise, jitter / np.abs(after[1]), doubt / np.abs(after[1]))
