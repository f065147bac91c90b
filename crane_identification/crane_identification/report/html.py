"""Parts of HTML reports: figures, links and the template."""

import base64
import gzip
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from math import floor, log10
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

# A figure as plotly.js wants it: panels above each other over one time axis.
#
# Colours are names of CSS variables of the page ("--measured"), one per meaning; page.js puts the
# colour of screen, dark screen or paper in their place.

# Fewer points of a curve without a visible difference: the extremes of each column of pixels.

POINTS = 1500
"""Points kept of a curve: about twice the columns of pixels that a figure has on a screen."""
MEASURED, REFERENCE, MODEL = "--measured", "--reference", "--model"
TRUE_VALUE, LIMIT = "--true-value", "--soft"
SCATTER, LEFT_OUT = "--scatter", "--left-out"
DASHES = {MODEL: "dash", TRUE_VALUE: "dot", REFERENCE: "dot"}
"""Line styles that tell curves apart where there is no colour, as on paper; others are solid."""
_DIGITS = 5  # significant digits of a plotted number: finer than a pixel, even zoomed in
FONT = {"size": 11, "color": "--soft", "family": "--sans"}
_TITLE_HEIGHT, _AXIS_HEIGHT = 30, 38  # px above each panel, and below the last
PAGE = "report.html"


def thin(time: np.ndarray, values: np.ndarray, points: int = POINTS) -> np.ndarray:
    """Indices of at most `points` samples of a curve (n,) that draw it like all of them.

    Time is cut into points / 2 equal intervals, and the smallest and largest value of each are
    kept. Gaps stay gaps: of a stretch of samples that are not finite, its ends are kept.
    """
    n = len(values)
    if n <= points:
        return np.arange(n)
    finite = np.isfinite(values)
    bins = max((points - 2) // 2, 1)
    span = time[-1] - time[0]
    column = np.minimum((bins * (time - time[0]) / span).astype(int), bins - 1)
    kept = [np.array([0, n - 1]), np.flatnonzero(finite[1:] != finite[:-1]) + 1]
    index = np.flatnonzero(finite)
    # Sorted by value within each column of pixels: its first and last are the extremes.
    order = index[np.lexsort((values[index], column[index]))]
    firsts = np.flatnonzero(np.diff(column[order], prepend=-1))
    lasts = np.append(firsts[1:], len(order)) - 1 if len(order) else firsts
    return np.unique(np.concatenate([*kept, order[firsts], order[lasts]]))


@dataclass(frozen=True)
class Curve:
    """One line (n,) over time, named in the hover text."""

    name: str
    colour: str
    time: np.ndarray
    values: np.ndarray
    width: float = 1.2


@dataclass(frozen=True)
class Band:
    """The area between two curves (n,) over time."""

    name: str
    colour: str
    time: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class Panel:
    """Curves over one vertical axis: `symbol` [`unit`], `height` px tall.

    `limits` are drawn as dashed lines; `span` is what is shown at first (None: all).
    """

    symbol: str
    unit: str
    curves: Sequence[Curve]
    bands: Sequence[Band] = ()
    height: int = 130
    limits: Sequence[float] = ()
    span: tuple[float, float] | None = None


@dataclass(frozen=True)
class Figure:
    """Content of one `div` of the page; `key` is its id, `joint` its caption."""

    key: str
    joint: str
    panels: Sequence[Panel]
    left_out: Sequence[tuple[float, float]] = field(default_factory=tuple)  # s, shaded

    @property
    def height(self) -> int:
        """Height of all panels with their titles [px]."""
        return sum(panel.height + _TITLE_HEIGHT for panel in self.panels) + _AXIS_HEIGHT

    @property
    def words(self) -> str:
        names = dict.fromkeys(f"{panel.symbol} in {panel.unit}" for panel in self.panels)
        curves = dict.fromkeys(c.name for panel in self.panels for c in panel.curves)
        seconds = max(float(c.time[-1]) for panel in self.panels for c in panel.curves)
        text = f"{self.joint}: {', '.join(names)} over {seconds:.3g} s; {', '.join(curves)}"
        return re.sub("<[^>]*>", "", text)  # of subscripts

    def description(self) -> dict[str, Any]:
        """The figure in the vocabulary of plotly.js: data and layout."""
        layout: dict[str, Any] = {
            "height": self.height,
            "margin": {"l": 46, "r": 10, "t": 0, "b": 0},
            "font": FONT,
            "separators": ".",  # none between thousands
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "showlegend": False,
            "hovermode": "x",
            "hoverlabel": {"font": {"family": "--sans", "size": 11}},
            "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "--soft", "activecolor": "--ink"},
            "annotations": [],
            "shapes": [],
            "xaxis": axis_style(anchor=_axis_name("y", len(self.panels)), zeroline=False)
            | {"title": {"text": "t [s]", "standoff": 4, "font": FONT}},
        }
        data: list[dict[str, Any]] = []
        top = float(self.height)
        for number, panel in enumerate(self.panels, start=1):
            top -= _TITLE_HEIGHT
            domain = [(top - panel.height) / self.height, top / self.height]
            top -= panel.height
            name = _axis_name("y", number)
            axis = axis_style(domain=domain, nticks=5)
            layout[name.replace("y", "yaxis")] = axis
            if panel.span is not None:
                axis |= {"range": list(panel.span), "autorange": False}
            layout["shapes"] += [_dashed(limit, name) for limit in panel.limits]
            layout["annotations"].append(_title(panel, domain[1]))
            if len(self.left_out):
                layout["shapes"].append(_shading(self.left_out, domain))
            seen = panel.span and panel.span[1] - panel.span[0]
            data += [trace for band in panel.bands for trace in _area(band, name, seen)]
            data += [_line(curve, panel.unit, name, seen) for curve in panel.curves]
        return {"data": data, "layout": layout}


def _axis_name(letter: str, number: int) -> str:
    return letter if number == 1 else f"{letter}{number}"


def axis_style(**more: Any) -> dict[str, Any]:
    """An axis as all reports draw it, and what is different or more."""
    return {
        "gridcolor": "--grid",
        "zerolinecolor": "--rule",
        "zerolinewidth": 1,
        "linecolor": "--rule",
        "tickfont": FONT,
        "exponentformat": "none",
        **more,
    }


def _title(panel: Panel, top: float) -> dict[str, Any]:
    """Name of the vertical axis, level above its panel: it takes no width from a small screen."""
    return {
        "text": f"{panel.symbol} [{panel.unit}]",
        "x": 0,
        "xref": "paper",
        "xanchor": "left",
        "xshift": -44,
        "yshift": 4,
        "y": top,
        "yref": "paper",
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 12, "color": "--ink", "family": "--sans"},
    }


