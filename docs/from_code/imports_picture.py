"""The picture of imports for the page on the architecture: packages, and the components of each.

In SVG that goes into the page, so that it takes the page's colours, light and dark.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from from_code.imports import Imports, floors, is_up, package_of

ROOT = Path(__file__).resolve().parents[2]
LETTER, HEIGHT, GAP = 6.6, 22.0, 12.0  # px: width of a letter, height of a box, between boxes
FLOOR = 50.0  # px, from one row of boxes to the next
WIDTH = 400.0  # px, of a panel at most
PAGE = """```{{raw}} html
<div class="imports">
{overview}
{panels}
</div>
```
"""


class Box(NamedTuple):
    """A name in a frame, by its centre."""

    name: str
    x: float
    y: float

    @property
    def width(self) -> float:
        """With a margin."""
        return _width(self.name)


def pages() -> dict[str, str]:
    """Included files of the page on the architecture."""
    found = Imports.of(ROOT)
    panels = (panel(package, found.within(package)) for package in reversed(found.packages))
    return {"imports.txt": PAGE.format(overview=overview(found), panels="\n".join(panels))}


def overview(found: Imports) -> str:
    """The packages, and how many arrows lead from components of one to components of another."""
    arrows = Counter(
        (package, package_of(other))
        for package in found.packages
        for _, other in found.leaving(package)
    )
    below = {one: {b for a, b in arrows if a == one} for one in found.packages}
    rows = _in_rows(floors(below), 2.0 * WIDTH)
    boxes = _placed([[(one, one) for one in row] for row in rows], 2.0 * WIDTH, 1.6 * FLOOR)
    lines = "".join(_line(boxes[a], boxes[b], is_up(a, b), str(n)) for (a, b), n in arrows.items())
    return _svg("Arrows between components, by package", lines, boxes, 2.0 * WIDTH)


def panel(package: str, components: Mapping[str, set[str]]) -> str:
    """The components of a package by floors, with arrows between them."""
    rows = _in_rows(floors(components), WIDTH - GAP, len(package) + 1)
    named = [[(component, component[len(package) + 1 :]) for component in row] for row in rows]
    boxes = _placed(named, WIDTH, FLOOR)
    lines = "".join(
        _line(boxes[a], boxes[b], False) for a in components for b in sorted(components[a])
    )
    return _svg(package, lines, boxes, WIDTH)


def _in_rows(height: Mapping[str, int], width: float, cut: int = 0) -> list[list[str]]:
    """Names by floor, highest first, in rows that are not wider than that; names are shortened by
    `cut` letters.
    """
    rows: list[list[str]] = []
    for floor in sorted(set(height.values()), reverse=True):
        row: list[str] = []
        for name in sorted(name for name, own in height.items() if own == floor):
            if sum(_width(one[cut:]) + GAP for one in (*row, name)) > width:
                rows.append(row)
                row = []
            row.append(name)
        rows.append(row)
    return rows


def _placed(rows: Sequence[Sequence[tuple[str, str]]], width: float, step: float) -> dict[str, Box]:
    """Boxes in rows: what is not in the middle of one row is seldom in the way of the next."""
    boxes = {}
    for number, row in enumerate(rows):
        free = width - sum(_width(name) for _, name in row)
        gap = free / (len(row) + 1)
        x = gap if len(row) > 1 else gap * (0.6, 1.4)[number % 2]
        for key, name in row:
            boxes[key] = Box(name, x + _width(name) / 2.0, HEIGHT + number * step)
            x += _width(name) + gap
    return boxes


def _width(name: str) -> float:
    return LETTER * len(name) + GAP


def _line(start: Box, end: Box, up: bool, count: str = "") -> str:
    """From the lower edge of a box to the upper one of another, or the other way."""
    way = HEIGHT / 2.0 if end.y > start.y else -HEIGHT / 2.0
    x, y, to_x, to_y = start.x, start.y + way, end.x, end.y - way
    bend = (to_y - y) / 2.0
    kind = "up" if up else "arrow"
    path = f"M{x:.1f} {y:.1f} C{x:.1f} {y + bend:.1f} {to_x:.1f} {to_y - bend:.1f} "
    line = f'<path class="{kind}" d="{path}{to_x:.1f} {to_y:.1f}"/>'
    head = to_y - (5.0 if way > 0.0 else -5.0)
    line += (
        f'<path class="{kind} head" d="M{to_x - 3.0:.1f} {head:.1f} L{to_x + 3.0:.1f} {head:.1f} '
        f'L{to_x:.1f} {to_y:.1f} Z"/>'
    )
    if count:
        line += (
            f'<text class="count" x="{0.8 * x + 0.2 * to_x:.1f}" y="{y + 0.22 * (to_y - y):.1f}">'
            f"{count}</text>"
        )
    return line


def _svg(title: str, lines: str, boxes: Mapping[str, Box], width: float) -> str:
    height = max(box.y for box in boxes.values()) + HEIGHT
    return (
        f'<figure><figcaption>{escape(title)}</figcaption><svg viewBox="0 0 {width:.0f} '
        f'{height:.0f}" width="{width:.0f}" role="img" aria-label="{escape(title)}">{lines}'
        f"{''.join(map(_box, boxes.values()))}</svg></figure>"
    )


def _box(box: Box) -> str:
    return (
        f'<rect x="{box.x - box.width / 2.0:.1f}" y="{box.y - HEIGHT / 2.0:.1f}" '
        f'width="{box.width:.1f}" height="{HEIGHT:.0f}" rx="3"/>'
        f'<text x="{box.x:.1f}" y="{box.y:.1f}">{escape(box.name)}</text>'
    )
