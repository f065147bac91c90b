"""What was in a bus log, in words: frames, cycle times, gaps, what could not be decoded."""

from typing import NamedTuple

import numpy as np

from crane_driver.can.bus_log import BusLog, Clock
from crane_driver.can.dbc import by_group_alone
from crane_driver.can.log_table import LogTable, Sender

MANY_CYCLES = 3  # a gap is longer than so many median cycles
LONGEST_LIST = 10  # unknown identifiers that are named


class Cycle(NamedTuple):
    """Timing of the frames of one identifier over the log."""

    id: str
    message: str
    frames: int
    declared: float | None  # s, the DBC's cycle time
    median: float  # s, NaN for a single frame
    longest_gap: float  # s without a frame, the ends of the log included
    longest_gap_at: float  # s after the first frame of the log, where it begins
    gaps: int


def cycles(table: LogTable) -> list[Cycle]:
    """Timing of every decoded identifier, by message."""
    found = [_cycle(sender, table.first, table.last) for sender in table.senders.values()]
    return sorted(found, key=lambda one: (one.message, one.id))


def _cycle(sender: Sender, first: int, last: int) -> Cycle:
    stamps = np.array(sender.stamps, dtype=np.int64)
    ends = np.concatenate(([first], stamps, [last]))
    silences = np.diff(ends) / 1e9
    median = float(np.median(silences[1:-1])) if len(stamps) > 1 else np.nan
    longest = int(np.argmax(silences))
    declared = sender.message.cycle_time
    return Cycle(
        sender.id,
        sender.message.name,
        len(stamps),
        declared / 1000 if declared else None,
        median,
        float(silences[longest]),
        float(ends[longest] - first) / 1e9,
        int(np.count_nonzero(silences > MANY_CYCLES * median)),
    )


def describe(log: BusLog, table: LogTable) -> str:
    """The report on a log that was read to its end."""
    duration = (table.last - table.first) / 1e9
    unknown, failed = table.unknown.total(), table.failed.total()
    lines = [
        f"{table.frames} frames read over {duration:.3f} s: {table.decoded} decoded, {unknown} of "
        f"{len(table.unknown)} unknown ids, {failed} not decodable",
        *(f"beside them {text}" for text in beside(log)),
        *_about_stamps(log),
        "",
        f"{'message':24} {'id':>8} {'frames':>7} {'cycle [ms]':>11} {'in DBC':>7} "
        f"{'gaps':>5} {'longest gap':>13}",
    ]
    for one in cycles(table):
        declared = f"{one.declared * 1e3:g}" if one.declared else "-"
        lines.append(
            f"{one.message:24} {one.id:>8} {one.frames:7} {one.median * 1e3:11.2f} {declared:>7} "
            f"{one.gaps:5} {one.longest_gap * 1e3:7.1f} ms at {one.longest_gap_at:.3f} s"
        )
    lines += ["", f"a gap is longer than {MANY_CYCLES} median cycles"]
    for (identifier, message, reason), count in table.failed.most_common():
        lines.append(f"not decodable: {count} frames of {message} ({identifier}): {reason}")
    if table.codes:
        counts = [f"{name}: {count} x {code}" for (name, code), count in table.codes.items()]
        lines.append(
            "not measurements, but codes of J1939 for which the DBC states no range: "
            f"{', '.join(counts)}"
        )
    if guessed := [
        f"{one.id} as {one.message.name}"
        for one in table.senders.values()
        if by_group_alone(one.message, one.id)
    ]:
        lines.append(
            f"by group number (PGN) alone, as in J1939, which the DBC does not say: "
            f"{', '.join(guessed)}"
        )
    if unknown:
        named = [f"{name}: {count}" for name, count in table.unknown.most_common(LONGEST_LIST)]
        more = len(table.unknown) - len(named)
        lines.append(f"unknown ids: {', '.join(named)}" + (f", and {more} more" if more else ""))
    return "\n".join(lines)


def beside(log: BusLog) -> list[str]:
    """Counts of everything in a log that was not read as a data frame."""
    counts = {
        "damaged lines, skipped": log.damaged,
        "error frames": log.errors,
        "remote frames": log.remote,
        "frames of other channels": log.others,
        **log.events,
    }
    return [f"{count} {what}" for what, count in counts.items() if count]


def _about_stamps(log: BusLog) -> list[str]:
    lines = []
    if log.clock is Clock.START:
        lines.append("the log states no date: its stamps count seconds from its beginning")
    elif log.stamps is Clock.LOCAL:
        lines.append(
            "the log holds local time and does not state its zone: its stamps are kept as they "
            "are; for UTC name the zone, for example --zone Europe/Berlin"
        )
    elif log.clock is Clock.LOCAL:
        lines.append(f"the log holds local time, of the zone {log.zone}")
    if log.lost_steps:
        lines.append(
            f"stamps are relative, and {log.lost_steps} damaged lines hold none: all behind such a "
            "line is too early by what it held"
        )
    if log.set_back:
        lines.append(log.back_in_words)
    if log.broken:
        lines.append(f"the log is damaged behind them, and was read no further: {log.broken}")
    return lines
