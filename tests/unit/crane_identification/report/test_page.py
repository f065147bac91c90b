import re
from dataclasses import replace

import pytest
from known_crane import known_model
from unit.crane_identification.report.html_reader import (
    Element,
    figure_descriptions,
    number,
    read_html,
)

from crane_identification.notation import NONE
from crane_identification.report import page, summary
from crane_identification.report.content import IdentificationReport


@pytest.fixture(scope="module")
def html(report: IdentificationReport) -> str:
    return page.render(report)


@pytest.fixture(scope="module")
def tree(html: str) -> Element:
    return read_html(html)


def test_the_file_is_small_and_loads_nothing(html, tree):
    assert len(html.encode()) < 6e6
    for element in tree:
        for name in ("src", "action", "data"):
            assert name not in element.attributes, (element.tag, name)
    for link in tree.find("a"):  # followed by a click alone, and to where the page lies
        assert not link.attributes["href"].startswith("/")
    (style,) = tree.find("style")
    assert "url(" not in style.text
    assert "@import" not in style.text
    assert "://" not in html


def test_links_inside_the_page_lead_somewhere(tree):
    ids = [e.attributes["id"] for e in tree if "id" in e.attributes]
    assert len(ids) == len(set(ids))
    for address in (link.attributes["href"] for link in tree.find("a")):
        assert not address.startswith("#") or address[1:] in ids
    (contents,) = tree.find("nav")
    listed = [link.attributes["href"][1:] for link in contents.find("a")]
    assert listed == [e.attributes["id"] for e in tree.find("section") if "id" in e.attributes]


def test_figures_have_words(tree):
    for place in tree.find("div", class_="plot"):
        assert place.attributes["role"] == "img"
        assert re.search(r"in .* over [0-9.]+ s; ", place.attributes["aria-label"])


def test_curves_differ_by_more_than_colour(tree):
    """On paper, colours may be greys."""
    styles = {}
    for figure in figure_descriptions(tree).values():
        for trace in figure["data"]:
            styles[trace["name"]] = trace["line"].get("dash", "solid")
    assert styles["measured"] == "solid"
    assert styles["model"] == "dash"
    assert styles["reference"] == "dot"


def test_parameters_are_those_of_the_summary(report, tree):
    for parameter in summary.summarize(report).parameters:
        (row,) = tree.find("tr", **{"data-name": parameter.name})
        (value,), (std_dev,) = row.find("td", class_="value"), row.find("td", class_="sigma")
        assert abs(number(value.text) - parameter.value) <= 0.051 * parameter.std_dev
        assert number(std_dev.text) == pytest.approx(parameter.std_dev, rel=0.051)
        (true_values,) = row.find("td", class_="true-value")
        true = report.true_values[parameter.name]
        assert abs(number(true_values.text) - true) <= 0.051 * parameter.std_dev
        assert row.find("circle", class_="dot")


def test_errors_are_those_of_the_summary(report, tree):
    result = summary.summarize(report).plain()
    (table,) = tree.find("table", class_="errors")
    rows = table.find("tbody")[0].find("tr")
    assert len(rows) == 3
    for row, joint in zip(rows, report.fit.model.joints, strict=True):
        shown = [number(cell.text) for cell in row.find("td", class_="number")]
        expected = [
            result[key][joint]
            for key in (
                "heldout_relative_error",
                "noise_floor",
                "heldout_relative_error_moving",
                "heldout_relative_error_without_gravity",
                "training_relative_error",
            )
        ]
        assert shown[:5] == pytest.approx(expected, abs=6e-5)
        assert shown[5] == pytest.approx(expected[0] / expected[4], rel=0.01)


def test_every_figure_has_its_place_and_its_curves(report, tree):
    described = figure_descriptions(tree)
    places = [e.attributes["id"] for e in tree.find("div", class_="plot")]
    assert sorted(places) == sorted(described)
    joints = report.fit.model.joints
    assert set(places) == {
        f"{kind}-{i}-{joint}"
        for kind in ("reference", "recording", "average", "validation")
        for i in range(2)
        for joint in joints
    }
    names = {key: [t["name"] for t in d["data"]] for key, d in described.items()}
    overlaid = ["measured", "reference"]
    assert names["recording-0-telescope"] == [*overlaid, *overlaid, "measured"]
    scatter = "scatter between periods"
    residual = [scatter, scatter, "measured − model"]
    assert names["validation-1-telescope"] == ["measured", "model", *residual]
    assert described["validation-0-inner_boom"]["layout"]["shapes"]


def test_every_colour_is_defined(tree):
    (style,) = tree.find("style")
    defined = set(re.findall(r"(--[\w-]+):", style.text))
    (figures,) = [figure_descriptions(tree)]
    used = set(re.findall(r'"(--[\w-]+)"', str(figures).replace("'", '"')))
    used |= set(re.findall(r"var\((--[\w-]+)\)", style.text))
    assert used - {"--swatch"} <= defined


def test_the_verdict_says_errors_noise_and_parameters(tree):
    (verdict,) = tree.find("p", id="verdict")
    assert "at the inner boom (noise" in verdict.text
    assert "All 20 parameters are determined" in verdict.text


def test_provenance_and_processing_are_complete(tree):
    (section,) = tree.find("section", id="provenance")
    for words in ("2012-06-01", "identify --out 'a b'", "crane.yaml", "train_1", "validate_11"):
        assert words in section.text
    (conditions,) = tree.find("section", id="conditions")
    for words in (
        "Fourier series",
        "mean of 3 periods of 12.00 s",
        "sign of the joint's velocity",
    ):
        assert words in conditions.text


def test_warnings_are_listed_or_their_absence_said(report, tree):
    def section(tree):
        return tree.find("section", id="warnings")[0]

    quiet = read_html(page.render(replace(report, warnings=())))
    assert section(quiet).text == "Warnings None."
    loud = read_html(page.render(replace(report, warnings=("one <b> & two", "three"))))
    assert [item.text for item in section(loud).find("li")] == ["one <b> & two", "three"]


def test_without_true_values_and_validation_nothing_is_left_open(report):
    tree = read_html(page.render(replace(report, true_values=None, validations=())))
    assert not tree.find("td", class_="true-value")
    assert not tree.find("table", class_="errors")
    assert not tree.find("section", id="validation")
    assert "has not been validated" in tree.find("p", id="verdict")[0].text
    assert "true value" not in tree.find("section", id="parameters")[0].text


def test_progress_counts_the_recordings(report):
    seen = []
    page.render(report, lambda phase, done: seen.append((phase, done)))
    assert seen == [("report", 0.5), ("report", 1.0)]


def test_hydraulics_stand_beside_true_values(report: IdentificationReport) -> None:
    """With as many digits as the estimate has; a dash where nothing was."""
    hydraulics = known_model().hydraulics
    assert hydraulics is not None and report.true_values is not None
    (joint, values), *_ = hydraulics.joints.items()
    known = replace(report.fit, model=replace(report.fit.model, hydraulics=hydraulics))
    true_values = {**report.true_values, f"lag.{joint}": 0.021}
    tree = read_html(page.render(replace(report, fit=known, true_values=true_values)))
    (table,) = tree.find("table", class_="hydraulics")
    assert "true value" in [cell.text for cell in table.find("th")]
    shown = [cell.text for cell in table.find("td", class_="true-value")]
    assert shown[list(values.values).index("lag")].startswith("0.021")
    assert {text for n, text in enumerate(shown) if n != list(values.values).index("lag")} == {NONE}
    without = read_html(page.render(replace(report, fit=known, true_values=None)))
    assert not without.find("table", class_="hydraulics")[0].find("td", class_="true-value")
