"""report.html: one file, without network, of everything in the report."""

from pathlib import Path
from typing import NamedTuple

from crane_identification.notation import spoken
from crane_identification.report import tables
from crane_identification.report.content import IdentificationReport, recorded, source_rows
from crane_identification.report.figures import (
    averaged_figures,
    commanded_figures,
    processing,
    recording_figures,
    recursive_errors,
    recursive_groups,
    reference_figures,
    settling_figures,
    validation_figures,
)
from crane_identification.report.findings import bags, verdict
from crane_identification.report.html import Figure, PageLink, link, page_of, part, rendered
from crane_identification.report.tables import hydraulic_groups
from crane_model.progress_bar import Progress, silent

PAGE_RESULTS = ("model.yaml", "summary.json")  # beside the page


class RowOfFigures(NamedTuple):
    """The figures of one recording, one per joint."""

    source: str
    figures: list[Figure]


def write(path: Path | str, report: IdentificationReport, progress: Progress = silent) -> None:
    """Write the page; `progress` counts its recordings."""
    path = Path(path)
    path.write_text(render(report, progress, path.parent), encoding="utf-8")


def render(report: IdentificationReport, progress: Progress = silent, folder: Path = Path()) -> str:
    """The page as HTML, with links that hold in `folder`."""
    model, model_file = report.fit.model, report.provenance.model_file
    references = _reference_rows(report)
    recordings, averages, validations = _figure_rows(report, progress)
    settling, driven = settling_figures(report), _commanded_rows(report)
    rows = (*references, *recordings, *averages, *validations, *driven)
    shown = [*settling, *(figure for row in rows for figure in row.figures)]
    return rendered(
        __package__,
        {figure.key: figure.description() for figure in shown},
        report=report,
        verdict=verdict(report),
        training_bags=bags(report.training_bags),
        validation_bags=bags(report.validation_bags),
        errors=tables.error_rows(report),
        motions=tables.motion_rows(model, [report.simulated] if report.simulated else []),
        commanded=tables.motion_rows(model, report.commanded),
        groups=tables.parameter_groups(report),
        entries=tables.report_entries(report),
        hydraulics=hydraulic_groups(report.fit.model.hydraulics, report.true_values),
        conditioning=tables.conditioning(report),
        excitation=tables.excitation(report),
        processing=processing(report),
        has_reference=any(log.reference_position is not None for log in report.training),
        has_scatter=any(len(v.preparation.periods) > 1 for v in report.validations),
        joints=[spoken(joint) for joint in report.fit.model.joints],
        sources=source_rows(report),
        model_file=link(model_file, folder),
        model_page=page_of(model_file, folder),
        results=[PageLink(name, name) for name in PAGE_RESULTS],
        training_links=[link(bag, folder) for bag in report.training_bags],
        validation_links=[link(bag, folder) for bag in report.validation_bags],
        recursive=recursive_groups(report),
        recursive_errors=recursive_errors(report),
        settling=settling,
        references=references,
        recordings=recordings,
        averages=averages,
        validations=validations,
        driven=driven,
        style=part(__package__, "page.css"),
        script=part(__package__, "page.js"),
    )


def _reference_rows(report: IdentificationReport) -> list[RowOfFigures]:
    """Rows of Fig. 8, for recordings with a reference that repeats."""
    fit = report.fit
    rows = [
        RowOfFigures(p.source, reference_figures(fit.model, p, f"reference-{number}"))
        for number, p in enumerate(fit.preparations)
        if p.averaging is not None
    ]
    return [row for row in rows if row.figures]


def _commanded_rows(report: IdentificationReport) -> list[RowOfFigures]:
    """Rows of motion from commands, as far ahead as it was simulated; none where it was not."""
    furthest = report.commanded[-1].courses if report.commanded else ()
    return [
        RowOfFigures(
            recording.source, commanded_figures(report.fit.model, recording, f"commanded-{number}")
        )
        for number, recording in enumerate(furthest)
    ]


def _figure_rows(
    report: IdentificationReport, progress: Progress
) -> tuple[list[RowOfFigures], list[RowOfFigures], list[RowOfFigures]]:
    """Rows of Fig. 9, of Figs. 10 and 11, and of Figs. 12 and 13."""
    model = report.fit.model
    recordings = []
    bandwidth = {p.source: p.bandwidth for p in report.fit.preparations}
    fitted_to = [log for log in report.training if log.source in bandwidth]
    for number, log in enumerate(fitted_to):
        recording = recorded(model, log, report.options.motion, bandwidth[log.source])
        figures = recording_figures(model, recording, f"recording-{number}")
        recordings.append(RowOfFigures(log.source, figures))
        progress("report", (number + 1) / len(fitted_to))
    averages, validations = [], []
    for number, validation in enumerate(report.validations):
        figures = averaged_figures(model, validation.preparation, f"average-{number}")
        averages.append(RowOfFigures(validation.source, figures))
        figures = validation_figures(model, validation, f"validation-{number}")
        validations.append(RowOfFigures(validation.source, figures))
    return recordings, averages, validations
