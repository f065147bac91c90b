"""Every signal of a bus log as one long table, and what the DBC could not decode."""

import math
from array import array
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from cantools.database import DecodeError
from cantools.database.can import Message

from crane_driver.can.bus_log import Clock
from crane_driver.can.codec import SignalBits
from crane_driver.can.dbc import Dbc, codes_of
from crane_driver.can.frame import Frame, show_id
from crane_driver.can.layout import MEASUREMENTS, Code
from crane_model.errors import DataError

if TYPE_CHECKING:
    import polars as pl


class Sender:
    """The frames of one identifier, which decode as one message."""

    def __init__(self, id: str, message: Message, codes: bool):
        self.id, self.message = id, message
        self.bits = SignalBits(message)
        self.signals = {signal.name: signal for signal in message.signals}
        self.codes = {
            name: codes_of(message, signal) if codes else MEASUREMENTS
            for name, signal in self.signals.items()
        }
        self.stamps = array("q")  # ns


class LogTable:
    """Collects the values of frames.

    Nothing is lost silently: `frames` is `decoded` plus all of `unknown` plus all of `failed`, and
    `codes` counts the values that are codes and not measurements, unless they are kept.
    """

    def __init__(self, dbc: Dbc, keep_codes: bool = False):
        self._dbc, self._keep_codes = dbc, keep_codes
        self.frames = 0
        self.first = self.last = 0  # ns, stamps
        self.duration = 0  # ns, without what a clock was set back by
        self.unknown: Counter[str] = Counter()  # frames by identifier
        self.failed: Counter[tuple[str, str, str]] = Counter()  # by identifier, message, reason
        self.codes: Counter[tuple[str, Code]] = Counter()  # values by MESSAGE.SIGNAL and kind
        self.senders: dict[str, Sender] = {}
        self._signals: dict[tuple[str, str], int] = {}  # message and signal: number
        # one entry a value: stamp [ns], number of sender and signal, value
        self._stamps, self._of_sender, self._of_signal = array("q"), array("L"), array("L")
        self._values = array("d")
        self._numbers: dict[str, int] = {}  # of the senders

    @property
    def decoded(self) -> int:
        return sum(len(sender.stamps) for sender in self.senders.values())

    def add(self, frame: Frame) -> None:
        if not self.frames:
            self.first = self.last = frame.stamp
        self.duration += max(frame.stamp - self.last, 0)
        self.last = frame.stamp
        self.frames += 1
        shown = show_id(frame.id, frame.extended)
        message = self._dbc.find(frame.id, frame.extended)
        if message is None:
            self.unknown[shown] += 1
            return
        if len(frame.data) != message.length:
            reason = f"{len(frame.data)} bytes, the DBC says {message.length}"
            self.failed[shown, message.name, reason] += 1
            return
        sender = self.senders.get(shown) or Sender(shown, message, not self._keep_codes)
        try:
            values = sender.bits.unpack(frame.data)
        except DecodeError as error:  # a multiplexer value that the DBC does not have
            self.failed[shown, message.name, str(error)] += 1
            return
        self.senders[shown] = sender
        self._numbers.setdefault(shown, len(self._numbers))
        sender.stamps.append(frame.stamp)
        for name, signal in sender.signals.items():
            if (raw := values.get(name)) is None:  # multiplexed, and not in this frame
                continue
            value = signal.raw_to_scaled(raw, decode_choices=False)
            if code := sender.codes[name].of(raw):
                self.codes[f"{message.name}.{name}", code] += 1
                value = math.nan
            self._stamps.append(frame.stamp)
            self._of_sender.append(self._numbers[shown])
            self._of_signal.append(
                self._signals.setdefault((message.name, name), len(self._signals))
            )
            self._values.append(float(value))  # type: ignore[arg-type]  # names are not decoded

    def write(self, path: Path, stamps: Clock) -> None:
        """Write the table to a .csv or .parquet file; `DataError` if that fails."""
        table = self.table(stamps)
        try:
            if path.suffix == ".csv":
                table.write_csv(path)
            else:
                table.write_parquet(path)
        except OSError as error:
            raise DataError(f"{path}: cannot be written: {error.strerror or error}") from None

    def table(self, stamps: Clock = Clock.EPOCH) -> "pl.DataFrame":
        """One row a value: stamp, id, message, signal, value, unit, in_range.

        The stamp is of UTC, without a zone if it is local time. If the log states no date, `time`
        [s] from its beginning takes its place.

        `in_range`: whether the value is within the limits of the DBC. A value that is a code, and
        not a measurement, is empty and not in range.
        """
        import polars as pl  # large, and bags need none

        signals = [self._signal(*key) for key in self._signals]
        senders = pl.DataFrame({"id": list(self.senders)}, schema={"id": pl.String})
        described = pl.DataFrame(
            signals,
            schema={
                "message": pl.String,
                "signal": pl.String,
                "unit": pl.String,
                "low": pl.Float64,
                "high": pl.Float64,
            },
            orient="row",
        )
        value = pl.Series("value", np.array(self._values))
        stamp = pl.Series("stamp", np.array(self._stamps, dtype=np.int64))
        rows = described[np.array(self._of_signal, dtype=np.uint32)]
        return rows.select(
            (stamp / 1e9).alias("time")
            if stamps is Clock.START
            else stamp.cast(pl.Datetime("ns", "UTC" if stamps is Clock.EPOCH else None)),
            senders["id"].gather(np.array(self._of_sender, dtype=np.uint32)),
            "message",
            "signal",
            value.fill_nan(None),
            "unit",
            in_range=(pl.col("low") <= value) & (value <= pl.col("high")) & value.is_finite(),
        )

    def _signal(self, message: str, name: str) -> tuple[str, str, str, float, float]:
        signal = self._dbc.messages[message].get_signal_by_name(name)
        low = -np.inf if signal.minimum is None else float(signal.minimum)
        high = np.inf if signal.maximum is None else float(signal.maximum)
        return message, name, signal.unit or "", low, high
