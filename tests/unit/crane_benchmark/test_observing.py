"""Which aims of the observers are missed, and the cases that they are asked by."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from unit.crane_observer.observed import known

from crane_benchmark.measured import MeasuredRow
from crane_benchmark.observing.failing import (
    FAULT_AIMS,
    OTHERS,
    SOONEST_FAULT_S,
    FailingCase,
    MonitorAnswer,
    WatchedMachine,
    answered,
    drawn,
    smallest,
    with_fault,
)
from crane_benchmark.observing.loads import WeighedLift, in_motion, rows_of, weighed
from crane_benchmark.observing.loads import missed as missed_loads
from crane_benchmark.observing.machines import HeardWork, KeptRecordings, WorkCycles, stock
from crane_benchmark.observing.observer import missed
from crane_benchmark.observing.sensors import draw_curves, shares
from crane_model import DataError
from crane_observer import HeardRecording, Part, SensorFinding, Wrong, unlearnt
from crane_observer.payload.estimator import PayloadCondition, PayloadEstimate
from crane_observer.payload.filter import TipLoad
from crane_sim.plant.closed_loop import REST_S
from crane_sim.sensor_faults import TimedFault, parse


@pytest.mark.parametrize(("value", "misses"), [(1.9, 0), (2.0, 0), (2.01, 1)])
def test_an_aim_is_missed_by_more_than_it(value: float, misses: int) -> None:
    row = MeasuredRow(cells=["boom [mrad]"], values={"sensor": value, "aim": 2.0})
    found = missed([row])
    assert len(found) == misses
    assert all(text.startswith("boom [mrad]: ") and text.endswith("aim 2") for text in found)


def test_faults_are_drawn_while_their_joint_moves_and_each_kind_comes() -> None:
    observed = stock()
    cases = drawn(observed, 40, 3)
    assert {case.question for case in cases} == {*FAULT_AIMS, *OTHERS}
    assert len({case.seed for case in cases}) == len(cases)
    for case in cases:
        assert parse(str(case.fault), observed.machine).place == case.fault.place
        low, high = case.question.sizes
        assert low * 0.999 <= abs(case.fault.size) <= high * 1.001
        assert case.fault.onset is not None and case.fault.onset > SOONEST_FAULT_S
        cycles = WorkCycles.drawn(observed.machine, observed.simulated.start, 120.0, case.seed)
        velocity = cycles.reference(np.array([case.fault.onset - REST_S])).velocity[0]
        if case.fault.target != "supply":
            assert abs(velocity[observed.machine.index(case.fault.target)]) > 0.005


def test_each_kind_has_small_and_large_faults() -> None:
    observed = stock()
    for question in OTHERS:
        low, high = question.sizes
        if not low:
            continue
        sizes = [
            abs(case.fault.size) for case in drawn(observed, 150, 5) if case.question == question
        ]
        place = np.sort(np.log(np.array(sizes) / low) / np.log(high / low)) * len(sizes)
        assert (np.floor(place) == np.arange(len(sizes))).all()


def test_a_recording_that_is_kept_is_not_made_again(tmp_path: Path) -> None:
    heard = HeardRecording(Path("made"), 0, *(k + np.arange(6.0) for k in range(8)))

    def never() -> HeardWork:
        raise AssertionError("made twice")

    first = KeptRecordings(tmp_path).recording("one", lambda: HeardWork(1.5, heard))
    again = KeptRecordings(tmp_path).recording("one", never)
    assert again.begin == first.begin == 1.5
    assert again.seconds == 5.0
    for field in fields(HeardRecording)[2:]:
        np.testing.assert_array_equal(getattr(again.heard, field.name), getattr(heard, field.name))


def test_a_fault_is_answered_by_what_the_monitor_says() -> None:
    watched = WatchedMachine(stock(), known(), unlearnt(known().joints))
    question = FAULT_AIMS[0]
    fault = TimedFault("inner_boom", "encoder", "stuck", 0.0, 12.0)
    case = next(
        FailingCase(question, seed, fault._replace(onset=case.fault.onset))
        for seed, case in ((case.seed, case) for case in drawn(stock(), 40, 3))
        if case.question == question and case.fault.target == "inner_boom"
    )
    work = with_fault(watched.observed, watched.model, case)
    answer = answered(watched, case, work)
    assert answer.right and 0.0 < answer.delay < 1.0
    assert answer.alarms == 0
    assert answer.before == pytest.approx(case.fault.onset, abs=0.1)


def drifting(size: float, delay: float) -> MonitorAnswer:
    """A case, and when it was found."""
    question = next(question for question in OTHERS if question.kind == "drift")
    fault = TimedFault("inner_boom", "encoder", question.kind, size, 10.0)
    found = SensorFinding(
        Part.ENCODER, "inner_boom", Wrong.DRIFT, "m/s", 1.0, 0.0, 2.0, 10.0, 10.0 + delay
    )
    return MonitorAnswer(FailingCase(question, 1, fault), 9.0, 0, found)


def test_the_smallest_size_is_that_above_which_all_were_found() -> None:
    answers = [drifting(1e-3, 0.1), drifting(2e-3, 99.0), drifting(-4e-3, 0.1), drifting(8e-3, 0.2)]
    assert smallest(answers, answers[0].case.question) == 4e-3


def test_the_share_that_is_found_never_falls_as_faults_grow() -> None:
    """A large fault that was missed counts against the smaller ones that were found beside it."""
    late, soon = 99.0, 0.1
    answers = [
        drifting(size, delay)
        for size, delay in ((8e-3, soon), (-1e-3, late), (3e-3, late), (2e-3, soon), (4e-3, soon))
    ]
    size, share = shares(answers)
    np.testing.assert_allclose(size, [1e-3, 2e-3, 3e-3, 4e-3, 8e-3])
    np.testing.assert_allclose(share, [0.0, 0.5, 0.5, 1.0, 1.0])


def test_curves_are_drawn_of_kinds_without_cases_too(tmp_path: Path) -> None:
    draw_curves(tmp_path / "curves.png", [drifting(1e-3, 0.1), drifting(1e-4, 99.0)])
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def told_of(cycles: WorkCycles, until: float) -> list[WeighedLift]:
    """What is made of a scale that says a tenth too much, and nothing of the motion."""
    mass = [float(cycles.load(np.array([t - REST_S]))[0]) for t in np.arange(0.0, until, 0.15)]
    found = [
        PayloadEstimate(
            0.15 * k, TipLoad(1.1 * m, 0.01, np.nan, np.nan), PayloadCondition.GOOD, False, 0.0,
            0.0, 5.0,
        )
        for k, m in enumerate(mass)
    ]  # fmt: skip
    time = np.arange(0.0, until, 0.005)
    machine = stock().machine
    velocity = cycles.reference(time - REST_S).velocity
    return weighed(cycles, time, in_motion(machine, machine.joint_names, velocity), found)


def test_loads_are_read_before_they_are_put_down() -> None:
    machine = stock()
    told = told_of(WorkCycles.drawn(machine.machine, machine.simulated.start, 100.0, 5), 100.0)
    assert told
    assert all(warning.error == pytest.approx(0.1) and not warning.covered for warning in told)


def test_motion_of_a_load_counts_from_its_pick_up_whatever_the_scale_says() -> None:
    start, away = np.zeros(4), np.array([0.0, 0.3, 0.0, 0.5])
    cycles = WorkCycles(
        poses=np.stack([start, away, start, away, away, start, start]),
        begins=np.array([1.0, 5.0, 9.0, 13.0, 17.0, 21.0]),
        ends=np.array([4.0, 8.0, 12.0, 16.0, 20.0, 24.0]),
        loads=np.array([0.0, 60.0, 60.0, 0.0, 30.0, 0.0]),
        beyond=np.zeros(6),
    )
    twice, once = told_of(cycles, 25.0)
    assert (twice.load, once.load) == (60.0, 30.0)
    # both ends of a move of fifth order are slower than what counts as motion
    assert 5.0 < twice.moved < 6.0 and 2.5 < once.moved < 3.0


def test_loads_hang_off_the_tip_by_what_is_asked_and_are_the_same() -> None:
    machine = stock()
    given = machine.machine, machine.simulated.start, 3000.0, 5
    at_it, about_it = (WorkCycles.drawn(*given, hung=hung) for hung in (0.0, 0.01))
    np.testing.assert_array_equal(at_it.loads, about_it.loads)
    assert not at_it.beyond.any()
    comes = np.flatnonzero((about_it.loads[1:] > 0.0) & (about_it.loads[:-1] == 0.0)) + 1
    centres = about_it.beyond[comes]
    assert centres.std() == pytest.approx(0.01, rel=0.3)
    middle = (about_it.begins[comes] + about_it.ends[comes]) / 2.0
    told = [about_it.carried(float(time)) for time in middle]
    assert told == list(zip(about_it.loads[comes], centres, strict=True))


def test_loads_that_moved_too_little_stand_in_a_row_without_aim() -> None:
    moved = (1.9, 2.0, 8.0)
    answers = [WeighedLift(50.0, s, 60.0 if s < 2.0 else 50.5, 0.5, True) for s in moved]
    counted, little = rows_of("hard", 0.02, answers)
    assert counted.values["lifts"] == 2.0
    assert counted.values["rms"] == pytest.approx(0.01)
    assert little.values["rms"] == pytest.approx(0.2)
    assert missed_loads([little]) == []
    assert missed_loads([counted]) == ["hard: 100.0% in their 95 % interval"]


@pytest.mark.parametrize("answers", [[], [WeighedLift(50.0, 1.0, 60.0, 0.5, True)]])
def test_where_no_load_is_to_be_counted_it_says_so(answers: list[WeighedLift]) -> None:
    """As in a minute of work, in which none came or none was moved."""
    with pytest.raises(DataError, match=f"stock: of {len(answers)} loads, none was moved for 2 s"):
        rows_of("stock", 0.005, answers)


def test_loads_that_no_pose_permits_to_weigh_stand_in_a_row_without_aim() -> None:
    answers = [WeighedLift(50.0, 8.0, 50.5 if told else 40.0, 0.5, told) for told in (True, False)]
    counted, refused = rows_of("hard", 0.02, answers)
    assert counted.values["rms"] == pytest.approx(0.01)
    assert refused.cells[0].endswith("no pose permits weighing, it says")
    assert refused.values["lifts"] == 1.0 and refused.values["rms"] == pytest.approx(0.2)


def test_a_load_is_weighed_where_one_of_its_poses_permits_it() -> None:
    cycles = WorkCycles(
        poses=np.zeros((5, 4)),
        begins=np.array([1.0, 5.0, 9.0, 13.0]),
        ends=np.array([4.0, 8.0, 12.0, 16.0]),
        loads=np.array([0.0, 60.0, 30.0, 0.0]),
        beyond=np.zeros(4),
    )
    time = np.arange(0.0, 20.0, 0.15)
    none, all_ = PayloadCondition.UNOBSERVABLE, PayloadCondition.GOOD

    def permitted(conditions: list[PayloadCondition]) -> list[bool]:
        found = [
            PayloadEstimate(t, TipLoad(50.0, 1.0, np.nan, np.nan), condition, False, 0.0, 0.0, 5.0)
            for t, condition in zip(time, conditions, strict=True)
        ]
        return [weighing.permitted for weighing in weighed(cycles, time, time > 0.0, found)]

    changes = REST_S + np.array([4.5, 8.5])  # the first load comes, and gives way to the second
    first = (time > changes[0]) & (time < changes[1])
    assert permitted([none for _ in time]) == [False, False]
    assert permitted([all_ if finding else none for finding in first]) == [True, False]
    # what was told of the load before does not count for the one that has just come
    assert permitted([all_ if t < changes[0] + 0.2 else none for t in time]) == [False, False]
