"""crane_driver decode: a bus log to a table of every signal, or to a bag of the crane's topics."""

import argparse
from collections.abc import Sequence
from pathlib import Path

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
        help="log of candump -l, or one that python-can reads: BLF, ASC, TRC, CSV, SQLite, and "
        "MF4 with its extra mf4; what it is, is told by its content",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="TABLE.csv or TABLE.parquet: one row a value; any other name: folder of a bag "
        "(mcap), which needs --mapping",
    )
    parser.add_argument(
        "--mapping",
        type=Path,
        help="mapping YAML: which signals are joints, pressures, commands (default: can.yaml of "
        "the machine, unless --dbc alone is named)",
    )
    add_machine(parser)
    add_replace(parser)
    parser.add_argument("--channel", help="interface to read, where the log has several")
    options = parser.parse_args(argv)
    return run(lambda: _decode(options))


def _decode(options: argparse.Namespace) -> None:
    try:
        from crane_driver.can.log_decoding import TABLES, decode
    except ImportError as error:
        raise CraneError(
            f"{error}; install what reads CAN: pip install 'crane_driver[can]'"
        ) from None
    if options.out.suffix in TABLES:
        check_out(options.out, replace=options.replace)
    name, mapping = options.machine, options.mapping
    if mapping or name or not options.dbc:
        mapping = machine_file("can.yaml", name, mapping)
    dbc = machine_file("can.dbc", name, options.dbc)
    print(decode(options.log, load_machine(name), dbc, mapping, options.channel, options.out))
