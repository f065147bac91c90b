"""Small drawings inside table rows, as inline SVG: seen at a glance, and printed as they are."""

import re
from math import isfinite, log10

from markupsafe import Markup, escape

from crane_identification.report.findings import UNCERTAIN

# Names of parameters and quantities as mathematics is set, in HTML.

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_INDEXED = re.compile(r"(?P<base>[A-Za-z]+)_(?P<body>[A-Za-z]+)")


def parameter_symbol(name: str) -> Markup:
    """A parameter without its joint: "S_FL_along" -> S with index, "df_c.inner_boom" -> Δf_c."""
    base, _, index = name.partition(".")[0].partition("_")
    if len(base) == 2 and base[0] == "d":
        base = "Δ" + base[1]
    return _quantity(base, index.replace("_", " "))


def entry_symbol(formula: str) -> Markup:
    """An entry of (9): "m_FL rcm_FL^2 + Izz_FL" -> products of symbols with indices."""
    html, end = Markup(), 0
    for match in _INDEXED.finditer(formula):
        base, index = match["base"], match["body"]
        if len(base) > 1:  # rcm, Izz: a letter and the first part of its index
            base, index = base[0], f"{base[1:]},{index}"
        html += escape(_typeset(formula[end : match.start()])) + _quantity(base, index)
        end = match.end()
    return html + escape(_typeset(formula[end:]))


def prose(text: str) -> str:
    """Quantities in running text: "a2^2", "q4 = 0" -> "a₂²", "q₄ = 0", never broken."""
    return _typeset(re.sub(r"\b([adqr])(\d)", _lowered, text)).replace(" = ", "\u00a0=\u00a0")


def _lowered(match: re.Match[str]) -> str:
    return match[1] + match[2].translate(_SUBSCRIPTS)


def _typeset(text: str) -> str:
    return re.sub(r"\br7\b", "r₇", text).replace("^2", "²")


def _quantity(base: str, index: str) -> Markup:
    html = Markup("<i>{}</i>").format(base) if len(base.strip("Δ")) == 1 else escape(base)
    return html + Markup("<sub>{}</sub>").format(index) if index else html


WIDTH, HEIGHT = 132, 14  # px
_LEAST, _MOST = 1e-3, 1.0  # ends of the logarithmic scale of relative standard deviations
_SIGMAS = 5.0  # half the scale of deviations


def relative_sigma_mark(share: float) -> Markup:
    """A bar on a logarithmic scale from 0.1 to 100 %, with a line at 10 %."""
    bar = _logarithmic(share) if isfinite(share) else 0.0
    limit = _logarithmic(UNCERTAIN)
    return _svg(
        _rect("track", 0, WIDTH) + _rect("spread", 0, bar) + _line("limit", limit),
        f"relative standard deviation {share:.2g}, limit {UNCERTAIN}",
    )


def deviation_mark(sigmas: float) -> Markup:
    """Estimate and its one-sigma interval about the planted value, over ±5 σ; ±3 σ shaded.

    An estimate beyond the scale is an arrow at its end.
    """
    if not isfinite(sigmas):
        return Markup()
    middle = HEIGHT / 2
    axis = Markup('<line class="axis" x1="0" x2="{}" y1="{}" y2="{}"/>')
    return _svg(
        _rect("track", _sigma(-3), _sigma(3))
        + axis.format(WIDTH, middle, middle)
        + _line("planted", _sigma(0))
        + (_dot(sigmas, middle) if abs(sigmas) <= _SIGMAS else _arrow(sigmas, middle)),
        f"estimate {sigmas:+.1f} standard deviations from the planted value",
    )


def error_mark(error: float, floor: float, largest: float) -> Markup:
    """Held-out error as a bar from 0 to `largest`, with a line at the noise floor."""
    scale = WIDTH / largest if largest > 0 else 0.0
    bar = error * scale if isfinite(error) else 0.0
    limit = _line("limit", floor * scale) if isfinite(floor) else Markup()
    return _svg(
        _rect("track", 0, WIDTH) + _rect("bar", 0, bar) + limit,
        f"held-out error {error:.3g}, noise floor {floor:.3g}",
    )


def _logarithmic(share: float) -> float:
    clipped = max(_LEAST, min(_MOST, share))
    return WIDTH * log10(clipped / _LEAST) / log10(_MOST / _LEAST)


def _sigma(sigmas: float) -> float:
    return WIDTH * (0.5 + 0.5 * sigmas / _SIGMAS)


def _rect(kind: str, left: float, right: float) -> Markup:
    return Markup('<rect class="{}" x="{:.1f}" width="{:.1f}" y="3" height="{}"/>').format(
        kind, left, max(right - left, 0), HEIGHT - 6
    )


def _line(kind: str, x: float) -> Markup:
    return Markup('<line class="{}" x1="{:.1f}" x2="{:.1f}" y1="0" y2="{}"/>').format(
        kind, x, x, HEIGHT
    )


def _svg(content: Markup, words: str) -> Markup:
    return Markup(
        '<svg class="mark" width="{}" height="{}" viewBox="0 0 {} {}" preserveAspectRatio="none" '
        'role="img" aria-label="{}">{}</svg>'
    ).format(WIDTH, HEIGHT, WIDTH, HEIGHT, words, content)


def _dot(sigmas: float, y: float) -> Markup:
    low, high = (_sigma(max(-_SIGMAS, min(_SIGMAS, sigmas + side))) for side in (-1, 1))
    return Markup(
        '<line class="whisker" x1="{:.1f}" x2="{:.1f}" y1="{}" y2="{}"/>'
        '<circle class="dot" cx="{:.1f}" cy="{}" r="3.2"/>'
    ).format(low, high, y, y, _sigma(sigmas), y)


def _arrow(sigmas: float, y: float) -> Markup:
    tip, back = (WIDTH, WIDTH - 8) if sigmas > 0 else (0, 8)
    return Markup('<path class="dot" d="M{},{}L{},{}V{}Z"/>').format(tip, y, back, y - 4, y + 4)
