from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.report.html_reader import number

from crane_identification.report import tables
from crane_identification.report.content import IdentificationReport


def with_estimate(report: IdentificationReport, **changes) -> IdentificationReport:
    return replace(
        report, fit=replace(report.fit, estimate=replace(report.fit.estimate, **changes))
    )


def test_entries_of_9_follow_from_the_base_parameters(report):
    estimate, machine = report.fit.estimate, report.fit.model.machine
    j_fl, s_fl, n_fl, j_sl, s_sl, n_sl, m_tl, s_tl = estimate.values[:8]
    dh = machine.as_planar()
    m_sl = n_sl / dh.telescope_offset - m_tl
    carried = m_sl + m_tl
    expected = [
        j_fl - dh.inner_boom_length**2 * carried,
        s_sl - s_tl,
        m_sl,
        s_tl,
        m_tl,
        j_sl,
        s_fl - dh.inner_boom_length * carried,
        n_fl,
    ]
    rows = tables.report_entries(report)
    for row, value in zip(rows, expected, strict=True):
        assert abs(number(row.value) - value) <= 0.051 * number(row.std_dev)


def test_standard_deviations_of_9_are_those_of_draws_from_the_estimate(report):
    estimate, dh = report.fit.estimate, report.fit.model.machine.as_planar()
    draws = np.random.default_rng(0).multivariate_normal(
        np.zeros(8), estimate.covariance[:8, :8], 20000
    )
    m_sl = draws[:, 5] / dh.telescope_offset - draws[:, 6]
    moment = draws[:, 1] - dh.inner_boom_length * (m_sl + draws[:, 6])
    rows = tables.report_entries(report)
    assert number(rows[2].std_dev) == pytest.approx(m_sl.std(), rel=0.08)
    assert number(rows[6].std_dev) == pytest.approx(moment.std(), rel=0.08)


def test_an_undetermined_parameter_takes_only_its_own_entries_along(report):
    estimate = report.fit.estimate
    values, covariance = estimate.values.copy(), estimate.covariance.copy()
    inertia = estimate.names.index("J_FL")
    values[inertia] = np.nan
    covariance[inertia] = covariance[:, inertia] = np.nan
    partly = with_estimate(
        report, values=values, covariance=covariance, std_devs=np.sqrt(np.diag(covariance))
    )
    whole = tables.report_entries(report)
    assert [row.value for row in tables.report_entries(partly)] == [
        "–",
        *(row.value for row in whole[1:]),
    ]
    row = tables.parameter_groups(partly)[0].rows[0]
    assert (row.value, row.std_dev, row.doubtful) == ("not determined", "–", True)


def test_parameters_stand_in_the_order_of_the_model_under_family_and_joint(report):
    groups = tables.parameter_groups(report)
    assert [group.heading for group in groups] == [
        "Rigid body",
        "Friction, inner boom",
        "Friction, outer boom",
        "Friction, telescope",
    ]
    names = [row.name for group in groups for row in group.rows]
    assert names == [parameter.name for parameter in report.fit.model.parameters]


def test_symbols_are_set_with_indices(report):
    symbols = {r.name: str(r.symbol) for g in tables.parameter_groups(report) for r in g.rows}
    assert symbols["S_FL_along"] == "<i>S</i><sub>FL along</sub>"
    assert symbols["df_c.telescope"] == "<i>Δf</i><sub>c</sub>"
    entry = str(tables.report_entries(report)[0].symbol)
    assert entry == "<i>m</i><sub>FL</sub> <i>r</i><sub>cm,FL</sub>² + <i>I</i><sub>zz,FL</sub>"


def test_condition_numbers_name_their_columns(report):
    rows = tables.conditioning(report)
    assert [row.columns for row in rows] == [
        "all 20 columns",
        "rigid body, 8 columns",
        "friction, 12 columns",
    ]
    inertial = report.fit.rows.stacked[:, :8]
    assert number(rows[1].raw) == pytest.approx(np.linalg.cond(inertial), rel=6e-3)
    assert number(rows[0].raw) > number(rows[1].raw)


def test_excitation_counts_every_used_row(report):
    rows = tables.excitation(report)
    assert sum(row.rows for row in rows) == report.fit.estimate.samples
