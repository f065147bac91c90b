"""`identify --stream` and `--cluster`: what needs no more than sums over recordings."""

import argparse
import sys
from collections.abc import Sequence

from crane_identification.data.arguments import Sources
from crane_identification.data.column_map import ColumnMap
from crane_identification.fitting import validate
from crane_identification.options import Estimator, Options
from crane_identification.progress_bar import ProgressBar
from crane_identification.recording_check.check import vetted
from crane_identification.report import summary
from crane_identification.report.errors import pooled
from crane_identification.scale.streamed import fit_streamed
from crane_identification.scale.summed import SummedFit
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model, save_model
from crane_model.progress import Progress


def identify_by_sums(
    model: Model,
    arguments: argparse.Namespace,
    columns: ColumnMap | None,
    options: Options,
    warnings: Sequence[str],
) -> None:
    """Fit by sums of information matrices, on a Dask cluster or recording by recording, and
    validate here; the figures of a report would need all rows here.
    """
    option = "--cluster" if arguments.cluster else "--stream"
    if options.estimator is not Estimator.LEAST_SQUARES or arguments.recursive:
        raise ConfigurationError(
            f"{option} sums information matrices, which is least squares (31); give "
            "--estimator least_squares, without --recursive"
        )
    if arguments.prior:
        raise ConfigurationError(f"{option} takes no prior; leave out --prior")
    if arguments.ramps:
        raise ConfigurationError(f"{option} finds no valves; leave out --ramps")
    with ProgressBar() as progress:
        trusted = arguments.trust_recordings
        result = (
            _on_cluster(model, arguments, columns, options, progress)
            if arguments.cluster
            else fit_streamed(model, arguments.train, options, progress, columns, trusted)
        )
        sources = Sources(model, columns, options, progress)
        held_out = sources.read(arguments.validate)
        for warning in (
            *warnings,
            *result.suspicions,
            *vetted(model.machine, held_out, trusted, model),
        ):
            print(f"warning: {warning}", file=sys.stderr)
        validations = validate(result.model, held_out, options, progress) if held_out else ()
    errors = pooled(result.model, validations) if validations else None
    arguments.out.mkdir(parents=True, exist_ok=True)
    save_model(arguments.out / "model.yaml", result.model)
    summary.write_summed(arguments.out / "summary.json", result, errors)
    print(
        f"{len(model.parameters)} parameters from {result.information.rows.sum()} equations of "
        f"{len(arguments.train)} recordings"
        + (f", by {result.workers} workers" if arguments.cluster else "")
    )
    print(f"written: {arguments.out}/model.yaml, {arguments.out}/summary.json")


def _on_cluster(
    model: Model,
    arguments: argparse.Namespace,
    columns: ColumnMap | None,
    options: Options,
    progress: Progress,
) -> SummedFit:
    if arguments.terms:
        raise ConfigurationError(
            "--cluster: its workers do not have the file of --terms; leave it out"
        )
    try:
        from crane_identification.scale.cluster import fit_on_cluster
    except ImportError as error:
        raise ConfigurationError(f"--cluster needs Dask: {error}; install distributed") from None
    trusted = arguments.trust_recordings
    return fit_on_cluster(
        model, arguments.train, arguments.cluster, options, progress, columns, trusted
    )
