"""The driver, without ROS, on buses where several things go wrong at once."""

import numpy as np
import pytest
from unit.crane_driver.can.traffic import any_bus
from unit.crane_driver.driven import Driven


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_that_the_driver_publishes_is_of_two_cycles(seed: int) -> None:
    """`make bench` does so with two million frames."""
    rng, driven = np.random.default_rng(seed), Driven()
    driven.drive(any_bus(rng), rng, 300)
    assert not driven.wrong
    assert driven.found["positions"] > 10
    assert driven.found["pressures"] > 10
