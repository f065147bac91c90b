"""report.html: one file, without network, with one evidence card per finding and its charts.

A chart is a description as plotly.js wants it; its colours are names of CSS variables.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binned_statistic

from crane_identification.diagnosis import words
from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.evidence import TINY, Zone, least_squares
from crane_identification.diagnosis.proof import Finding
from crane_identification.diagnosis.residuals import OF_NO_JOINT, on_rows, unit_of
from crane_identification.diagnosis.words import Content
from crane_identification.notation import human, listed, percent, plain, spoken
from crane_identification.report.content import Provenance
from crane_identification.report.html import (
    FONT,
    PageLink,
    axis_style,
    link,
    page_of,
    part,
    rendered,
)
from crane_model.flow import FLOW_EFFECTS
from crane_model.terms.term import Variable

RESULTS = ("model.yaml", "findings.json")  # beside the page
SHARED = "crane_identification.report"  # style and script of the identification report
WINDOW = 25.0  # s of the held-out recording that is drawn
WHATEVER: tuple[Variable, ...] = ("velocity",)  # shows that an effect depends on nothing
BEFORE, AFTER, EFFECT = "--before", "--after", "--ink"
CLOUD_POINTS = 1500  # of a cloud; more do not show
CLOUD_MEANS = 40  # of the line of means through a cloud
HEIGHT, LEGEND_HEIGHT = 240, 30  # px
STRETCHING_MEDIANS = 5.0  # of the sizes of values: larger ones do not stretch an axis


class Picture(NamedTuple):
    """A figure: the id of its div, what it shows, that in words, and its description."""

    key: str
    caption: str
    words: str
    description: dict[str, Any]

    @property
    def height(self) -> int:
        """Height that the page keeps free for it [px]."""
        return int(self.description["layout"]["height"])


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
    content = diagnosis.results(suspicions).plain()
    found = content["findings"][: len(diagnosis.findings)]  # in the force
    pictures = [
        (
            *curves(f"curve-{number}", entry["curves"], "The nonparametric curve"),
            *curves(f"deviation-{number}", entry["deviation"], "The force that its form lacks"),
            *_pictures(diagnosis, number, finding),
        )
        for number, (entry, finding) in enumerate(zip(found, diagnosis.findings, strict=True), 1)
    ]
    near = words.nearest_drawn(content["unknown"]) if content["unknown"] else None
    unknown = curves("unknown", near["curves"], "The nonparametric curve") if near else ()
    shown = [*unknown, *(one for card in pictures for one in card)]
    return rendered(
        __package__,
        {picture.key: picture.description for picture in shown},
        content=content,
        words=words,
        cards=list(zip(found, diagnosis.findings, pictures, strict=True)),
        unknown_pictures=unknown,
        name=diagnosis.before.name,
        units=diagnosis.before.setting.units,
        undetermined_flow={one.joint: one.undetermined for one in diagnosis.flow.found},
        missing_flow={(one.joint, q.type) for one in diagnosis.flow.found for q in one.missing},
        flow_effects=FLOW_EFFECTS,
        not_simulated=[
            f"{which} the findings, {motion.reason}"
            for which, motion in (
                ("before", diagnosis.gap.motion_before),
                ("after", diagnosis.gap.motion_after),
            )
            if motion.reason
        ],
        discriminate=words.discriminating_command(content, folder),
        percent=percent,
        listed=listed,
        spoken=spoken,
        usual=_usual,
        provenance=provenance,
        model_file=link(provenance.model_file, folder),
        model_page=page_of(provenance.model_file, folder),
        results=[PageLink(name, name) for name in RESULTS],
        training=[link(bag, folder) for bag in diagnosis.training.sources],
        validation=[link(bag, folder) for bag in diagnosis.held_out.sources],
        style=part(SHARED, "page.css") + part(__package__, "page.css"),
        script=part(SHARED, "page.js"),
    )


def _usual(quantity: Content, missing: bool) -> str:
    """The limit of what is usual, and whether a value beyond it is too uncertain to count."""
    unit, factor = human(quantity["unit"])
    value, limit = abs(quantity["value"] or 0.0), abs(quantity["usual_limit"])
    unsure = ", not surely exceeded" if value > limit and not missing else ""
    return f"{plain(factor * limit)} {unit}".rstrip() + unsure


# The pictures of all, and of one finding.


def curves(key: str, entries: Sequence[Content], title: str) -> tuple[Picture, ...]:
    """Nonparametric curves of findings.json, one for each factor."""
    out = []
    for place, one in enumerate(entries):
        (unit, factor), (force, size) = human(one["variable_unit"]), human(one["unit"])
        values, std_devs = (size * np.array(one[name]) for name in ("values", "std_devs"))
        times = "" if one["times"] == "1" else f", to be multiplied by {one['times']}"
        line = _trace("", EFFECT, factor * np.array(one["knots"]), values, mode="lines+markers")
        bars = {"type": "data", "array": numbers(std_devs), "color": EFFECT, "thickness": 1}
        out.append(
            Picture(
                f"{key}-{place}",
                f"{title}{times}: values at its knots, with their standard deviations",
                f"From {plain(values.min())} to {plain(values.max())} {force}.",
                description(
                    [line | {"error_y": bars}], f"{one['variable']} [{unit}]", f"[{force}]"
                ),
            )
        )
    return tuple(out)


def _pictures(diagnosis: Diagnosis, number: int, finding: Finding) -> tuple[Picture, ...]:
    """The effect over what it follows, its gains by fold, and the force on a held-out recording."""
    judged, evidence, joints = finding.judged, diagnosis.training, diagnosis.joints
    left = np.maximum(evidence.rms(evidence.residual(diagnosis.after)), TINY)
    effect = _beside(diagnosis, finding, left)
    shown = evidence.used.sum(axis=0) * (evidence.rms(effect) / left) ** 2
    own = judged.shaped.joints(joints) if finding.candidate.joint else range(len(joints))
    carried = ~np.isin(np.arange(len(shown)) % len(joints), list(own))
    channel = int(np.argmax(np.where(carried, 0.0, shown)))
    follows = finding.candidate.effect.follows or WHATEVER
    return (
        *(
            _signature(diagnosis, f"signature-{number}-{place}", effect, channel, variable)
            for place, variable in enumerate(follows)
        ),
        folds(number, judged.fold_names, judged.held_out, set(evidence.sources)),
        _held_out(diagnosis, f"force-{number}", channel % len(joints)),
    )


def _beside(diagnosis: Diagnosis, finding: Finding, left: np.ndarray) -> np.ndarray:
    """The part of a finding (n, c) that neither the model nor the other findings explain."""
    evidence, shaped = diagnosis.training, finding.judged.shaped
    others = [
        one.judged.shaped.columns for one in diagnosis.findings if one.judged.shaped is not shaped
    ]
    known = 0 if evidence.keeps else len(diagnosis.before.parameters)
    rest = np.concatenate([evidence.base[:, :, :known], *others], axis=2)
    effect = shaped.columns @ finding.added
    weight = np.broadcast_to(1.0 / left, effect.shape)[evidence.used]
    columns = rest[evidence.used] * weight[:, np.newaxis]
    return effect - rest @ least_squares(columns, effect[evidence.used] * weight)


def _signature(
    diagnosis: Diagnosis, key: str, effect: np.ndarray, channel: int, variable: Variable
) -> Picture:
    """The residual of a channel with an effect (n, c) and without, over what it depends on."""
    evidence, j = diagnosis.training, channel % len(diagnosis.joints)
    used, joint = evidence.used[:, channel], diagnosis.joints[j]
    after = evidence.residual(diagnosis.after)[used, channel]
    before = after + effect[used, channel]
    unit, factor = _unit(diagnosis, variable, joint)
    force, _ = _unit(diagnosis, "force", joint)
    x = factor * on_rows(variable, evidence, j)[used]
    forwards = on_rows("velocity", evidence, j)[used] >= 0.0
    about = variable if variable in OF_NO_JOINT else f"{variable} of the {spoken(joint)}"
    zone = list(Zone)[channel // len(diagnosis.joints)].value
    thin = np.unique(np.linspace(0, len(x) - 1, min(CLOUD_POINTS, len(x))).astype(int))
    order = thin[np.argsort(x[thin])]
    data = []
    for name, colour, symbol, y in (
        ("before", BEFORE, "circle", before),
        ("after", AFTER, "x", after),
    ):
        marker = {"symbol": symbol, "color": colour, "size": 4, "opacity": 0.55}
        cloud = _trace(name, colour, x[order], y[order], mode="markers") | {"marker": marker}
        data.append({key: value for key, value in cloud.items() if key != "line"})
    for name, dash, which in (("forwards", "solid", forwards), ("backwards", "dash", ~forwards)):
        if which.any():
            means, edges, _ = binned_statistic(x[which], (before - after)[which], bins=CLOUD_MEANS)
            there, centres = np.isfinite(means), (edges[1:] + edges[:-1]) / 2.0
            data.append(_trace(f"added, {name}", EFFECT, centres[there], means[there], dash=dash))
    return Picture(
        key,
        f"Residual of the {spoken(joint)} {zone}, before and after adding this effect, over the "
        f"{about}. Lines: the visible part of the effect, forwards (solid) and backwards (dashed)",
        _sizes(before, after, force),
        description(
            data, about + (f" [{unit}]" if unit else ""), f"τ − τ<sub>model</sub> [{force}]"
        ),
    )


def folds(number: int, names: Sequence[str], gains: np.ndarray, recordings: set[str]) -> Picture:
    """Gains of an effect on training data that is left out of the fit in turn."""
    whole = set(names) <= recordings
    part = "training recording" if whole else "part of the training data"
    ends, axis = span(gains), dict[str, Any]()
    caption = [f"Improvement on each {part}, left out of the fit in turn."]
    if ends is not None:
        axis = {"range": list(ends), "autorange": False}
        beyond = np.flatnonzero((gains < ends[0]) | (gains > ends[1]))
        far = [f"{i + 1} reaches {plain(gains[i])}" for i in beyond]
        caption.append(f"The axis is cut: {listed(far)}.")
    unknown = [str(i + 1) for i in np.flatnonzero(~np.isfinite(gains))]
    if unknown:
        caption.append(f"Not tested: {listed(unknown)}, which the effect needs to be determined.")
    told = [plain(gain) if np.isfinite(gain) else "not tested" for gain in gains]
    bars = {
        "type": "bar",
        "x": [str(number + 1) for number in range(len(names))],
        "y": numbers(gains),
        "customdata": list(names),
        "marker": {"color": [AFTER if gain > 0 else BEFORE for gain in gains]},
        "hovertemplate": "%{customdata}: %{y:.4~r}<extra></extra>",
    }
    chart = description([bars], f"{part} left out of the fit", "gain (2 Δ log likelihood)")
    chart["layout"]["xaxis"] |= {"type": "category"}
    chart["layout"]["yaxis"] |= axis
    return Picture(f"folds-{number}", " ".join(caption), f"Gains: {', '.join(told)}.", chart)


def span(values: np.ndarray) -> tuple[float, float] | None:
    """Ends of an axis that single values far beyond the others do not stretch; None for all."""
    finite = values[np.isfinite(values)]
    reach = STRETCHING_MEDIANS * float(np.median(np.abs(finite))) if len(finite) else 0.0
    if not reach or np.abs(finite).max() <= reach:
        return None
    cut = np.where(np.abs(finite) <= reach, finite, reach * np.sign(finite)).tolist()
    return min(0.0, *cut), max(0.0, *cut)


def _held_out(diagnosis: Diagnosis, key: str, j: int) -> Picture:
    held_out = diagnosis.held_out
    moving = held_out.used[:, j]
    run = np.argmax(np.bincount(held_out.run, moving))  # in which the joint moves most
    inside = held_out.run == run
    time = held_out.time[inside]
    middle = time[0] + (time[-1] - time[0]) / 2.0
    if not moving[inside][np.abs(time - middle) <= WINDOW / 2.0].any() and moving[inside].any():
        middle = float(np.median(time[moving[inside]]))
    shown = np.flatnonzero(inside)[np.abs(time - middle) <= WINDOW / 2.0]
    gone = np.where(held_out.used[shown, j], 0.0, np.nan)  # a gap where the joint turns
    before, after = (
        held_out.residual(model)[shown, j] + gone
        for model in (diagnosis.before, diagnosis.gap.carried)
    )
    unit, _ = _unit(diagnosis, "force", diagnosis.joints[j])
    data = [
        _trace("before", BEFORE, held_out.time[shown], before, 1.3, "dot"),
        _trace("after", AFTER, held_out.time[shown], after, 1.3),
    ]
    return Picture(
        key,
        f"On a held-out recording: {spoken(diagnosis.joints[j])}, measured minus predicted force",
        _sizes(before, after, unit),
        description(data, "t [s]", f"τ − τ<sub>model</sub> [{unit}]"),
    )


def _sizes(before: np.ndarray, after: np.ndarray, unit: str) -> str:
    if not np.isfinite(before).any():
        return "The joint rests there."
    rms = (float(np.sqrt(np.mean(values[np.isfinite(values)] ** 2))) for values in (before, after))
    return "Root mean square {} before, {} after.".format(*(f"{plain(one)} {unit}" for one in rms))


def _unit(diagnosis: Diagnosis, variable: Variable, joint: str) -> tuple[str, float]:
    evidence = diagnosis.training
    return human(evidence.unit(unit_of(variable, joint, evidence.model.setting)))


# Charts.


def description(data: Sequence[Mapping[str, Any]], x: str, y: str) -> dict[str, Any]:
    """Traces over one pair of axes with these titles."""
    legend = LEGEND_HEIGHT if len(data) > 1 else 0
    title = {"text": y, "x": 0, "xref": "paper", "xanchor": "left", "xshift": -52, "y": 1}
    title |= {"yref": "paper", "yanchor": "bottom", "yshift": 5, "showarrow": False}
    layout: dict[str, Any] = {
        "height": HEIGHT + legend,
        "margin": {"l": 58, "r": 12, "t": 26, "b": 42 + legend},
        "font": FONT,
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "showlegend": legend > 0,
        "legend": {"orientation": "h", "itemsizing": "constant", "x": 0, "y": -0.28}
        | {"yanchor": "top", "font": FONT},
        "hoverlabel": {"font": {"family": "--sans", "size": 11}},
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "--soft", "activecolor": "--ink"},
        "xaxis": axis_style(title={"text": x, "standoff": 6, "font": FONT}),
        "yaxis": axis_style(),
        "annotations": [title | {"font": {"size": 12, "color": "--ink", "family": "--sans"}}],
    }
    return {"data": list(data), "layout": layout}


def numbers(values: np.ndarray) -> list[float | None]:
    """Five significant digits; null where there is no number."""
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in np.asarray(values, dtype=float)]


def _trace(
    name: str,
    colour: str,
    x: np.ndarray,
    y: np.ndarray,
    width: float = 2,
    dash: str = "solid",
    mode: str = "lines",
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": mode,
        "name": name,
        "x": numbers(x),
        "y": numbers(y),
        "line": {"color": colour, "width": width, "dash": dash},
        "hovertemplate": f"%{{y:.4~r}}<extra>{name}</extra>",
    }
