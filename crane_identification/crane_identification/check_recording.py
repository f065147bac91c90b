"""`check_recording`: look for wrong units, wiring, names and clocks before any fit."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

from crane_identification.data.arguments import add_part, request_of
from crane_identification.data.column_map import TABLES, ColumnMap
from crane_identification.options import Options
from crane_identification.recording_check.suspicion import Checked
from crane_model import cli
from crane_model.configuration import load
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine_files import machine_file
from crane_model.progress_bar import ProgressBar


@dataclass(frozen=True)
class CheckRequest:
    """The recordings to check, against a machine or a model, and the `options` to read them by."""

    recordings: tuple[Path, ...]
    machine: Path | None
    model: Path | None
    terms: Path | None
    columns: Path | None
    options: Options


def run(request: CheckRequest) -> None:
    """Print what each recording looks like; `DataError` if one is wrong or cannot be read."""
    # Imported here: they take seconds, and --help needs none of them.
    from crane_identification.data.sources import Sources
    from crane_identification.recording_check.check import check
    from crane_identification.recording_check.forces import crane
    from crane_model.machine import load_machine
    from crane_model.model_file import load_model
    from crane_model.terms import load_terms

    if request.terms:
        load_terms(request.terms)
    if request.model:
        model = load_model(request.model)
    else:  # the model of the paper [1] if the machine is such a crane, else the machine's own
        machine = load_machine(request.machine)
        own = machine_file("model.yaml", request.machine)
        model = crane(machine) if machine.planar else load_model(own)
    columns = load(request.columns, ColumnMap) if request.columns else None
    if columns and not (request.model or request.machine or {*model.joints} & {*columns.joints}):
        raise ConfigurationError(
            f"{request.columns}: the joints {', '.join(columns.joints)} are not those of "
            "the laboratory crane, which is the default; give your machine by --model or --machine"
        )
    checked: list[Checked] = []
    faults: list[str] = []
    with ProgressBar() as progress, threadpool_limits(limits=1):
        sources = Sources(model, columns, request.options, progress)
        for path in request.recordings:
            try:
                (log,) = sources.read([path])
            except DataError as error:  # the others are checked all the same
                faults.append(str(error))
            else:
                checked.append(check(model.machine, log, model))
    for recording in checked:
        print("\n".join(_lines(recording)))
    if refused := [recording.source for recording in checked if recording.decisive]:
        faults.append(
            f"{', '.join(refused)}: every fit to this would be wrong; record again, or correct "
            "the column map or the machine file"
        )
    if faults:
        raise DataError("\n".join(faults))


def _lines(checked: Checked) -> list[str]:
    return [
        f"{checked.source}: looks {checked.verdict}",
        *(
            f"  {'wrong' if suspicion.decisive else 'doubtful'}: {suspicion}"
            for suspicion in checked.suspicions
        ),
        *(f"  not checked: {what}" for what in checked.unchecked),
        *(f"  note: {note}" for note in checked.notes),
    ]


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = cli.command_line(
        description="Check units, signs, names, chambers, transducers and clocks of "
        "recordings before a fit. The exit status is 1 if a problem would "
        "invalidate every result.",
        epilog=f"Recordings are bags (folders) or tables ({', '.join(TABLES)}) with a column map.",
    )
    add = result.add_argument
    machine = result.add_mutually_exclusive_group()
    machine.add_argument(
        "--machine", type=Path, help="machine: name, folder or file (default: the laboratory crane)"
    )
    machine.add_argument("--model", type=Path, help="model file; defines machine and joints")
    add("--terms", type=Path, metavar="FILE", help="Python file with your own terms")
    add_part(result)
    add("recordings", type=Path, nargs="+", metavar="RECORDING")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; exit status 0, 1 for an error that is named, 130 when interrupted."""
    arguments = parser().parse_args(list(sys.argv[1:] if argv is None else argv))
    return cli.run(lambda: run(request_of(CheckRequest, arguments)))
