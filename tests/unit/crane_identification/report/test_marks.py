import math
import re

import pytest

from crane_identification.report import tables as marks


def place(mark: str, kind: str, coordinate: str) -> float:
    found = re.search(rf'class="{kind}" {coordinate}="([-\d.]+)"', mark)
    assert found, mark
    return float(found[1])


@pytest.mark.parametrize(("share", "width"), [(1e-4, 0.0), (1e-3, 0.0), (1.0, 1.0), (7.0, 1.0)])
def test_relative_sigma_is_logarithmic_and_stays_on_its_scale(share, width):
    mark = str(marks.relative_sigma_mark(share))
    bar = re.search(r'class="spread" x="0.0" width="([\d.]+)"', mark)
    assert bar and float(bar[1]) == pytest.approx(width * marks.MARK_WIDTH)


def test_the_limit_is_where_its_value_would_be():
    mark = str(marks.relative_sigma_mark(0.1))
    bar = re.search(r'class="spread" x="0.0" width="([\d.]+)"', mark)
    assert bar and float(bar[1]) == place(mark, "limit", "x1")


@pytest.mark.parametrize("sigmas", [-4.0, -1.5, 0.0, 2.0, 5.0])
def test_an_estimate_stands_as_far_off_as_it_is(sigmas):
    mark = str(marks.deviation_mark(sigmas))
    per_sigma = marks.MARK_WIDTH / 10
    off = place(mark, "dot", "cx") - place(mark, "true-value", "x1")
    assert off == pytest.approx(sigmas * per_sigma, abs=0.11)


@pytest.mark.parametrize(("sigmas", "tip"), [(-60.0, "M0,"), (60.0, f"M{marks.MARK_WIDTH},")])
def test_an_estimate_beyond_the_scale_is_an_arrow_at_its_end(sigmas, tip):
    mark = str(marks.deviation_mark(sigmas))
    assert "circle" not in mark
    assert f'class="dot" d="{tip}' in mark


def test_without_a_true_value_nothing_is_drawn():
    assert marks.deviation_mark(math.nan) == ""


def test_error_and_noise_floor_share_a_scale():
    mark = str(marks.error_mark(error=0.02, floor=0.01, largest=0.04))
    bar = re.search(r'class="bar" x="0.0" width="([\d.]+)"', mark)
    assert bar and float(bar[1]) == pytest.approx(marks.MARK_WIDTH / 2)
    assert place(mark, "limit", "x1") == pytest.approx(marks.MARK_WIDTH / 4)
