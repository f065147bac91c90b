"""Names of parameters and quantities as mathematics is set, in HTML."""

import re

from markupsafe import Markup, escape

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
