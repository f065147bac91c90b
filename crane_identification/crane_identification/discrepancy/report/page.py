"""report.html: one file, without network, with one evidence card per finding."""

from collections.abc import Sequence
from pathlib import Path

from crane_identification.discrepancy.diagnosis import Diagnosis
from crane_identification.discrepancy.explain import WHERE, answer
from crane_identification.discrepancy.loads import NO_LOAD
from crane_identification.discrepancy.report.cards import cards, gap_pictures, where_picture
from crane_identification.report import template
from crane_identification.report.content import Provenance
from crane_identification.report.notation import spoken

SHARED = "crane_identification.report"  # style and script of the identification report


def write(
    path: Path | str, diagnosis: Diagnosis, provenance: Provenance, suspicions: Sequence[str] = ()
) -> None:
    """Write the page, with what is suspicious of the recordings."""
    Path(path).write_text(render(diagnosis, provenance, suspicions), encoding="utf-8")


def render(diagnosis: Diagnosis, provenance: Provenance, suspicions: Sequence[str] = ()) -> str:
    """The page as HTML."""
    found, gap, where = cards(diagnosis), gap_pictures(diagnosis), where_picture(diagnosis)
    shown = [where, *gap, *(picture for card in found for picture in card.pictures)]
    return template.rendered(
        __package__,
        {picture.key: picture.description for picture in shown},
        diagnosis=diagnosis,
        answer=answer(diagnosis.verdict.value, diagnosis.fixed),
        cards=found,
        gap=gap,
        not_simulated=[
            f"{which} the findings, {motion.reason}"
            for which, motion in (
                ("before", diagnosis.gap.motion_before),
                ("after", diagnosis.gap.motion_after),
            )
            if motion.reason
        ],
        where=where,
        where_said=WHERE[diagnosis.verdict.value],
        regions=[
            (spoken(joint), one)
            for joint, one in zip(diagnosis.joints, diagnosis.regions, strict=True)
            if one is not None
        ],
        spoken=spoken,
        no_load=NO_LOAD,
        untestable=_listed(diagnosis.search.untestable),
        unobservable=_listed(diagnosis.search.unobservable),
        provenance=provenance,
        suspicions=suspicions,
        training=list(dict.fromkeys(run.source for run in diagnosis.training.runs)),
        validation=list(dict.fromkeys(run.source for run in diagnosis.held_out.runs)),
        style=template.part(SHARED, "page.css") + template.part(__package__, "page.css"),
        script=template.part(SHARED, "page.js"),
    )


def _listed(families: dict) -> list[tuple[str, str]]:
    return [(f"{f.effect.name} ({spoken(f.where)})", reason) for f, reason in families.items()]
