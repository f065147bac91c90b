"""Whether the encoders contradict the motion that the flow into the cylinders makes.

An encoder that sticks shows a joint at rest that the flow moves. The difference between the piston
displacement by encoder and by flow is summed over the windows. From the sum, each window takes away
what the flow model may be wrong by, at most the motion itself: the sum stays at zero as long as
both agree, and keeps its value at rest (the cumulative sum of Page, Biometrika 41 (1954)). The sum
returns to zero if the encoder comes back.
"""

import numpy as np

from crane_model.array import Array, Flags
from crane_model.model_file import Model
from crane_observer.position.balance import Known, stroke_of
from crane_observer.position.flow import FLOW_SUMS, SPOOL, Commands, add_interval, spools_of
from crane_observer.position.state import FlowWindow

FLOW_TOLERANCE = 0.1  # of the displacement, by which flow and encoder may differ
UNEXPLAINED_TIMES = 3.0  # times the unexplained share of the flow, beside that
LATE_FLOW = 0.01  # s, by which a valve may act sooner or later than the model has it
LEAST_DOUBT = 0.3  # s at the speed below which a joint stands: what is less says nothing


class FlowCheck:
    """Compares the encoders of j joints with the flow of their valves, window by window."""

    def __init__(self, model: Model):
        """`ConfigurationError` names what the model lacks."""
        assert model.hydraulics is not None
        joints = len(model.joints)
        self._known = Known.of(model, np.zeros(joints))
        self._spools = spools_of(self._known.mechanics.model)
        self._commands, self._spool = Commands.none(joints), np.zeros(joints, SPOOL)
        known = self._known.mechanics.model.hydraulics
        assert known is not None
        unexplained = np.array([known.joints[joint].unexplained for joint in model.joints])
        self._share = FLOW_TOLERANCE + UNEXPLAINED_TIMES * unexplained
        self._share[self._known.assumed] = np.inf
        self._supply = self._known.circuit.supply_pressure
        self._largest = self._known.mechanics.machine.hydraulics.transducer_range
        self._off = np.zeros(joints)  # m of the piston
        self._speed = np.zeros(joints)  # m/s of the piston, by flow

    def add_command(self, time: float, command: Array) -> None:
        """Take valve commands (j,) [-1..1], in force from `time` [s] on."""
        if np.isfinite(command).all():
            self._commands.add(time, np.clip(command, -1.0, 1.0))

    def add_supply(self, pressure: float) -> None:
        """Take the supply pressure [Pa]; NaN if it was not measured."""
        self._supply = pressure if np.isfinite(pressure) else self._supply

    def add_window(self, time: Array, pressures: Array, before: Array, after: Array) -> Flags:
        """Take pressures (n, 2 j) [Pa] at `time` (n,) [s], and the encoders (j,) at its first and
        last. Return whether each encoder contradicts the flow (j,).
        """
        if not self._commands.came[0]:
            return np.zeros(len(self._off), dtype=bool)
        known, chambers = self._known, pressures.reshape(len(time), 2, -1)
        sums = np.zeros(len(self._off), FLOW_SUMS)
        for k in range(len(time) - 1):
            add_interval(
                known.circuit, self._spools, self._commands, self._spool, time[0], time[k],
                time[k + 1], chambers[k], chambers[k + 1], self._supply, self._largest, sums,
            )  # fmt: skip
        duration = float(time[-1] - time[0])
        window = FlowWindow(
            time[-1], duration, sums, chambers[0], chambers[-1], after, np.zeros(len(sums)), True
        )
        first, last = known.mechanics.cylinders(np.stack([before, after]))
        length, lever = first[:, 0], first[:, 1]
        made = stroke_of(known, length, lever, window)
        shown = last[:, 0] - length
        slower = np.abs(self._speed - made.stroke / duration) * LATE_FLOW
        self._speed = made.stroke / duration
        displaced = np.maximum(np.abs(shown), np.abs(made.stroke))
        allowed = self._share * displaced + slower
        allowed += made.doubt + np.abs(known.null * made.by_null)
        allowed += known.standing * np.abs(lever) * duration
        allowed = np.minimum(allowed, displaced)
        off = self._off + made.stroke - shown
        off = np.sign(off) * np.maximum(np.abs(off) - allowed, 0.0)
        self._off = np.where(np.isfinite(off), off, 0.0)
        return np.abs(self._off) > LEAST_DOUBT * np.abs(lever) * known.standing
