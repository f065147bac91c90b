"""The pictures of a diagnosis as plotly.js wants them; colours are names of CSS variables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from crane_identification.report.figure import FONT, axis_style

BEFORE, AFTER, FLOOR, BEST, EFFECT = "--before", "--after", "--scatter", "--planted", "--ink"
POINTS = 1500  # of a cloud; more do not show
BARS = 40  # of a histogram
BINS = 40  # of the line of means through a cloud
HEIGHT, LEGEND_HEIGHT = 240, 30  # px
PATTERNS = {BEFORE: "/", BEST: "x", FLOOR: "."}
DASHES = {BEFORE: "dot"}
"""Of bars and lines, to tell them apart where there is no colour, as on paper; others are plain."""
FAR = 5.0  # medians of the sizes of values, beyond which one does not stretch an axis


def description(data: Sequence[Mapping[str, Any]], x: str, y: str, **more: Any) -> dict[str, Any]:
    """Traces over one pair of axes with these titles."""
    legend = LEGEND_HEIGHT if len(data) > 1 else 0
    layout: dict[str, Any] = {
        "height": HEIGHT + legend,
        "margin": {"l": 58, "r": 12, "t": 26, "b": 42 + legend},
        "font": FONT,
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "showlegend": legend > 0,
        "legend": {
            "orientation": "h",
            "itemsizing": "constant",
            "x": 0,
            "y": -0.28,
            "yanchor": "top",
            "font": FONT,
        },
        "hoverlabel": {"font": {"family": "--sans", "size": 11}},
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "--soft", "activecolor": "--ink"},
        "xaxis": axis_style(title={"text": x, "standoff": 6, "font": FONT}),
        "yaxis": axis_style(),
        "annotations": [
            {
                "text": y,
                "x": 0,
                "xref": "paper",
                "xanchor": "left",
                "xshift": -52,
                "y": 1,
                "yref": "paper",
                "yanchor": "bottom",
                "yshift": 5,
                "showarrow": False,
                "font": {"size": 12, "color": "--ink", "family": "--sans"},
            }
        ],
    }
    for name, value in more.items():
        layout[name] = {**layout.get(name, {}), **value} if isinstance(value, dict) else value
    return {"data": list(data), "layout": layout}


def grouped_bars(
    names: Sequence[str], groups: Sequence[tuple[str, str, np.ndarray]], title: str
) -> dict[str, Any]:
    """Bars side by side for each name: groups of (label, colour, values) [percent or so]."""
    data = [
        {
            "type": "bar",
            "name": label,
            "x": list(names),
            "y": numbers(values),
            "marker": {
                "color": colour,
                "pattern": {
                    "shape": PATTERNS.get(colour, ""),
                    "fillmode": "overlay",
                    "fgcolor": "--paper",
                    "size": 6,
                    "solidity": 0.25,
                },
            },
            "hovertemplate": f"%{{x}}: %{{y:.3~r}}<extra>{label}</extra>",
        }
        for label, colour, values in groups
    ]
    return description(data, "", title, barmode="group", bargap=0.3)


def cloud(
    x: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    forwards: np.ndarray,
    titles: tuple[str, str],
) -> dict[str, Any]:
    """A residual before and after over what it follows, and what was added in each direction."""
    thin = np.unique(np.linspace(0, len(x) - 1, min(POINTS, len(x))).astype(int))
    order = thin[np.argsort(x[thin])]
    data = [
        points("before", BEFORE, "circle", x[order], before[order]),
        points("after", AFTER, "x", x[order], after[order]),
    ]
    for name, dash, which in (("forwards", "solid", forwards), ("backwards", "dash", ~forwards)):
        if which.any():
            centres, means = _binned(x[which], (before - after)[which])
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": f"added, {name}",
                    "x": numbers(centres),
                    "y": numbers(means),
                    "line": {"color": EFFECT, "width": 2, "dash": dash},
                    "hovertemplate": f"%{{y:.4~r}}<extra>added, {name}</extra>",
                }
            )
    return description(data, *titles)


def shape(
    knots: np.ndarray, values: np.ndarray, std_devs: np.ndarray, titles: tuple[str, str]
) -> dict[str, Any]:
    """Straight lines through values at knots, with their standard deviations."""
    line = {
        "type": "scatter",
        "mode": "lines+markers",
        "x": numbers(knots),
        "y": numbers(values),
        "error_y": {"type": "data", "array": numbers(std_devs), "color": EFFECT, "thickness": 1},
        "line": {"color": EFFECT, "width": 2},
        "hovertemplate": "%{x:.4~r}: %{y:.4~r}<extra></extra>",
    }
    return description([line], *titles)


def points(name: str, colour: str, symbol: str, x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    """A trace of small marks, without a line between them."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": numbers(x),
        "y": numbers(y),
        "marker": {"symbol": symbol, "color": colour, "size": 4, "opacity": 0.55},
        "hovertemplate": f"%{{y:.4~r}}<extra>{name}</extra>",
    }


