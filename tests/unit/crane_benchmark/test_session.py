"""When the recordings of a case were made, what they carry, and how the machine moved in them."""

from dataclasses import dataclass

import numpy as np
import pytest

from crane_benchmark import Case, CaseKind
from crane_benchmark.cases.case import Carried, EffectToHide, SessionRecording, World, recordings
from crane_benchmark.cases.motions import Maker
from crane_identification.preparation.periodicity import detect_periodicity
from crane_model import DataError, load_machine
from crane_model.machine_files import machine_file
from crane_sim import load_simulated_crane
from crane_sim.effects.form import InjectedForm
from crane_sim.effects.kernel import FORMS
from crane_trajectory import load_clearance

TRAIN, VALIDATE = 6, 2
LOAD = InjectedForm(FORMS["payload"][0], None, (10.0, 0.1, 0.2))
RESOLUTION = 0.02  # s


@dataclass
class Still:
    """Of a motion, what a session asks for."""

    duration: float = 60.0


def made(
    seed: int, carried: Carried = Carried.ALL, world: World = World.FIELD, warm: bool = False
) -> list[SessionRecording]:
    load = EffectToHide(
        effect="payload", joint=None, form="body", relative_magnitude=0.04, carried=carried
    )
    case = Case(
        name="a", kind=CaseKind.SINGLE, seed=(0, seed), effects=(load,), world=world, warm=warm
    )
    rng, still = np.random.default_rng(seed), Still()
    return recordings(rng, case, [still] * TRAIN, [still] * VALIDATE)  # type: ignore[list-item]


def masses(session: list[SessionRecording]) -> np.ndarray:
    """(8,) kg, of the recordings by name."""
    found = [[effect.values[0] for effect in recording.present([LOAD])] for recording in session]
    return np.array([mass[0] if mass else 0.0 for mass in found])


def test_recordings_of_the_field_follow_each_other_with_pauses_in_any_order():
    sessions = [made(seed) for seed in range(20)]
    orders = set()
    for session in sessions:
        begins = np.array([recording.moment.running for recording in session])
        orders.add(tuple(np.argsort(begins)))
        assert len({recording.moment.started for recording in session}) == 1
        assert (np.diff(np.sort(begins)) > 60.0 + 60.0).all()
    assert len(orders) == 20
    assert len({session[0].moment.started for session in sessions}) == 20


def test_a_session_begins_cold_or_warm():
    cold, warm = (
        min(recording.moment.running for recording in made(seed, warm=warm))
        for seed, warm in ((1, False), (1, True))
    )
    assert cold < 60.0
    assert warm >= 600.0


def test_recordings_of_the_laboratory_are_of_a_cold_machine():
    assert {recording.moment.running for recording in made(1, world=World.LABORATORY)} == {0.0}


@pytest.mark.parametrize(("carried", "count"), [(Carried.ALL, (6, 2)), (Carried.LATER, (3, 0))])
def test_effects_are_in_the_recordings_that_the_case_says(carried, count):
    there = masses(made(3, carried)) > 0.0
    assert (there[:TRAIN].sum(), there[TRAIN:].sum()) == count
    if carried is Carried.LATER:
        assert there[3:6].all()


def test_motions_of_the_field_fit_and_every_other_one_repeats():
    maker = Maker(
        np.random.default_rng(2),
        load_machine(),
        load_simulated_crane().start,
        load_clearance(machine_file("clearance.yaml")),
    )
    train, validate = maker.of_the_field(1)
    assert (len(train), len(validate)) == (3, 2)
    repeats = []
    for motion in (*train, *validate):
        time = np.arange(0.0, motion.duration, RESOLUTION)
        try:
            found = detect_periodicity(time, motion.reference(time).position)
        except DataError:
            repeats.append(False)
        else:
            repeats.append(True)
            assert found.period == pytest.approx(motion.trajectory.period, abs=2.0 * RESOLUTION)
    assert sum(repeats[:3]) == sum(repeats[3:]) == 1
