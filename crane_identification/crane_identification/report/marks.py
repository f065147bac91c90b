"""Small drawings inside table rows, as inline SVG: seen at a glance, and printed as they are."""

from math import isfinite, log10

from markupsafe import Markup

from crane_identification.report.findings import UNCERTAIN

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
