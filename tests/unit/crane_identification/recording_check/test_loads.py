"""Loads that come within a recording, against recordings of the simulated crane that have them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_crane import known_model

from crane_benchmark.observing.machines import PAYLOAD, stock
from crane_identification import Log, Options, Session, read_bag
from crane_identification.recording_check.loads import (
    APART,
    loads_in_words,
    payload_parts,
    split_by_load,
)
from crane_model import DataError, Model, load_model
from crane_model.machine_files import machine_file
from crane_sim import Plant, make
from crane_trajectory import load_clearance, load_trajectory, plan

COMES, MASS = 52.0, 60.0  # s of the recording, kg
NEVER, ALWAYS = 1e9, -1e9


class Lifting(Plant):
    """Something hangs at its tip from a moment on."""

    comes = NEVER

    def advance(self, command: np.ndarray, duration: float) -> None:
        self.set_magnitude(0, MASS if self.time > self.comes else 0.0)
        super().advance(command, duration)


def rubbing(log: Log, joint: int, way: float, pressure: float) -> Log:
    """A log with friction of a joint in its chamber A [Pa], built up along a way [rad]."""
    chamber, position = log.pressure_a, log.position
    assert chamber is not None
    travel = np.diff(np.interp(chamber.time, position.time, position.value[:, joint]))
    bristle = [0.0]
    for step in travel / way:
        bristle.append(float(np.clip(bristle[-1] + step, -1.0, 1.0)))
    shown = chamber.value.copy()
    shown[:, joint] += pressure * np.array(bristle)
    return replace(log, pressure_a=replace(chamber, value=shown))


def by_weighings_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever weighs differently in the two parts is a load from now on."""
    check = "crane_identification.recording_check.loads"
    monkeypatch.setattr(f"{check}.EXPLAINED", 0.0)
    monkeypatch.setattr(f"{check}.A_LOAD", -np.inf)


def recorded(folder: Path, comes: float) -> Log:
    machine = stock()
    trajectory = load_trajectory(machine_file("excitation_20s.yaml"))
    clearance = load_clearance(machine_file("clearance.yaml"))
    motion = plan(machine.machine, trajectory, machine.simulated.start, 4, clearance)

    def build(start: np.ndarray, effects: tuple, running: float) -> Lifting:
        made = Lifting(machine.simulated, machine.machine, start, [PAYLOAD, *effects], running)
        made.comes = comes
        return made

    make(folder, machine.machine, machine.simulated, motion, machine.gains, seed=5, build=build)
    return read_bag(folder, known_model().joints)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Log]:
    folder = tmp_path_factory.mktemp("loads")
    when = {"empty": NEVER, "loaded": ALWAYS, "changing": COMES}
    found = {name: recorded(folder / name, comes) for name, comes in when.items()}
    return {name: replace(log, source=name) for name, log in found.items()}


@pytest.fixture(scope="module")
def model() -> Model:
    return known_model()


def test_a_load_that_comes_is_weighed_on_both_sides(model: Model, logs: dict[str, Log]) -> None:
    before, after = payload_parts(model, logs["changing"], Options())
    assert before.begin == -np.inf
    assert after.begin == pytest.approx(COMES, abs=0.5)
    assert before.mass == pytest.approx(0.0, abs=1.0)
    assert after.mass == pytest.approx(MASS, abs=1.5)


@pytest.mark.parametrize(("name", "mass"), [("empty", 0.0), ("loaded", MASS)])
def test_one_load_is_one_part(name: str, mass: float, model: Model, logs: dict[str, Log]) -> None:
    (part,) = payload_parts(model, logs[name], Options())
    assert part.mass == pytest.approx(mass, abs=1.5)
    same, said = split_by_load(model, [logs[name]], Options())
    assert same == (logs[name],) and not said


