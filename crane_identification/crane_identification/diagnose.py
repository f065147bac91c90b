"""`diagnose`: where a model disagrees with recordings, which effect is missing, and the proof."""

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from crane_identification.data.arguments import (
    add_processing,
    add_recordings,
    add_trust,
    options_of,
)
from crane_identification.data.column_map import TABLES, ColumnMap
from crane_model import cli
from crane_model.configuration import load
from crane_model.errors import ConfigurationError, DataError
from crane_model.progress_bar import ProgressBar

WITHOUT = "effects to exclude, by their names in findings.json"
FIXED = "keep the values of the model, and find what has changed since its identification"
NEEDED = ("model", "train", "validate", "out")


def run(arguments: argparse.Namespace) -> None:
    """Everything the command does; raises `CraneError` with what is wrong."""
    if arguments.explain is not None:
        from crane_identification.diagnosis.findings import Findings

        _tell(Findings.read(arguments.explain / "findings.json").plain(), arguments.explain)
        return
    absent = [f"--{name}" for name in NEEDED if not getattr(arguments, name)]
    if absent:
        raise ConfigurationError(f"{', '.join(absent)}: needed for a diagnosis; see --help")
    # Imported here: they take seconds, and --help needs none of them.
    from crane_identification.data.sources import Sources, refuse_copies, refuse_overlap
    from crane_identification.diagnosis import page, words
    from crane_identification.diagnosis.diagnosis import check_known, diagnose
    from crane_identification.diagnosis.fit import fitted
    from crane_identification.diagnosis.flow import load_usual
    from crane_identification.recording_check.check import blaming, vetted
    from crane_identification.recording_check.loads import split_by_load
    from crane_identification.report.content import Provenance
    from crane_identification.thresholds import load_thresholds
    from crane_model.model_file import load_model, save_model
    from crane_model.terms import load_terms

    start = time.perf_counter()
    results = (arguments.out / name for name in ("model.yaml", "findings.json", "report.html"))
    cli.check_out(*results, replace=arguments.replace)
    user_terms = load_terms(arguments.terms) if arguments.terms else ()
    model = load_model(arguments.model)
    why = "the model error is tested on held-out recordings"
    refuse_overlap(arguments.train, arguments.validate, why)
    columns = load(arguments.columns, ColumnMap) if arguments.columns else None
    check_known(arguments.without)
    thresholds = load_thresholds(arguments.thresholds)
    usual = load_usual(arguments.hydraulics)
    # Threads of linear algebra would wait for one another; processes share the work.
    with ProgressBar() as progress, threadpool_limits(limits=1):
        options = options_of(arguments)
        sources = Sources(model, columns, options, progress)
        training, held_out = sources.read(arguments.train), sources.read(arguments.validate)
        refuse_copies((*training, *held_out))
        suspicions = vetted(
            model.machine, (*training, *held_out), arguments.trust_recordings, model
        )
        with blaming(suspicions):
            fit = None  # if the recordings as they are cannot be used, as `diagnose` says of parts
            with suppress(DataError):
                fit = fitted(model, training, held_out, options, arguments.fixed, progress)
            weighed_by = fit.before if fit and model.values is None else model
            prepared = fit.training.recordings if fit else ()
            training, changes = split_by_load(weighed_by, training, options, prepared)
            held_out, more = split_by_load(weighed_by, held_out, options)
            suspicions += changes + more
            result = diagnose(
                model,
                training,
                held_out,
                options,
                thresholds,
                progress,
                usual,
                arguments.without,
                arguments.fixed,
                [str(term.model_fields["type"].default) for term in user_terms],
                None if changes or more else fit,  # of the parts, where a recording was split
            )
        provenance = Provenance.of(
            datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            ["diagnose", *arguments.given],
            str(arguments.model),
        )
        arguments.out.mkdir(parents=True, exist_ok=True)
        save_model(arguments.out / "model.yaml", result.after)
        found = result.results(suspicions)
        found.write(arguments.out / "findings.json")
        if found.unknown is not None and found.unknown.formula is not None:
            name = words.formula_file(found.unknown.plain())
            (arguments.out / name).write_text(found.unknown.formula.source, encoding="utf-8")
        page.write(arguments.out / "report.html", result, provenance, suspicions)
    _tell(found.plain(), arguments.out)
    print(f"written: {arguments.out}/findings.json, model.yaml, report.html")
    logs = [*training, *held_out]
    samples = sum(len(log.position.time) for log in logs)
    seconds = time.perf_counter() - start
    print(f"{len(logs)} recordings, {samples} samples of each joint, {seconds:.0f} s")


def _tell(content: dict[str, Any], folder: Path) -> None:
    from crane_identification.diagnosis import words

    for warning in (*content.get("suspicions", ()), *content.get("warnings", ())):
        print(f"warning: {warning}", file=sys.stderr)
    print("\n".join([*words.lines(content), *words.next_step(content, folder)]))


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = cli.command_line(
        description="Find where a model disagrees with recordings, name the missing effect, "
        "add it to the model, and validate it on held-out recordings. Writes "
        "findings.json, model.yaml and report.html.",
        epilog=f"Recordings are bags (folders) or tables ({', '.join(TABLES)}) with a column map.",
    )
    add = result.add_argument
    add("--model", type=Path, help="model file (YAML) that lists the terms")
    add_recordings(result, "--train", "recordings to diagnose")
    add_recordings(result, "--validate", "held-out recordings to validate the answer on")
    add("--out", type=Path, help="folder for the results")
    cli.add_replace(result)
    add(
        "--terms",
        type=Path,
        metavar="FILE",
        help="Python file with your own terms; `diagnose` searches and reports their effects, too",
    )
    add_processing(result)
    add("--without", nargs="+", default=[], metavar="EFFECT", help=WITHOUT)
    add("--fixed", action="store_true", help=FIXED)
    add("--thresholds", type=Path, help="thresholds (YAML; default: the packaged ones)")
    add(
        "--hydraulics",
        type=Path,
        help="usual values of valves and oil that the model does not contain (YAML)",
    )
    add_trust(result)
    add("--explain", type=Path, metavar="DIR", help="print the answer of the diagnosis in DIR")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; exit status 0, 1 for an error that is named, 130 when interrupted."""
    given = list(sys.argv[1:] if argv is None else argv)
    arguments = parser().parse_args(given)
    arguments.given = given
    return cli.run(lambda: run(arguments))
