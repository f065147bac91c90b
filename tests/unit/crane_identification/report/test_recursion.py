"""The recursion in the report: its tables and the figures of how it settles."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.report.html_reader import figure_descriptions, number, read_html

from crane_identification.online.replay import Recursive
from crane_identification.report import page, summary
from crane_identification.report.content import IdentificationReport
from crane_identification.report.figures import (
    SETTLED_TIME_SHARE,
    recursive_errors,
    recursive_groups,
    settling_figures,
)

MOMENTS = 40


@pytest.fixture(scope="module")
def settled(report: IdentificationReport) -> IdentificationReport:
    """Wild at first, then within half a standard deviation of the fit."""
    estimate = report.fit.estimate
    time = np.arange(1.0, MOMENTS + 1)
    decay = np.where(time < SETTLED_TIME_SHARE * MOMENTS, 1e6, 0.5)[:, np.newaxis]
    values = estimate.values + decay * estimate.std_devs
    std_devs = np.tile(estimate.std_devs, (MOMENTS, 1))
    values[0], std_devs[0] = np.nan, np.inf
    model = report.fit.model.with_estimate(values[-1], std_devs[-1], "recursion")
    return replace(report, recursive=Recursive(model, 1234, time, values, std_devs))


def test_without_it_there_is_nothing(report):
    assert recursive_groups(report) == []
    assert recursive_errors(report) == []
    assert settling_figures(report) == []
    assert summary.summarize(report).recursive is None
    assert "Convergence" not in page.render(report)


def test_rows_hold_both_estimates_and_how_far_they_are_apart(settled):
    rows = [row for group in recursive_groups(settled) for row in group.rows]
    estimate = settled.fit.estimate
    for row, value, std_dev in zip(rows, estimate.values, estimate.std_devs, strict=True):
        assert abs(number(row.value) - value - 0.5 * std_dev) <= 0.051 * std_dev
        assert abs(number(row.fitted) - value) <= 0.051 * std_dev
        assert number(row.difference) == pytest.approx(0.5 / np.sqrt(2), rel=0.02)


def test_errors_are_those_of_its_own_model_on_the_validation_recordings(settled):
    recursive, fitted = settled.recursive_held_out, settled.held_out
    assert (recursive.relative != fitted.relative).all()
    exact = replace(settled, recursive=replace(settled.recursive, model=settled.fit.model))
    np.testing.assert_allclose(exact.recursive_held_out.relative, fitted.relative, rtol=1e-12)


def test_a_panel_shows_what_has_settled_with_fit_and_true_value(settled):
    panels = [panel for figure in settling_figures(settled) for panel in figure.panels]
    estimate = settled.fit.estimate
    names = estimate.names
    for panel, name, value, std_dev in zip(
        panels, names, estimate.values, estimate.std_devs, strict=True
    ):
        low, high = panel.span
        assert (
            low
            < min(value, settled.true_values[name])
            <= max(value, settled.true_values[name])
            < high
        )
        off = abs(value - settled.true_values[name])
        assert high - low < 1.2 * (off + 5 * std_dev)  # not of the wild beginning
        assert {curve.name for curve in panel.curves} == {"recursion", "fit", "true value"}


def test_the_page_draws_it(settled):
    html = page.render(settled)
    tree = read_html(html)
    drawn = figure_descriptions(tree)
    keys = [figure.key for figure in settling_figures(settled)]
    assert set(keys) <= drawn.keys()
    first = drawn[keys[0]]["layout"]["yaxis"]
    assert first["autorange"] is False
    assert len(first["range"]) == 2
    (section,) = tree.find("section", id="recursion")
    assert "1234 rows" in section.text
