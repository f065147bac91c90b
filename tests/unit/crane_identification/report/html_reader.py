"""The page as a tree, read by Python's own parser: tables, text, and whether tags match."""

import base64
import gzip
import json
from collections.abc import Iterator
from html.parser import HTMLParser

VOID = {"meta", "link", "br", "hr", "img", "input"}


class Element:
    def __init__(self, tag: str, attributes: dict[str, str | None]):
        self.tag, self.attributes = tag, attributes
        self.children: list[Element | str] = []

    def __iter__(self) -> Iterator["Element"]:
        """This element and all below it, in the order of the page."""
        yield self
        for child in self.children:
            if isinstance(child, Element):
                yield from child

    @property
    def text(self) -> str:
        parts = (c if isinstance(c, str) else c.text for c in self.children)
        return " ".join("".join(parts).split())

    def find(self, tag: str, **attributes: str) -> list["Element"]:
        """Elements below of that tag; `class_` is contained in the class, others are equal."""
        class_ = attributes.pop("class_", None)
        return [
            e
            for e in self
            if e.tag == tag
            and (class_ is None or class_ in (e.attributes.get("class") or "").split())
            and all(e.attributes.get(k) == v for k, v in attributes.items())
        ]


class _Builder(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open = [Element("", {})]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, dict(attrs))
        self.open[-1].children.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open[-1].children.append(Element(tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open[-1].tag == tag, f"</{tag}> closes <{self.open[-1].tag}> at {self.getpos()}"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        self.open[-1].children.append(data)


def read_html(html: str) -> Element:
    """The root of the page; fails where an end tag does not match the element it ends."""
    builder = _Builder()
    builder.feed(html)
    builder.close()
    assert len(builder.open) == 1, f"<{builder.open[-1].tag}> is not closed"
    return builder.open[0]


def figure_descriptions(page: Element) -> dict[str, dict]:
    (script,) = page.find("script", id="figures")
    return json.loads(gzip.decompress(base64.b64decode(script.text)))


def number(text: str) -> float:
    """A printed number, with true minus sign, and a power of ten or a percent sign behind it."""
    text = text.replace("\u2212", "-").removeprefix("±").strip()
    share = 0.01 if text.endswith("%") else 1.0
    mantissa, _, power = text.removesuffix("%").strip().partition("·10")
    exponent = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return float(mantissa) * 10.0 ** int(exponent or 0) * share
