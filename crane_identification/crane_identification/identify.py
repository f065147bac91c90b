"""`identify`: fit a model to recordings, validate it on others, write model, summary and report."""

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import RootModel
from threadpoolctl import threadpool_limits

from crane_identification.data.arguments import (
    add_processing,
    add_recordings,
    add_trust,
    request_of,
)
from crane_identification.data.column_map import TABLES, ColumnMap
from crane_identification.options import Estimator, Options
from crane_model import cli
from crane_model.cli import one_of
from crane_model.configuration import load
from crane_model.errors import ConfigurationError
from crane_model.progress_bar import ProgressBar

if TYPE_CHECKING:
    from crane_model.model_file import Model


@dataclass(frozen=True)
class IdentifyRequest:
    """The command line of `identify`; `given` are its words."""

    given: tuple[str, ...]
    model: Path
    train: tuple[Path, ...]
    validate: tuple[Path, ...]
    out: Path
    replace: bool
    terms: Path | None
    columns: Path | None
    options: Options
    prior: Path | None
    ramps: Path | None
    stream: bool
    cluster: str | None
    trust_recordings: bool
    recursive: bool
    reference_values: Path | None


# Fits by sums over recordings: --stream and --cluster.


def identify_by_sums(
    model: "Model", request: IdentifyRequest, columns: ColumnMap | None, warnings: Sequence[str]
) -> None:
    """Fit by sums of information matrices, on a Dask cluster or recording by recording, and
    validate here; the figures of a report would need all rows here.
    """
    from crane_identification.data.sources import Sources
    from crane_identification.fitting import validate
    from crane_identification.recording_check.check import vetted
    from crane_identification.report import summary
    from crane_identification.report.content import pooled
    from crane_identification.scale.summed import SummedFit, fit_streamed
    from crane_model.model_file import save_model

    options = request.options
    option = "--cluster" if request.cluster else "--stream"
    if options.estimator is not Estimator.LEAST_SQUARES or request.recursive:
        raise ConfigurationError(
            f"{option} sums information matrices, which is least squares (31); give "
            "--estimator least_squares, without --recursive"
        )
    if request.prior:
        raise ConfigurationError(f"{option} takes no prior; leave out --prior")
    if request.ramps:
        raise ConfigurationError(f"{option} finds no valves; leave out --ramps")
    fit: Callable[..., SummedFit] = fit_streamed
    if request.cluster:
        if request.terms:
            raise ConfigurationError(
                "--cluster: its workers do not have the file of --terms; leave it out"
            )
        try:
            from crane_identification.scale.cluster import fit_on_cluster
        except ImportError as error:
            raise ConfigurationError(
                f"--cluster needs Dask: {error}; install distributed"
            ) from None
        fit = partial(fit_on_cluster, address=request.cluster)
    trusted = request.trust_recordings
    with ProgressBar() as progress:
        result = fit(
            model,
            request.train,
            options=options,
            progress=progress,
            columns=columns,
            trusted=trusted,
        )
        sources = Sources(model, columns, options, progress)
        held_out = sources.read(request.validate)
        for warning in (
            *warnings,
            *result.suspicions,
            *vetted(model.machine, held_out, trusted, model),
        ):
            print(f"warning: {warning}", file=sys.stderr)
        validations = validate(result.model, held_out, options, progress) if held_out else ()
    errors = pooled(result.model, validations) if validations else None
    request.out.mkdir(parents=True, exist_ok=True)
    save_model(request.out / "model.yaml", result.model)
    summary.write_summed(request.out / "summary.json", result, errors)
    print(
        f"{len(model.parameters)} parameters from {result.information.rows.sum()} equations of "
        f"{len(request.train)} recordings"
    )
    print(f"written: {request.out}/model.yaml, {request.out}/summary.json")


class ReferenceValues(RootModel[dict[str, float]]):
    """Known values of parameters by name, to be shown beside the estimates."""