def null_histogram(null: np.ndarray, threshold: float, score: float) -> dict[str, Any]:
    """The best score when nothing is missing, the threshold and the score of the effect."""
    top = 1.3 * max(score, threshold)
    edges = np.geomspace(max(float(null.min()), 1e-3), top, BARS + 1)
    counts = np.histogram(null, edges)[0] / len(null)
    high = float(counts.max())
    data = [
        {
            "type": "bar",
            "name": "nothing missing",
            "x": numbers(np.sqrt(edges[1:] * edges[:-1])),
            "y": numbers(counts),
            "width": numbers(np.diff(edges)),
            "marker": {"color": FLOOR},
            "hovertemplate": "%{x:.3~r}<extra>nothing missing</extra>",
        },
        mark("threshold", "--ink", threshold, (high, high), "dot", "top center"),
        mark("this effect", AFTER, score, (high, 0.7 * high), "solid", "middle left"),
    ]
    return description(
        data, "score (2 Δ log likelihood)", "share of bootstrap runs", xaxis={"type": "log"}
    )


def mark(
    name: str, colour: str, x: float, heights: tuple[float, float], dash: str, side: str
) -> dict[str, Any]:
    """An upright line: heights of its end and of its name, which stands on that side of it."""
    return {
        "type": "scatter",
        "mode": "lines+text",
        "name": name,
        "x": [x, x, x],
        "y": [0.0, heights[0], heights[1]],
        "text": ["", "", name],
        "textposition": side,
        "textfont": {**FONT, "color": colour},
        "cliponaxis": False,
        "line": {"color": colour, "width": 2, "dash": dash},
        "hovertemplate": f"%{{x:.4~r}}<extra>{name}</extra>",
    }


def span(values: np.ndarray) -> tuple[float, float] | None:
    """Ends of an axis that single values far beyond the others do not stretch; None for all."""
    finite = values[np.isfinite(values)]
    reach = FAR * float(np.median(np.abs(finite))) if len(finite) else 0.0
    if not reach or np.abs(finite).max() <= reach:
        return None
    inside = finite[np.abs(finite) <= reach]
    cut = [reach * np.sign(value) for value in finite if abs(value) > reach]
    return min(0.0, *inside, *cut), max(0.0, *inside, *cut)


def fold_bars(names: Sequence[str], gains: np.ndarray, what: str) -> dict[str, Any]:
    """What the effect gains on each fold; `what` these are."""
    labels = [str(number + 1) for number in range(len(names))]
    data = [
        {
            "type": "bar",
            "x": labels,
            "y": numbers(gains),
            "customdata": list(names),
            "marker": {"color": [AFTER if gain > 0 else BEFORE for gain in gains]},
            "hovertemplate": "%{customdata}: %{y:.4~r}<extra></extra>",
        }
    ]
    ends = span(gains)
    return description(
        data,
        what,
        "gain (2 Δ log likelihood)",
        xaxis={"type": "category"},
        yaxis={} if ends is None else {"range": list(ends), "autorange": False},
    )


def curves(
    time: np.ndarray, series: Sequence[tuple[str, str, np.ndarray]], title: str
) -> dict[str, Any]:
    """Lines over time."""
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": name,
            "x": numbers(time),
            "y": numbers(values),
            "line": {"color": colour, "width": 1.3, "dash": DASHES.get(colour, "solid")},
            "hovertemplate": f"%{{y:.4~r}}<extra>{name}</extra>",
        }
        for name, colour, values in series
    ]
    return description(data, "t [s]", title)


def numbers(values: np.ndarray) -> list[float | None]:
    """Five significant digits; null where there is no number."""
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in np.asarray(values, dtype=float)]


def _binned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres of bins over x (n,), and the mean of y (n,) in each; empty bins are left out."""
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    means = np.bincount(place, y, BINS) / np.maximum(count, 1)
    there = count > 0
    return ((edges[1:] + edges[:-1]) / 2.0)[there], means[there]