def _line(curve: Curve, unit: str, axis: str, seen: float | None) -> dict[str, Any]:
    kept = thin(curve.time, curve.values)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": curve.name,
        "x": _rounded(curve.time[kept]),
        "y": _rounded(curve.values[kept], seen),
        "yaxis": axis,
        "line": {
            "color": curve.colour,
            "width": curve.width,
            "dash": DASHES.get(curve.colour, "solid"),
        },
        "hovertemplate": f"%{{y:.4~g}} {unit}<extra>{curve.name}</extra>",
    }


def _area(band: Band, axis: str, seen: float | None) -> list[dict[str, Any]]:
    """The lower edge, and the upper one with the area between them."""
    edges = []
    for values, fill in ((band.low, "none"), (band.high, "tonexty")):
        kept = thin(band.time, values, 600)
        edges.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": band.name,
                "x": _rounded(band.time[kept]),
                "y": _rounded(values[kept], seen),
                "yaxis": axis,
                "line": {"width": 0},
                "fill": fill,
                "fillcolor": band.colour,
                "hoverinfo": "skip",
            }
        )
    return edges


def _shading(intervals: Sequence[tuple[float, float]], domain: Sequence[float]) -> dict[str, Any]:
    """One shape of many upright bars behind a panel."""
    low, high = domain
    path = "".join(f"M{a:.5g},{low:.4f}V{high:.4f}H{b:.5g}V{low:.4f}Z" for a, b in intervals)
    return {
        "type": "path",
        "path": path,
        "xref": "x",
        "yref": "paper",
        "layer": "below",
        "line": {"width": 0},
        "fillcolor": LEFT_OUT,
    }


def _dashed(limit: float, axis: str) -> dict[str, Any]:
    return {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": axis,
        "y0": limit,
        "y1": limit,
        "line": {"color": LIMIT, "width": 1, "dash": "dash"},
    }


def _rounded(values: np.ndarray, seen: float | None = None) -> list[float | None]:
    """Numbers short enough for a page, for a panel that shows so much of them (None: all).

    null where there is a gap.
    """
    finite = np.isfinite(values)
    largest = seen or float(np.abs(values[finite]).max(initial=0.0))
    decimals = _DIGITS - 1 - floor(log10(largest)) if largest > 0 else 0
    rounded = np.round(values, decimals).tolist()
    if finite.all():
        return rounded
    return [value if known else None for value, known in zip(rounded, finite, strict=True)]


# Links of a page to what it was made of; relative, so that they hold where all of it is moved.


class PageLink(NamedTuple):
    """A link of the page, and its target."""

    text: str
    address: str


def link(target: str, folder: Path) -> PageLink:
    """From a page in `folder` to a file or folder, by the name that the user gave it."""
    return PageLink(target, quote(os.path.relpath(Path(target).resolve(), folder.resolve())))


def page_of(model_file: str, folder: Path) -> PageLink | None:
    """To the page beside a model file; None where there is none, or where it is this one."""
    beside = Path(model_file).parent
    if beside.resolve() == folder.resolve() or not (beside / PAGE).is_file():
        return None
    return link(str(beside / PAGE), folder)


def rendered(package: str, figures: Mapping[str, Any], **content: Any) -> str:
    """page.html of a package with its figures, plotly descriptions by id, and other content.

    A name that the page uses and the content lacks raises `jinja2.UndefinedError`.
    """
    environment = Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html").render(
        plotly=Markup(_packed_plotly()),
        figures=Markup(_packed(json.dumps(figures, separators=(",", ":"), allow_nan=False))),
        **content,
    )


def part(package: str, name: str) -> Markup:
    """A style or script among the files of a package."""
    return Markup((files(package) / name).read_text(encoding="utf-8"))


@cache
def _packed_plotly() -> str:
    """plotly.js: 2 MB instead of 5, and its addresses stay out of the page."""
    return _packed(get_plotlyjs())


def _packed(text: str) -> str:
    """gzip in base64, which page.js unpacks; safe inside a script element."""
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()
