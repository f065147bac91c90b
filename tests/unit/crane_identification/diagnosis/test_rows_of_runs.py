"""How samples become rows, beside numpy's own convolution."""

import numpy as np
import pytest
from scipy import signal

from crane_identification.diagnosis.fit.runs import acting, thinned
from crane_identification.signals.decimate import PASS_BAND, decimation_rows

CYCLES, STOP_BAND = 12, 6.0  # rows that the response is long, and the shape of its window


@pytest.mark.parametrize("samples", [30, 500, 4001])
@pytest.mark.parametrize("factor", [2, 7, 20])
def test_rows_are_samples_of_the_filtered_signal(samples: int, factor: int) -> None:
    taps = CYCLES * factor + 1
    response = signal.firwin(taps, PASS_BAND / factor, window=("kaiser", STOP_BAND))
    values = np.random.default_rng(factor).normal(size=(samples, 2, 3))
    kept, half = decimation_rows(samples, factor), len(response) // 2
    columns = values.reshape(samples, -1).T
    expected = np.stack([np.convolve(one, response)[half + kept] for one in columns], axis=1)
    np.testing.assert_allclose(
        thinned(values, factor), expected.reshape(len(kept), 2, 3), rtol=0.0, atol=1e-12
    )


@pytest.mark.parametrize("samples", [0, 5, 64, 1000])
def test_columns_that_act_hold_something(samples: int) -> None:
    columns = np.zeros((samples, 3, 4))
    if samples:
        columns[-1, 0, 1], columns[0, 2, 3], columns[samples // 2, 1, 0] = 1e-300, -1.0, np.nan
    assert np.array_equal(acting(columns), columns.any(axis=0))
