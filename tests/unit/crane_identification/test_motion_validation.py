"""Windows of simulated motion begin as the machine was then, memory and surroundings included."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.synthetic import crane_model

from crane_identification.validation.motion_validation import validate_motion
from crane_model import Model, Record, simulate
from crane_model.terms import presliding, single_axis
from crane_model.terms.friction import Viscous
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.term import Load, Setting

PERIOD = 0.005  # s


@pytest.fixture(scope="module")
def bristles() -> Model:
    terms = (
        single_axis.Inertia(joint="axis"),
        presliding.Presliding(joint="axis", travel=0.05),
    )
    return Model("bristles", Setting({"axis": "m"}, None), terms, np.array([10.0, 30.0]))


@pytest.fixture(scope="module")
def record(bristles: Model) -> Record:
    """10 s of the model itself, pushed to and fro."""
    time = PERIOD * np.arange(2001)
    drive = 60.0 * np.sin(3.0 * time)[:, None, None]
    motion = simulate(bristles, np.zeros((1, 1)), np.zeros((1, 1)), drive, PERIOD)
    return Record(
        joints=("axis",),
        time=time,
        position=motion.position[:, 0],
        velocity=motion.velocity[:, 0],
        acceleration=motion.acceleration[:, 0],
        force=drive[:, 0],
    )


def test_a_model_with_memory_repeats_its_own_motion(bristles: Model, record: Record) -> None:
    found = validate_motion(bristles, [record])
    assert found.windows == 20
    assert found.relative[0] < 1e-3


def test_a_model_that_cannot_move_says_why(bristles: Model, record: Record) -> None:
    """Without inertia, with less than none, with friction that pushes; and without a window."""
    without = bristles.without_term(bristles.terms[0]).with_estimate(np.ones(1), np.ones(1), "")
    still = validate_motion(without, [record])
    assert still.windows == 0 and np.isnan(still.relative).all()
    assert "inertia of axis is 0 in the model" in still.reason
    less = bristles.with_estimate(np.array([-2.0, 30.0]), np.zeros(2), "")
    assert "inertia of axis is -2 in the model" in validate_motion(less, [record]).reason
    pushed = without.with_term(bristles.terms[0]).with_term(Viscous(joint="axis"))
    pushed = pushed.with_estimate(np.array([30.0, 1.0, -1e6]), np.zeros(3), "")
    assert "grown without bound" in validate_motion(pushed, [record]).reason
    assert "no window of 0.5 s" in validate_motion(bristles, [record.take(slice(50))]).reason
    assert not validate_motion(bristles, [record]).reason


def test_each_run_is_moved_with_its_own_load() -> None:
    """A model that carries a load in one run moves there as it did, and not in another run."""
    load = Payload(loads=(Load(runs=(7,)),))
    bare = crane_model()
    theta = np.append(bare.theta, 40.0)
    model = bare.with_term(load).with_estimate(theta, 0.0 * theta, "true values")
    q = np.tile([0.4, -1.2, 0.5], (201, 1))
    still = Record(bare.joints, PERIOD * np.arange(201), q, 0.0 * q, 0.0 * q, run=np.full(201, 7))
    loaded = replace(still, force=model.predict(still))
    assert validate_motion(model, [loaded]).position_rms.max() < 1e-6
    elsewhere = replace(loaded, run=np.full(201, 8))
    assert validate_motion(model, [elsewhere]).position_rms.max() > 1e-3


def test_a_model_that_forgets_does_not(bristles: Model, record: Record) -> None:
    """The same windows as recordings of their own: their states begin at rest, and that shows."""
    windows = [record.take(slice(k, k + 101)) for k in range(0, 2000, 100)]
    fresh = [replace(window, time=window.time - window.time[0]) for window in windows]
    assert validate_motion(bristles, fresh).relative[0] > 0.05
