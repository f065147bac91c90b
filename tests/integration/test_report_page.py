"""The report in a real browser: every figure drawn, nothing loaded, nothing complained about."""

import pytest
from integration.browser import Opened, installed, run
from integration.browser import opened as open_page
from unit.crane_identification.report.synthetic_crane import TRUE_VALUES, crane_model, record_crane

from crane_identification import Options, fit
from crane_identification.online.replay import recursion
from crane_identification.preparation.prepare import prepare
from crane_identification.report import page
from crane_identification.report.content import IdentificationReport, Provenance
from crane_identification.validation.force_validation import compare


@pytest.fixture(scope="module")
def browser() -> str:
    return installed()


@pytest.fixture(scope="module")
def report() -> IdentificationReport:
    training = (record_crane("train", 0),)
    fitted = fit(crane_model(), training)
    data = tuple(prepare(fitted.model, record_crane("validate", 9), Options()))
    return IdentificationReport(
        fit=fitted,
        options=Options(),
        training=training,
        validations=tuple(compare(fitted.model, p, fitted.decimation) for p in data),
        warnings=("A warning.",),
        provenance=Provenance.of("2012-06-01", ["identify"], "crane.yaml"),
        true_values=TRUE_VALUES,
        recursive=recursion(crane_model(), training),
    )


@pytest.fixture(scope="module")
def opened(
    browser: str, report: IdentificationReport, tmp_path_factory: pytest.TempPathFactory
) -> Opened:
    return open_page(browser, tmp_path_factory.mktemp("browser"), page.render(report))


def test_nothing_is_said_on_the_console(opened):
    assert opened.console == []


def test_every_figure_is_drawn(opened):
    plots = opened.plots()
    settling, references, recordings, averages, validations = 5, 3, 3, 3, 3
    assert len(plots) == settling + references + recordings + averages + validations
    for plot in plots:
        key = plot.attributes["id"]
        lines = [path.attributes.get("d") or "" for path in plot.find("path", class_="js-line")]
        assert len(lines) >= (2 if key.startswith("reference") else 3), key
        assert all(line.startswith("M") for line in lines), key
        titles = [text.text for text in plot.find("text", class_="annotation-text")]
        assert all("[" in title for title in titles), key


def test_colours_of_the_page_reach_the_figures(opened):
    (plot,) = opened.page.find("div", id="validation-0-telescope")
    strokes = [path.attributes.get("style") or "" for path in plot.find("path", class_="js-line")]
    measured, model = "rgb(28, 28, 26)", "rgb(194, 40, 31)"
    assert any(measured in style for style in strokes)
    assert any(model in style for style in strokes)
    assert plot.find("path", class_="js-fill")


def test_every_row_of_the_tables_is_there(opened):
    rows = {
        kind: len(opened.page.find("table", class_=kind)[0].find("td", class_="strong"))
        for kind in ("parameters", "errors", "entries", "recursive", "recursive-errors")
    }
    assert rows == {
        "parameters": 20,
        "errors": 3,
        "entries": 8,
        "recursive": 20,
        "recursive-errors": 3,
    }
    (sources,) = opened.page.find("table", class_="sources")
    assert len(sources.find("tr")) == 1 + 2


def test_nothing_on_the_open_page_points_to_a_network(opened):
    for element in opened.page:
        for name in ("src", "href", "xlink:href"):
            address = element.attributes.get(name) or ""
            assert not address.startswith(("http", "//")), (element.tag, address)


def test_it_prints(browser, report, tmp_path):
    (tmp_path / "report.html").write_text(page.render(report), encoding="utf-8")
    pdf = tmp_path / "report.pdf"
    uri = (tmp_path / "report.html").as_uri()
    run(browser, tmp_path, "--no-pdf-header-footer", f"--print-to-pdf={pdf}", uri)
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF")
    assert 4 <= content.count(b"/Type /Page\n") <= 12
