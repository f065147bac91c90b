"""crane_driver decode: a bus log to a table of every signal, or to a bag of the crane's topics."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from crane_model.cli import run
from crane_model.errors import CraneError


def main(argv: Sequence[str] | None = None) -> int:
    """Command line of `ros2 run crane_driver decode`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dbc", type=Path, required=True, help="DBC file")
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
        "--mapping", type=Path, help="mapping YAML: which signals are joints, pressures, commands"
    )
    parser.add_argument("--channel", help="interface to read, where the log has several")
    options = parser.parse_args(argv)
    return run(lambda: _decode(options))


def _decode(options: argparse.Namespace) -> None:
    try:
        from crane_driver.can.log_decoding import decode
    except ImportError as error:
        raise CraneError(
            f"{error}; install what reads CAN: pip install 'crane_driver[can]'"
        ) from None
    print(decode(options.log, options.dbc, options.mapping, options.channel, options.out))