def test_the_sides_of_a_change_are_recordings_of_their_own(
    model: Model, logs: dict[str, Log]
) -> None:
    log = logs["changing"]
    parts, (said,) = split_by_load(model, [log, logs["empty"]], Options(period=20.0))
    first, second, third = parts
    assert third is logs["empty"]
    assert [first.source, second.source] == ["changing, part 1", "changing, part 2"]
    assert said.startswith("changing: the load at the tip changed at 5")
    assert first.position.time[-1] == pytest.approx(COMES - APART, abs=0.5)
    assert second.position.time[0] == 0.0
    begins = (second.start - log.start) / 1e9
    assert begins == pytest.approx(COMES + APART, abs=0.5)
    row = np.searchsorted(log.position.time, begins - 1e-6)
    np.testing.assert_array_equal(second.position.value[0], log.position.value[row])
    assert Session.of([first, second]).fallback is None
    assert Session.of([first, second]).since(second) == pytest.approx(begins)


def test_an_effect_that_follows_the_position_is_no_load(
    model: Model, logs: dict[str, Log], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Waves of some bar in a chamber of the outer boom weigh now more, now less."""
    log = logs["empty"]
    chamber, position = log.pressure_a, log.position
    assert chamber is not None
    elbow = np.interp(chamber.time, position.time, position.value[:, 1])
    shown = chamber.value.copy()
    shown[:, 1] += 4e5 * np.sin(3.0 * (elbow - elbow.mean()))
    waves = replace(log, pressure_a=replace(chamber, value=shown))
    assert split_by_load(model, [waves], Options(period=20.0)) == ((waves,), ())
    by_weighings_alone(monkeypatch)
    assert len(payload_parts(model, waves, Options())) > 1


@pytest.mark.parametrize(("joint", "way", "pressure"), [(0, 0.1, 1e6), (1, 0.3, 4e5)])
def test_friction_by_the_way_since_a_reversal_is_no_load(
    joint: int,
    way: float,
    pressure: float,
    model: Model,
    logs: dict[str, Log],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It weighs now more, now less, by a tenth; the one load that comes is still found."""
    rubs = {name: rubbing(log, joint, way, pressure) for name, log in logs.items()}
    (part,) = payload_parts(model, rubs["empty"], Options())
    assert part.begin == -np.inf
    before, after = payload_parts(model, rubs["changing"], Options())
    assert after.begin == pytest.approx(COMES, abs=6.0)
    assert after.mass - before.mass == pytest.approx(MASS, rel=0.15)
    by_weighings_alone(monkeypatch)
    assert len(payload_parts(model, rubs["changing"], Options())) > 2


def test_a_part_without_a_whole_period_is_left_out(model: Model, logs: dict[str, Log]) -> None:
    log = logs["changing"]
    short = log.during(COMES - 12.0, np.inf)
    (left,), (changed, out) = split_by_load(model, [short], Options(period=20.0))
    assert left.source == "changing, part 2"
    assert "changed" in changed and out.startswith("changing, part 1: left out: ")
    neither = log.during(COMES - 12.0, COMES + 8.0)
    with pytest.raises(DataError, match="no part is left"):
        split_by_load(model, [neither], Options(period=20.0))


def test_what_identify_warns_of(model: Model, logs: dict[str, Log]) -> None:
    said = loads_in_words(model, list(logs.values()), Options())
    assert len(said) == 2
    assert said[0].startswith("changing: the load at the tip changed at 5")
    assert said[1].startswith("loaded: carries ") and "more than the lightest" in said[1]
    assert loads_in_words(model, [logs["empty"]], Options()) == ()


def test_without_values_or_pressures_nothing_is_said(model: Model, logs: dict[str, Log]) -> None:
    log = logs["changing"]
    assert payload_parts(load_model(machine_file("model.yaml")), log, Options()) == ()
    assert payload_parts(model, replace(log, pressure_a=None), Options()) == ()
    assert payload_parts(model, replace(log, uncalibrated=("pressure",)), Options()) == ()
