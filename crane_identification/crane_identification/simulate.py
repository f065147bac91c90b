"""`simulate`: move the model along a recording, from valve commands or pressures, and compare."""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from crane_identification.data.arguments import add_part, request_of
from crane_identification.data.column_map import ColumnMap
from crane_identification.options import Options
from crane_model import cli
from crane_model.configuration import load
from crane_model.errors import DataError
from crane_model.progress_bar import ProgressBar


@dataclass(frozen=True)
class SimulationRequest:
    """The `model` and the recordings `bag` to simulate, from valve commands or pressures."""

    model: Path
    bag: tuple[Path, ...]
    from_commands: bool
    columns: Path | None
    options: Options


def run(request: SimulationRequest) -> None:
    """Simulate, and print how far the simulated motion is off; raises `CraneError`."""
    # Imported here: they take seconds, and --help needs none of them.
    from crane_identification.data.sources import Sources
    from crane_identification.preparation.prepare import prepare_all
    from crane_identification.report.terminal import ahead, console
    from crane_identification.validation.motion_validation import (
        MotionValidation,
        validate_commands,
        validate_motion,
    )
    from crane_model.model_file import load_model

    model = load_model(request.model).of_machine()
    columns = load(request.columns, ColumnMap) if request.columns else None
    with ProgressBar() as progress:
        logs = Sources(model, columns, request.options, progress).read(request.bag)
    began = time.perf_counter()
    found: Sequence[MotionValidation]
    if request.from_commands:
        found = validate_commands(model, logs, request.options)
    else:
        records = [
            preparation.record for preparation in prepare_all(model, logs, Options(average=False))
        ]
        driven = validate_motion(model, records)
        if driven.reason:
            raise DataError(driven.reason)
        found = (driven,)
    took = time.perf_counter() - began
    source = "valve commands" if request.from_commands else "measured pressures"
    print(f"simulated from {source}, against measured motion:")
    for validation in found:
        console(100).print(ahead(model, validation))
    simulated = sum(validation.windows * validation.horizon for validation in found)
    print(f"{simulated:.0f} s simulated in {took:.1f} s, preparation included")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = cli.command_line(
        description="Simulate an identified model over windows of held-out recordings, each "
        "from the measured state, and print the errors at the end of the windows."
    )
    add = result.add_argument
    add("--model", type=Path, required=True, help="model file with values, from identify")
    add("--bag", type=Path, nargs="+", required=True, help="recordings to compare with")
    add(
        "--from-commands",
        action="store_true",
        help="simulate from valve commands, through the hydraulics (default: from "
        "measured pressures)",
    )
    add_part(result)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; exit status 0, 1 for an error that is named, 130 when interrupted."""
    arguments = parser().parse_args(list(sys.argv[1:] if argv is None else argv))
    return cli.run(lambda: run(request_of(SimulationRequest, arguments)))
