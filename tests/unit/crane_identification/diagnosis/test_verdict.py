"""The verdict, on facts made up for the purpose."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from crane_identification.diagnosis.answer import Answer, Reach, judge, with_loads, with_pulsation
from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate, Weighed
from crane_identification.diagnosis.findings import Verdict
from crane_identification.diagnosis.gap import OF_SAMPLES, Gap, Learnt, Line
from crane_identification.diagnosis.judgement import Judged, Reason, Rejection
from crane_identification.diagnosis.proof import Proof, Short, Trial, Value, differs
from crane_identification.thresholds import load_thresholds
from crane_identification.validation.motion_validation import MotionValidation
from crane_model import load_model
from crane_model.machine_files import machine_file
from crane_model.terms import REGISTRY

JOINTS = ("inner_boom", "outer_boom", "telescope")
MODEL = load_model(machine_file("model.yaml"))
THRESHOLDS = load_thresholds()
MOTION = MotionValidation(JOINTS, 0.5, 1, np.ones(3), np.ones(3))
ENOUGH = Reach(
    testable=0.9,
    least=0.003,
    named=dict(zip(JOINTS, (0.003, 0.012, 0.002), strict=True)),
    undetermined=(),
)


def gap(
    before: float,
    after: float | None = None,
    floor: float = 0.0005,
    training: float | None = None,
    samples: float = 0.0005,
) -> Gap:
    """Errors of the outer boom; the other joints err by noise alone."""
    noise = np.full(3, 0.0005)

    def errors(value: float) -> np.ndarray:
        return np.array([0.0005, value, 0.0005])

    return Gap(
        joints=JOINTS,
        before=errors(before),
        after=errors(before if after is None else after),
        floor=np.full(3, floor),
        best=np.minimum(errors(before), 2.0 * noise),
        training_before=errors(before if training is None else training),
        training_after=errors(before if after is None else after),
        motion_before=MOTION,
        motion_after=MOTION,
        loads=(),
        carried=MODEL,
        sample_noise=np.full(3, samples),
        method=THRESHOLDS.method,
    )


def effect(
    kind: str = "load_friction",
    indistinct: tuple[str, ...] = (),
    shape: Mapping[str, float] = MappingProxyType({}),
    joint: str | None = "outer_boom",
) -> Judged:
    """It has passed every test of the training recordings."""
    candidate = Candidate(REGISTRY[kind], joint)
    return Judged(
        shaped=ShapedCandidate(
            candidate, dict(shape), candidate.at(shape), np.ones((1, 3, 1)), np.array([True])
        ),
        score=1000.0,
        threshold=50.0,
        held_out=np.ones(6),
        fold_names=tuple("abcdef"),
        runner_up=None,
        margin=900.0,
        needed=50.0,
        correlation=0.5,
        indistinct=tuple(Candidate(REGISTRY[one], "outer_boom") for one in indistinct),
        strength=0.01,
    )


def trial(*effects: Judged, energy: float = 1000.0, share: float = 0.0, left: float = 0.0) -> Trial:
    """What is left on the outer boom, and the share of it that a learner is sure of."""
    none, there = np.zeros(3), np.array([0.0, 1.0, 0.0])
    learnt = Learnt(share * there, 1.0 - (share > 0.0) * there, 0.01 * there)
    return Trial(
        effects=effects,
        zero=(),
        values=(),
        model=MODEL,
        residual=np.zeros((1, 6)),
        energy=np.concatenate([energy * there, none]),
        left_share=left,
        learning=lambda: learnt,
        thresholds=THRESHOLDS,
    )


BEFORE = trial(energy=5000.0)
AFTER = trial(effect(), energy=500.0)


def answer(
    after: Trial = BEFORE,
    seen: Gap | None = None,
    reach: Reach = ENOUGH,
    short: tuple[Short, ...] = (),
) -> Answer:
    return judge(Proof(BEFORE, after, seen or gap(0.0006), short), reach)


def test_nothing_is_missing_where_held_out_errors_are_noise() -> None:
    """True clean sets reach 2.1 times the scatter between periods."""
    found = answer(seen=gap(2.1 * 0.0005))
    assert found.verdict is Verdict.NONE
    assert "2.1 times the scatter between periods" in found.reason


@pytest.mark.parametrize(
    "reach",
    [ENOUGH, ENOUGH._replace(least=0.5), ENOUGH._replace(testable=0.1)]
    + [ENOUGH._replace(undetermined=("f_v.telescope",))],
)
def test_errors_beyond_noise_are_at_least_unknown(reach: Reach) -> None:
    found = answer(seen=gap(0.039), reach=reach)
    assert found.verdict is Verdict.UNKNOWN
    assert "outer_boom errs by 3.90% on held-out recordings and by 3.90%" in found.reason
    assert "78 times the scatter between periods" in found.reason


@pytest.mark.parametrize(("error", "verdict"), [(0.0014, "none"), (0.0016, "unknown")])
def test_what_surveyed_lengths_leave_is_nothing_missing(error: float, verdict: str) -> None:
    """However little the force scatters between periods."""
    assert answer(seen=gap(error, floor=1e-4)).verdict == verdict


@pytest.mark.parametrize(("held_out", "training"), [(0.039, 0.0006), (0.0006, 0.039)])
def test_errors_of_either_recordings_count(held_out: float, training: float) -> None:
    found = answer(seen=gap(held_out, training=training))
    assert found.verdict is Verdict.UNKNOWN
    assert f"{held_out:.2%} on held-out" in found.reason and f"{training:.2%} on" in found.reason


@pytest.mark.parametrize("floor", [np.nan, 0.04])
def test_errors_beyond_the_scatter_of_samples_are_at_least_unknown(floor: float) -> None:
    """Where no motion is repeated, and where friction that comes and goes scatters with it."""
    found = answer(seen=gap(0.039, floor=floor))
    assert found.verdict is Verdict.UNKNOWN
    assert "outer_boom errs by 3.90%" in found.reason
    assert "25 times what the scatter of samples and surveyed lengths" in found.reason


def test_recordings_that_do_not_suffice_are_not_asked_for_the_scatter_of_samples() -> None:
    reach = ENOUGH._replace(undetermined=("f_v.telescope",))
    assert answer(seen=gap(0.039, floor=np.nan), reach=reach).verdict is Verdict.INSUFFICIENT


def test_beside_a_name_the_scatter_of_samples_is_not_asked() -> None:
    """A real machine leaves more than its sensors' noise beside any effect."""
    seen = gap(0.2, 0.03, floor=0.04)
    assert seen.beyond(seen.after, THRESHOLDS.gates, OF_SAMPLES).any()
    assert answer(after=AFTER, seen=seen).verdict is Verdict.NAMED


