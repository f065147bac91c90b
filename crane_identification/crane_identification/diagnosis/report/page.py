"""report.html: one file, without network, with one evidence card per finding."""

from collections.abc import Sequence
from pathlib import Path

from crane_identification.diagnosis import (
    finding_wording,
    findings,
    open_wording,
    unknown_wording,
    wording,
)
from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.flow.flow import Quantity
from crane_identification.diagnosis.flow_and_load_findings import of_quantity
from crane_identification.diagnosis.report.cards import cards, drawn
from crane_identification.diagnosis.report.pictures import gap_pictures, where_picture
from crane_identification.notation import human, listed, percent, plain, spoken
from crane_identification.report import template
from crane_identification.report.content import Provenance
from crane_identification.report.template import PageLink, link, page_of
from crane_model.flow import FLOW_EFFECTS

RESULTS = ("model.yaml", "findings.json")  # beside the page
SHARED = "crane_identification.report"  # style and script of the identification report


def write(
    path: Path | str, diagnosis: Diagnosis, provenance: Provenance, suspicions: Sequence[str] = ()
) -> None:
    """Write the page, with what is suspicious of the recordings."""
    path = Path(path)
    html = render(diagnosis, provenance, suspicions, path.parent)
    path.write_text(html, encoding="utf-8")


def render(
    diagnosis: Diagnosis,
    provenance: Provenance,
    suspicions: Sequence[str] = (),
    folder: Path = Path(),
) -> str:
    """The page as HTML, with links that hold in `folder`."""
    content = findings.content(diagnosis)
    found, gap = cards(diagnosis, content), gap_pictures(diagnosis)
    where = [] if content["verdict"] in wording.NOISE else [where_picture(diagnosis)]
    near = unknown_wording.nearest_drawn(content["unknown"]) if content["unknown"] else None
    shapes = drawn("unknown", near) if near else ()
    shown = [*where, *gap, *shapes, *(picture for card in found for picture in card.pictures)]
    return template.rendered(
        __package__,
        {picture.key: picture.description for picture in shown},
        diagnosis=diagnosis,
        answer=wording.answer(content),
        reason=wording.reason(content),
        called=[finding_wording.called(one) for one in content["findings"]],
        cards=found,
        gap=gap,
        added=wording.added(content),
        loads=wording.loads(content),
        errors=list(wording.errors(content)),
        motion=list(wording.motion(content, diagnosis.before.setting.units)),
        not_simulated=[
            f"{which} the findings, {motion.reason}"
            for which, motion in (
                ("before", diagnosis.gap.motion_before),
                ("after", diagnosis.gap.motion_after),
            )
            if motion.reason
        ],
        commanded=list(wording.commanded(content)),
        nearest=wording.nearest(content),
        own_terms=wording.own_terms(content),
        unknown=unknown_wording.title(content),
        signatures=unknown_wording.lines(content),
        shapes=shapes,
        open=open_wording.lines(content),
        settle=open_wording.command(content, folder),
        left=wording.sentence(wording.left(content)),
        where=where,
        disagrees=list(wording.disagrees(content)),
        estimate=lambda one: finding_wording.estimate(of_quantity(one).plain()),
        usual=_usual,
        percent=percent,
        named_from=listed(wording.named_from(content)),
        spoken=spoken,
        sentence=wording.sentence,
        untestable=_listed(diagnosis.search.untestable, diagnosis),
        unobservable=_listed(diagnosis.search.unobservable, diagnosis)
        + [
            (f"{FLOW_EFFECTS[effect].effect.name} ({spoken(joint)})", reason)
            for (effect, joint), reason in diagnosis.flow.unobservable.items()
        ],
        provenance=provenance,
        suspicions=suspicions,
        model_file=link(provenance.model_file, folder),
        model_page=page_of(provenance.model_file, folder),
        results=[PageLink(name, name) for name in RESULTS],
        training=[link(bag, folder) for bag in diagnosis.training.sources],
        validation=[link(bag, folder) for bag in diagnosis.held_out.sources],
        style=template.part(SHARED, "page.css") + template.part(__package__, "page.css"),
        script=template.part(SHARED, "page.js"),
    )


def _usual(one: Quantity) -> str:
    """The limit of what is usual."""
    unit, factor = human(one.unit)
    return f"{plain(factor * abs(one.usual))} {unit}".rstrip()


def _listed(candidates: dict, diagnosis: Diagnosis) -> list[tuple[str, str]]:
    return [
        (
            f"{f.effect.name} ({finding_wording.place(f.where)})",
            wording.said(reason, diagnosis.joints),
        )
        for f, reason in candidates.items()
    ]
