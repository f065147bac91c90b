"""Convert a bus log to a table of every signal, or to a bag of the crane's topics."""

import argparse
from collections.abc import Sequence
from datetime import datetime, tzinfo
from pathlib import Path
from zoneinfo import ZoneInfo

from crane_model.cli import add_machine, add_replace, check_out, command_line, run
from crane_model.errors import CraneError
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file


def main(argv: Sequence[str] | None = None) -> int:
    """Command line of `ros2 run crane_driver decode`."""
    parser = command_line(description=__doc__)
    parser.add_argument("--dbc", type=Path, help="DBC file (default: can.dbc of the machine)")
    parser.add_argument(
        "--log",
        type=Path,
        required=True,
        help="log to read: candump, ASC, BLF, TRC, CSV, SQLite or MF4 (needs "
        "asammdf), detected from its content",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="table to write (.csv, .parquet; one row per value), or folder of a new "
        "bag (any other name; needs a mapping)",
    )
    parser.add_argument(
        "--mapping",
        type=Path,
        help="mapping of signals to joints, pressures and commands (YAML; default: "
        "can.yaml of the machine, unless only --dbc is given)",
    )
    add_machine(parser)
    add_replace(parser)
    parser.add_argument("--channel", help="channel to read, if the log has several")
    parser.add_argument(
        "--zone",
        type=_zone,
        help="time zone of an ASC, BLF, TRC or candump -tA log, which hold local time: "
        "Europe/Berlin, or +02:00 (default: UTC)",
    )
    parser.add_argument(
        "--keep-codes",
        action="store_true",
        help="keep J1939 codes such as FFFF (not available) as numbers",
    )
    options = parser.parse_args(argv)
    return run(lambda: _decode(**vars(options)))


def _zone(text: str) -> tzinfo:
    """Time zone by name or by its distance from UTC."""
    try:
        zone = datetime.strptime(text, "%z").tzinfo if text[:1] in "+-" else ZoneInfo(text)
    except (OSError, ValueError, KeyError):
        zone = None
    if zone is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time zone; Europe/Berlin is one")
    return zone


def _decode(
    log: Path,
    dbc: Path | None,
    out: Path,
    mapping: Path | None,
    machine: str | None,
    replace: bool,
    channel: str | None,
    zone: tzinfo | None,
    keep_codes: bool,
) -> None:
    try:
        from crane_driver.can.log_decoding import TABLE_SUFFIXES, DecodeRequest, decode
    except ModuleNotFoundError as error:
        raise CraneError(
            f"{error}; install what reads CAN: make setup in a clone, or without ROS "
            "pip install './crane_driver[can]'"
        ) from None
    if out.suffix in TABLE_SUFFIXES:
        check_out(out, replace=replace)
    if mapping or machine or not dbc:
        mapping = machine_file("can.yaml", machine, mapping)
    dbc = machine_file("can.dbc", machine, dbc)
    request = DecodeRequest(
        log, dbc, out, load_machine(machine), mapping, channel, zone, keep_codes
    )
    print(decode(request))
