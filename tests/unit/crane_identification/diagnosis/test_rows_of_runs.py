"""How samples become rows, beside numpy's own convolution."""

import numpy as np
import pytest
from scipy import signal

from crane_identification.diagnosis.evidence import Run
from crane_identification.signals.decimate import PASS_BAND_SHARE, decimation_rows
from crane_identification.signals.gated import thinned
from crane_model import Record

CYCLES, STOP_BAND = 12, 6.0  # rows that the response is long, and the shape of its window


@pytest.mark.parametrize("samples", [30, 500, 4001])
@pytest.mark.parametrize("factor", [2, 7, 20])
def test_rows_are_samples_of_the_filtered_signal(samples: int, factor: int) -> None:
    taps = CYCLES * factor + 1
    response = signal.firwin(taps, PASS_BAND_SHARE / factor, window=("kaiser", STOP_BAND))
    values = np.random.default_rng(factor).normal(size=(samples, 2, 3))
    kept, half = decimation_rows(samples, factor), len(response) // 2
    columns = values.reshape(samples, -1).T
    expected = np.stack([np.convolve(one, response)[half + kept] for one in columns], axis=1)
    np.testing.assert_allclose(
        thinned(values, factor), expected.reshape(len(kept), 2, 3), rtol=0.0, atol=1e-12
    )


@pytest.mark.parametrize("factor", [1, 7])
def test_channels_see_what_their_gate_lets_through(factor: int) -> None:
    random = np.random.default_rng(factor)
    columns, gate = random.normal(size=(900, 2, 3)), np.zeros((900, 4))
    gate[100:400, 0] = gate[640:650, 2] = gate[:, 3] = 1.0  # the second one sees nothing
    columns[:, 1, 2] = 0.0
    record = Record(("a", "b"), np.arange(900.0), *np.zeros((3, 900, 2)))
    run = Run("bag", 0, record, gate, factor)
    seen = np.concatenate([columns * gate[:, k : k + 2, np.newaxis] for k in (0, 2)], axis=1)
    np.testing.assert_allclose(run.filtered(columns), thinned(seen, factor), rtol=0.0, atol=1e-15)


def test_what_is_not_known_is_not_taken_for_nothing() -> None:
    columns = np.zeros((900, 1, 1))
    columns[450] = np.nan
    assert np.isnan(thinned(columns, 7)).any()