def test_beside_a_scale_the_scatter_of_samples_is_asked() -> None:
    """It has no law, of which something would be left."""
    seen = gap(0.2, 0.03, floor=0.04)
    found = answer(after=trial(effect("linkage_scale"), energy=500.0), seen=seen)
    assert found.verdict is Verdict.AND_MORE
    assert "19 times what the scatter of samples" in found.reason


@pytest.mark.parametrize("samples", [0.0005, 0.012])
def test_where_no_motion_is_repeated_samples_say_what_noise_is(samples: float) -> None:
    found = answer(seen=gap(3.4 * np.hypot(samples, 0.0015), floor=np.nan, samples=samples))
    assert found.verdict is Verdict.NONE
    assert "3.4 times what the scatter of samples" in found.reason
    assert "no held-out recording repeats its motion" in found.reason


def test_too_little_data_remains_too_little() -> None:
    reach = ENOUGH._replace(undetermined=("f_v.telescope",))
    assert answer(reach=reach).verdict is Verdict.INSUFFICIENT


def test_a_name_that_closes_the_gap_is_named() -> None:
    assert answer(after=AFTER, seen=gap(0.0113, 0.0006)).verdict is Verdict.NAMED


def test_a_name_that_closes_no_gap_is_unknown() -> None:
    found = answer(short=(Short(effect(), Rejection(Reason.CLOSED, 0.39, 0.8)),))
    assert found.verdict is Verdict.UNKNOWN and "it removes 39% of" in found.objection


def test_a_further_name_that_closes_no_gap_is_something_more() -> None:
    found = answer(
        AFTER,
        gap(0.0113, 0.0006),
        short=(Short(effect("hose_stiffness"), Rejection(Reason.CLOSED, 0.39, 0.8)),),
    )
    assert found.verdict is Verdict.AND_MORE
    assert "hose stiffness (outer_boom) would go with them, but it removes 39%" in found.reason