def identify(request: IdentifyRequest) -> None:
    """Fit, validate and write the results; raises `CraneError`."""
    # Imported here: they take seconds, and --help needs none of them.
    from crane_identification.data.sources import Sources, refuse_copies, refuse_overlap
    from crane_identification.estimation.prior import load_prior
    from crane_identification.fitting import fit, validate
    from crane_identification.hydraulics.joint_estimate import identify_hydraulics, with_ramps
    from crane_identification.online.replay import BackgroundTask, recursion
    from crane_identification.preparation.prepare import Session
    from crane_identification.recording_check.check import blaming, faulty_sensors, vetted
    from crane_identification.recording_check.loads import loads_in_words
    from crane_identification.report import page, summary
    from crane_identification.report.content import IdentificationReport, Provenance
    from crane_identification.report.findings import findings
    from crane_identification.report.terminal import tell
    from crane_model.model_file import load_model, save_model
    from crane_model.terms import load_terms

    by_sums = request.cluster or request.stream
    names = ("model.yaml", "summary.json", *(() if by_sums else ("report.html",)))
    cli.check_out(*(request.out / name for name in names), replace=request.replace)
    if request.terms:
        load_terms(request.terms)
    given = load_model(request.model)
    model = given.of_machine()
    alike = _loads_left_out(given, model)
    refuse_overlap(
        request.train, request.validate, "validate on recordings that the fit has not seen"
    )
    columns = load(request.columns, ColumnMap) if request.columns else None
    known = _known_values(request.reference_values, model) if request.reference_values else None
    prior = load_prior(request.prior, model) if request.prior else None
    options = request.options
    if by_sums:
        identify_by_sums(model, request, columns, alike)
        return
    with ProgressBar() as progress, threadpool_limits(limits=1), ExitStack() as processes:
        sources = Sources(model, columns, options, progress)
        training = sources.read(request.train)
        suspicions = vetted(model.machine, training, request.trust_recordings, model)
        # Most of the time: reading by reading, in their order, on a core of its own.
        replayed = (
            processes.enter_context(BackgroundTask(recursion, model, training))
            if request.recursive
            else None
        )
        held_out = sources.read(request.validate)
        refuse_copies((*training, *held_out))
        suspicions += vetted(model.machine, held_out, request.trust_recordings, model)
        suspicions += faulty_sensors(given, (*request.train, *request.validate), options.end)
        session = Session.of((*training, *held_out))
        with blaming(suspicions):
            result = fit(model, training, options, progress, session, prior)
        suspicions += loads_in_words(result.model, training, options)
        hydraulics = identify_hydraulics(model, training, options.period, progress)
        if request.ramps:
            if not model.machine:
                raise ConfigurationError(
                    f"{request.model}: names no machine, whose actuators --ramps needs; name it, "
                    "or leave out --ramps"
                )
            hydraulics = with_ramps(hydraulics, request.ramps, model.machine)
        result = replace(result, model=replace(result.model, hydraulics=hydraulics))
        validations = (
            validate(result.model, held_out, options, progress, session) if held_out else ()
        )
        report = IdentificationReport(
            fit=result,
            options=options,
            training=training,
            validations=validations,
            warnings=(*alike, *suspicions, *findings(result, (*training, *held_out), validations)),
            provenance=Provenance.of(
                datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
                ["identify", *request.given],
                str(request.model),
            ),
            true_values=known,
            recursive=replayed.result(progress) if replayed else None,
            seen_by_none=held_out,
        )
        request.out.mkdir(parents=True, exist_ok=True)
        save_model(request.out / "model.yaml", result.model)
        summary.write(request.out / "summary.json", report)
        page.write(request.out / "report.html", report, progress)
    tell(report, request.out)


def _known_values(path: Path, model: "Model") -> dict[str, float]:
    """Reference values by name; `ConfigurationError` if the model has no such value."""
    from crane_model.hydraulics import JointHydraulics

    known = load(path, ReferenceValues).root
    names = [parameter.name for parameter in model.parameters]
    joints = model.machine.joint_names if model.machine else ()
    hydraulic = {f"{name}.{joint}" for joint in joints for name in JointHydraulics.units}
    if unknown := sorted(set(known) - set(names) - hydraulic):
        also = ", and the hydraulics of each joint, as lag.JOINT" if hydraulic else ""
        raise ConfigurationError(
            f"{path}: {', '.join(unknown)}: no parameter of model '{model.name}'; it has "
            f"{', '.join(names)}{also}"
        )
    return known


def _loads_left_out(given: "Model", model: "Model") -> tuple[str, ...]:
    """A warning where the `given` model held loads of recordings, which `model` does not."""
    kept = {parameter.name for parameter in model.parameters}
    loads = [parameter.name for parameter in given.parameters if parameter.name not in kept]
    if not loads:
        return ()
    return (
        f"{', '.join(loads)} of the model left out: loads of single recordings, which others do "
        "not carry. All recordings count as equally loaded; diagnose finds the load of each.",
    )


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = cli.command_line(
        description="Fit the parameters of a model to recordings, validate them on others, and "
        "write model.yaml, summary.json and report.html.",
        epilog="Recordings are bags (folders, written by ros2 bag or by the suite) or tables "
        f"({', '.join(TABLES)}) with a column map.",
    )
    add = result.add_argument
    add("--model", type=Path, required=True, help="model file (YAML) that lists the terms")
    add_recordings(result, "--train", "recordings to fit the model to", required=True)
    add_recordings(result, "--validate", "held-out recordings to validate the model on")
    add("--out", type=Path, required=True, help="folder for the results")
    cli.add_replace(result)
    add("--terms", type=Path, metavar="FILE", help="Python file with your own terms")
    add_processing(result)
    add(
        "--estimator",
        type=one_of(Estimator),
        choices=list(Estimator),
        default=Options().estimator,
        help="least_squares: ordinary, (31); weighted: by the noise between joints, from the "
        "scatter between periods; robust: tolerates outliers; instrumental: without the bias of "
        "feedback, from the recorded reference; consistent (default): least squares under physical "
        "constraints",
    )
    add(
        "--prior",
        type=Path,
        help="prior knowledge with standard deviations (YAML): parameters, or bodies from CAD",
    )
    add(
        "--ramps",
        type=Path,
        help="result.yaml of `bringup dead_band`, for valves that the recordings do not determine",
    )
    apart = result.add_mutually_exclusive_group()
    apart.add_argument(
        "--stream",
        action="store_true",
        help="process one training recording after the other, so that memory does not "
        "grow; least squares only, without a report",
    )
    apart.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="scheduler of a Dask cluster (tcp://HOST:PORT) whose workers read the training bags",
    )
    add_trust(result)
    add(
        "--recursive",
        action="store_true",
        help="also run the recursive estimator of the identification node over the "
        "training recordings, and print its result next to the fit",
    )
    add(
        "--reference-values",
        type=Path,
        help="file of known values by name (JSON, YAML), for example from `crane_sim "
        "true_values --json`, to print next to the estimates",
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; exit status 0, 1 for an error that is named, 130 when interrupted."""
    given = list(sys.argv[1:] if argv is None else argv)
    arguments = parser().parse_args(given)
    arguments.given = given
    return cli.run(lambda: identify(request_of(IdentifyRequest, arguments)))
