import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from unit.crane_identification.report.html_reader import number

from crane_identification.notation import (
    is_determined,
    listed,
    percent,
    plain,
    shown,
    unit,
    with_uncertainty,
)


@pytest.mark.parametrize(
    ("value", "std_dev", "shown"),
    [
        (1523.4, 12.3, ("1523", "12")),
        (15234.0, 1230.0, ("15200", "1200")),
        (-0.0123, 0.00456, ("−0.0123", "0.0046")),
        (0.04, 0.0996, ("0.04", "0.10")),
        (3.0, 0.1, ("3.00", "0.10")),
        (0.0, 2.5, ("0.0", "2.5")),
        (-0.001, 2.5, ("0.0", "2.5")),
        (0.0600033, 7.1e-6, ("0.0600033", "0.0000071")),
        (1.234e-9, 5.6e-11, ("1.234·10⁻⁹", "0.056·10⁻⁹")),
        (1.5e9, 2.5e7, ("1.500·10⁹", "0.025·10⁹")),
        (12.3456, 0.0, ("12.35", "–")),
        (12.3456, math.nan, ("12.35", "–")),
        (math.nan, math.nan, ("–", "–")),
    ],
)
def test_value_ends_where_its_standard_deviation_does(value, std_dev, shown):
    assert with_uncertainty(value, std_dev) == shown


@pytest.mark.parametrize(
    ("value", "std_dev", "minimum", "printed"),
    [
        (95.1, 0.11, 0.0, ("95.10", "0.11", "0.12\u202f%")),
        (98.9, 92.5, 0.0, ("not determined, at most 284", "92", "–")),
        (-5.8e-11, 3.2, 0.0, ("at its bound 0", "3.2", "–")),
        (-30.0, 3.2, 0.0, ("−30.0", "3.2", "10.67\u202f%")),  # not physical, and certain of it
        (0.5, 3.2, None, ("0.5", "3.2", "> 100\u202f%")),  # an asymmetry may well be zero
        (5e-14, 3.2, None, ("0.0", "3.2", "> 100\u202f%")),
        (math.nan, math.nan, 0.0, ("not determined", "–", "–")),
    ],
)
def test_what_data_do_not_determine_is_no_number(value, std_dev, minimum, printed):
    assert shown(value, std_dev, minimum) == printed
    assert is_determined(value, std_dev, minimum) is not printed[0].startswith("not")


@given(
    st.floats(-1e12, 1e12, allow_subnormal=False),
    st.floats(1e-12, 1e12, allow_subnormal=False),
)
@example(9.9999e6, 9.96)
def test_rounding_stays_within_a_twentieth_of_the_standard_deviation(value, std_dev):
    shown, shown_std_dev = with_uncertainty(value, std_dev)
    assert number(shown_std_dev) == pytest.approx(std_dev, rel=0.051)
    assert abs(number(shown) - value) <= 0.0501 * std_dev + 1e-12 * abs(value)


@given(st.floats(-1e15, 1e15).filter(lambda x: abs(x) > 1e-15), st.integers(1, 6))
def test_plain_numbers_keep_their_significant_digits(value, digits):
    assert number(plain(value, digits)) == pytest.approx(value, rel=0.501 * 10.0 ** (1 - digits))


def test_shares_units_and_lists():
    assert [percent(x) for x in (0.01234, 1.5, math.nan)] == ["1.23\u202f%", "150\u202f%", "–"]
    assert unit("N m s/rad") == "N\u202fm\u202fs/rad"
    assert unit("kg m2") == "kg\u202fm²"
    assert [listed(words) for words in (["a"], ["a", "b"], ("a", "b", "c"))] == [
        "a",
        "a and b",
        "a, b and c",
    ]
    assert plain(math.inf) == "∞"