@pytest.mark.parametrize(
    ("after", "seen"),
    [
        (AFTER, gap(0.0113, 0.004)),  # eight times the noise is left
        (trial(effect(), energy=2500.0, share=0.2), gap(0.0113, 0.0006)),
        (trial(effect(), energy=500.0, left=0.4), gap(0.0113, 0.0006)),
        (AFTER, replace(gap(0.0113, 0.0006), after=np.array([0.02, 0.0006, 0.0005]))),
    ],
)
def test_what_passed_is_kept_where_something_more_is_missing(after: Trial, seen: Gap) -> None:
    assert answer(after=after, seen=seen).verdict is Verdict.AND_MORE


def test_a_class_stays_one_where_something_more_is_missing() -> None:
    after = trial(effect("load_friction", ("seal_friction",)), energy=500.0)
    assert answer(after=after, seen=gap(0.0113, 0.0006)).verdict is Verdict.AMBIGUOUS
    found = answer(after=after, seen=gap(0.0113, 0.004))
    assert found.verdict is Verdict.AND_MORE and "do not discriminate" in found.reason


def test_what_is_zero_within_its_deviation_is_no_name() -> None:
    after = replace(trial(energy=5000.0), zero=(effect("chamber_gain"),))
    found = answer(after=after)
    assert found.verdict is Verdict.UNKNOWN and "2 standard deviations" in found.objection


@pytest.mark.parametrize(
    ("values", "expected"),
    [([(0.118, 0.13)], False), ([(0.3, 0.1)], True), ([(0.1, 0.1), (-5.0, 0.2)], True)],
)
def test_a_value_within_its_deviation_differs_from_nothing(values, expected: bool) -> None:
    """Shapes, which come last, do not count."""
    one = effect("chamber_gain")
    shaped = replace(one.shaped, positive=np.zeros(len(values), dtype=bool))
    shape = Value("wave", 3.0, 0.1, "rad/rad")
    linear = [Value("gain", value, std_dev, "1") for value, std_dev in values]
    sigmas = THRESHOLDS.method.parameter_sigmas
    assert differs(replace(one, shaped=shaped), [*linear, shape], sigmas) is expected


def test_a_pulsation_beside_a_name_is_something_more() -> None:
    line = Line("outer_boom", 2.7, 0.01, 9.0)
    assert with_pulsation(Answer(Verdict.NAMED, "x"), (line,)).verdict is Verdict.AND_MORE
    assert with_pulsation(Answer(Verdict.NONE, "x"), (line,)).verdict is Verdict.UNKNOWN
    told = with_pulsation(Answer(Verdict.INSUFFICIENT, "record more"), (line,))
    assert told.verdict is Verdict.UNKNOWN
    assert told.reason.endswith("; record more")


@pytest.mark.parametrize(("telescope", "worse"), [(0.0009, False), (0.00101, True)])
def test_another_joint_that_becomes_worse_than_noise_is_something_more(
    telescope: float, worse: bool
) -> None:
    """0.05 to 0.09 % are noise."""
    seen = gap(0.0113, 0.0006)
    seen = replace(seen, after=np.array([0.0005, 0.0006, telescope]), floor=np.full(3, 0.00048))
    found = answer(AFTER, seen)
    assert (found.verdict is Verdict.AND_MORE) is worse
    told = (
        "where none of the effects acts, the held-out error of telescope rises from 0.05% to 0.10%"
    )
    assert (told in found.reason) is worse


def test_a_percentage_does_not_fall_to_itself() -> None:
    """An effect of the whole crane moves one joint, and the others by nothing that is printed."""
    seen = gap(0.0113, 0.0006)
    seen = replace(seen, after=np.array([0.0004999, 0.0006, 0.0005]))
    crane = effect("base_tilt", joint=None)
    said = answer(trial(crane, energy=500.0), seen).reason
    assert "the held-out error of outer_boom falls from 1.13% to 0.06%" in said
    assert "the held-out error of inner_boom stays at 0.05%" in said


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [(0.05, 0.0006, Verdict.NAMED), (0.05, 0.05, Verdict.AND_MORE)],
)
def test_a_load_that_a_held_out_recording_alone_carries_is_named(
    before: float, after: float, expected: Verdict
) -> None:
    """And is all there is where no more than noise is left beside it."""
    loads = (Weighed("bag 7", 6.6, 0.01, found=True), Weighed("bag 8", 0.0, 0.01, found=False))
    said = with_loads(answer(seen=gap(before, after, training=0.0006)), loads)
    assert said.verdict is expected
    assert "bag 7 carries 6.6 kg more than the training recordings" in said.reason
    assert "bag 8" not in said.reason
