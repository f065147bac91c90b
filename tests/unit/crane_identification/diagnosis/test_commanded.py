"""Motion from valve commands alone as a comparison of a diagnosis, and a valve effect hidden."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from known_crane import TOLD_LATE, known_model
from unit.crane_identification.hydraulics.valve_experiments import MACHINE, play, recorded

from crane_identification import Log, Options
from crane_identification.diagnosis.fit import Fitted, fitted
from crane_identification.diagnosis.flow import examine, load_usual
from crane_identification.diagnosis.gap import Commanded, commanded
from crane_identification.report.figures import commanded_figures
from crane_identification.thresholds import load_thresholds
from crane_model import Model
from crane_model.hydraulics import HydraulicValues
from crane_sim import load_simulated_crane
from crane_sim.effects.form import InjectedForm

HIDDEN = "outer_boom"
LATER = 3_600_000_000_000  # ns


@pytest.fixture(scope="module")
def model() -> Model:
    """As identified of the simulated crane, whose valves are told at once."""
    one, simulated = known_model(), load_simulated_crane()
    assert one.hydraulics is not None
    values = one.hydraulics.model_dump()
    for known in values["joints"].values():
        known["valve"]["lag"]["value"] -= TOLD_LATE
    pump = MACHINE.hydraulics.pump_flow
    values["supply"]["droop"]["value"] = simulated.supply.pump_droop / pump
    return replace(one, hydraulics=HydraulicValues.model_validate(values))


def fit_of(model: Model, effects: Sequence[InjectedForm] = ()) -> tuple[Fitted, Log]:
    """To a recording, with one of an hour later held out."""
    train, held_out = (
        replace(
            recorded(seed=seed, periods=periods, effects=effects),
            source=str(seed),
            start=seed * LATER,
        )
        for seed, periods in ((1, 2), (2, 1))
    )
    return fitted(model, [train], [held_out], Options(average=False)), held_out


@pytest.fixture(scope="module")
def sound(model: Model) -> tuple[Fitted, Log]:
    return fit_of(model)


@pytest.fixture(scope="module")
def worn(model: Model) -> tuple[Fitted, Log]:
    """A valve with a play of 1 %."""
    return fit_of(model, [play(HIDDEN, 0.01)])


def of(made: tuple[Fitted, Log]) -> Commanded:
    fit, log = made
    return commanded(fit, fit.before, [log])


def test_commands_alone_move_a_model_of_the_machine(sound: tuple[Fitted, Log]) -> None:
    (second, five) = of(sound).pairs
    assert (second[0].horizon, five[0].horizon) == (1.0, 5.0)
    assert (second[0].relative < 0.002).all()
    assert (five[0].relative < 0.001).all()
    assert second[0] is second[1]  # nothing was added


def test_every_window_is_drawn_beside_what_was_measured(sound: tuple[Fitted, Log]) -> None:
    (five, _) = of(sound).pairs[1]
    (course,) = five.courses
    ends = np.isnan(course.simulated).any(axis=1)
    assert np.count_nonzero(ends) == five.windows
    assert np.abs(course.simulated - course.measured)[~ends].max() < 0.005
    figures = commanded_figures(sound[0].before, course, "commanded-0")
    assert [figure.key for figure in figures] == [f"commanded-0-{joint}" for joint in five.joints]
    assert [curve.name for curve in figures[0].panels[0].curves] == ["measured", "model"]


def test_a_valve_that_has_worn_shows_on_its_joint(
    sound: tuple[Fitted, Log], worn: tuple[Fitted, Log]
) -> None:
    clean, other = (of(made).pairs[0][0] for made in (sound, worn))
    times = dict(zip(clean.joints, other.relative / clean.relative, strict=True))
    assert max(times, key=lambda joint: times[joint]) == HIDDEN
    assert times[HIDDEN] > 5.0


def test_without_hydraulics_it_says_why(sound: tuple[Fitted, Log]) -> None:
    fit, log = sound
    blind = replace(fit, before=replace(fit.before, hydraulics=None))
    found = commanded(blind, blind.before, [log])
    assert not found.pairs
    assert "holds no hydraulics; identify them from" in found.reason
    mute = commanded(fit, fit.before, [replace(log, command=None)])
    assert "2 holds no command; record valve commands" in mute.reason


def test_wear_is_told_from_what_was_identified(worn: tuple[Fitted, Log]) -> None:
    """A data sheet that allows for it says nothing."""
    fit, _ = worn
    sheet = load_usual().model_copy(update={"hysteresis": 0.02})
    own = examine(fit.evidence, fit.held_out, sheet, load_thresholds())
    missing = {(one.joint, each.type) for one in own.found for each in one.missing}
    assert missing == {(HIDDEN, "valve_hysteresis")}
    evidence = replace(fit.evidence, model=replace(fit.evidence.model, hydraulics=None))
    allowed = examine(evidence, fit.held_out, sheet, load_thresholds())
    assert not [each for one in allowed.found for each in one.missing]
