import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from crane_identification.report.html import thin

CURVES = arrays(float, st.integers(2, 400), elements=st.floats(-1e6, 1e6) | st.just(float("nan")))


@given(CURVES, st.integers(10, 60))
def test_every_column_of_pixels_keeps_its_extremes(values, points):
    time = np.arange(len(values)) / 7.0
    kept = thin(time, values, points)
    assert (np.diff(kept) > 0).all()
    bins = (points - 2) // 2
    column = np.minimum((bins * time / time[-1]).astype(int), bins - 1)
    for value in np.unique(column[np.isfinite(values)]):
        everything = values[(column == value) & np.isfinite(values)]
        drawn = values[kept[column[kept] == value]]
        assert np.nanmin(drawn) == everything.min()
        assert np.nanmax(drawn) == everything.max()


@given(arrays(float, st.integers(2, 400), elements=st.floats(-1e6, 1e6)), st.integers(10, 60))
def test_no_more_points_than_asked_for_and_both_ends(values, points):
    kept = thin(np.arange(len(values)) / 7.0, values, points)
    assert len(kept) <= points
    assert kept[0] == 0
    assert kept[-1] == len(values) - 1


def test_a_gap_stays_a_gap():
    values = np.sin(np.arange(1000.0))
    values[400:600] = np.nan
    kept = thin(np.arange(1000.0), values, 50)
    assert np.isnan(values[kept]).any()
    assert not np.isin(kept, np.arange(402, 598)).any()
