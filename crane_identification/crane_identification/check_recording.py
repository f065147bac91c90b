"""`check_recording`: look for wrong units, wiring, names and clocks before any fit."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from crane_identification.data.arguments import Sources, add_part
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.table_files import TABLES
from crane_identification.options import Options
from crane_identification.progress_bar import ProgressBar
from crane_identification.recording_check.check import check
from crane_identification.recording_check.forces import crane
from crane_identification.recording_check.suspicion import Checked
from crane_model import cli
from crane_model.configuration import load
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.terms import load_terms


def run(arguments: argparse.Namespace) -> None:
    """Everything the command does; raises `CraneError` with what is wrong."""
    if arguments.terms:
        load_terms(arguments.terms)
    model = load_model(arguments.model) if arguments.model else _usual(arguments.machine)
    columns = load(arguments.columns, ColumnMap) if arguments.columns else None
    if columns and not (
        arguments.model or arguments.machine or {*model.joints} & {*columns.joints}
    ):
        raise ConfigurationError(
            f"{arguments.columns}: the joints {', '.join(columns.joints)} are not those of the "
            "laboratory crane, which is the default; give your machine by --model or --machine"
        )
    with ProgressBar() as progress:
        options = Options(
            begin=arguments.begin,
            end=arguments.end,
            namespace=arguments.namespace,
            rate=arguments.rate,
        )
        logs = Sources(model, columns, options, progress).read(arguments.recordings)
    checked = [check(model.machine, log, model) for log in logs]
    print("\n".join(line for one in checked for line in _lines(one)))
    if refused := [one.source for one in checked if one.decisive]:
        raise DataError(
            f"{', '.join(refused)}: whatever is fitted to this is wrong; record again, or mend the "
            "column map or the machine file"
        )


def _usual(name: Path | None) -> Model:
    """That of the report where the machine is such a crane, or else the machine's own."""
    machine = load_machine(name)
    return crane(machine) if machine.planar else load_model(machine_file("model.yaml", name))


def _lines(checked: Checked) -> list[str]:
    return [
        f"{checked.source}: looks {checked.verdict}",
        *(f"  {'wrong' if one.decisive else 'doubtful'}: {one}" for one in checked.suspicions),
        *(f"  not checked: {what}" for what in checked.unchecked),
        *(f"  note: {note}" for note in checked.notes),
    ]


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = cli.command_line(
        description="Check recordings against the machine before anything is fitted to them: "
        "units, signs, names, chambers, transducers, clocks. The exit status is 1 if one of them "
        "would make every result wrong.",
        epilog=f"Recordings are bags (folders) or tables ({', '.join(TABLES)}) with a column map.",
    )
    add = result.add_argument
    machine = result.add_mutually_exclusive_group()
    machine.add_argument(
        "--machine",
        type=Path,
        help="machine: name, folder or file (default: the laboratory crane)",
    )
    machine.add_argument("--model", type=Path, help="model file; its machine and its joints")
    add("--terms", type=Path, metavar="FILE", help="Python file with terms of your own")
    add("--columns", type=Path, help="column map (YAML) of the tables")
    add_part(result)
    add("recordings", type=Path, nargs="+", metavar="RECORDING")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; exit status 0, 1 for an error that is named, 130 when interrupted."""
    arguments = parser().parse_args(list(sys.argv[1:] if argv is None else argv))
    return cli.run(lambda: run(arguments))
