"""Which cases the sets of the benchmark hold, and how well their motions excite."""

import pytest

from crane_benchmark import CaseKind
from crane_benchmark.cases.case import EffectToHide, Simulator, World
from crane_benchmark.cases.case_sets import (
    ABSORBED,
    RELATIVE_MAGNITUDES,
    SHARES,
    CaseSet,
    apportioned,
    cases,
    with_others,
)
from crane_benchmark.cases.motions import LABORATORY_CRANE, Richness
from crane_benchmark.cases.simulators import AS_DRAWN, LAWS, SURVEYED, drawn_effects, drawn_machine
from crane_benchmark.independent.readings import FAMILIES
from crane_identification.diagnosis.flow import load_usual
from crane_sim import load_simulated_crane


def test_sets_share_no_case():
    names = [case.name for which in CaseSet for case in cases(which, 60)]
    seeds = [case.seed for which in CaseSet for case in cases(which, 60)]
    assert len(set(names)) == len(set(seeds)) == 60 * len(CaseSet)


@pytest.mark.parametrize("simulator", Simulator)
def test_kinds_have_their_shares_and_names_tell_nothing(simulator):
    drawn = cases(CaseSet.SCORING, 400)
    assert len({case.name for case in drawn}) == 400
    drawn = [case for case in drawn if case.simulator is simulator]
    kinds = [case.kind for case in drawn]
    assert {kind: kinds.count(kind) for kind in CaseKind} == {
        kind: round(200 * share) for kind, share in SHARES.items()
    }
    assert len(set(kinds[:20])) > 2  # sorted by name, not by kind
    single = [case.effects[0].relative_magnitude for case in drawn if case.kind is CaseKind.SINGLE]
    counts = [single.count(relative_magnitude) for relative_magnitude in RELATIVE_MAGNITUDES]
    assert max(counts) - min(counts) <= 1 and sum(counts) == len(single)
    assert RELATIVE_MAGNITUDES[-1] == 0.16
    assert all(len({e.effect for e in c.effects}) == 2 for c in drawn if c.kind is CaseKind.PAIR)
    assert {case.world for case in drawn} == set(World)


def test_lengths_are_off_in_cases_of_their_own_and_half_of_those_that_hide_effects():
    drawn = cases(CaseSet.SCORING, 400)
    for case in drawn:
        assert case.off or case.kind is not CaseKind.LENGTHS
        assert not (case.off and case.kind is CaseKind.NOTHING)
    hiding = [case.off for case in drawn if case.effects]
    assert 0.4 < sum(hiding) / len(hiding) < 0.6
    for which in (CaseSet.CALIBRATION, CaseSet.INDEPENDENT_CLEAN):
        assert not any(case.off for case in cases(which, 40))


def test_calibration_hides_nothing():
    assert all(not case.effects for case in cases(CaseSet.CALIBRATION, 40))


@pytest.mark.parametrize("count", [1, 7, 40, 143])
def test_shares_add_up(count):
    assert sum(apportioned(SHARES, count).values()) == count


def test_motions_are_rich_where_they_should_be():
    rich = [case for case in cases(CaseSet.TUNING, 40) if case.kind is not CaseKind.INSUFFICIENT]
    assert all(case.excitation is not Richness.POOR for case in rich)


def test_calibration_is_half_of_the_field():
    worlds = [case.world for case in cases(CaseSet.CALIBRATION, 40)]
    assert worlds.count(World.FIELD) == worlds.count(World.LABORATORY) == 20


@pytest.mark.parametrize("which", [CaseSet.SCORING, CaseSet.INDEPENDENT_TUNING])
def test_cases_hide_laws_of_the_families_of_their_site(which):
    for case in cases(which, 120):
        for effect in case.effects:
            assert effect.form in {form.name for form in LAWS[case.simulator][effect.effect]}
        if case.world is World.FIELD:  # long after the start nothing is cold
            assert "warm_up" not in {effect.effect for effect in case.effects}
            if case.kind in (CaseKind.SINGLE, CaseKind.PAIR):
                assert "warm_up" not in {effect.effect for effect in with_others(case, 1).effects}


@pytest.mark.parametrize("simulator", Simulator)
def test_families_have_three_laws_each_of_which_two_draws_differ(simulator):
    simulated = load_simulated_crane()
    for effect, laws in LAWS[simulator].items():
        if effect in ABSORBED:  # nothing shows it: it is not hidden
            continue
        assert len({law.law for law in laws}) >= 3, effect
        for law in laws:
            joint = next(iter(law.where.joints(LABORATORY_CRANE)), None)
            wanted = (
                EffectToHide(effect=effect, joint=joint, form=law.name, relative_magnitude=0.04),
            )
            first, second = (
                drawn_effects(simulator, wanted, simulated, seed)[0] for seed in (1, 2)
            )
            assert len(first.values) == 1 + len(law.draws)
            assert (first.values[1:] != second.values[1:]) or not law.draws
        assert any(law.draws for law in laws), effect


def test_the_second_plant_has_a_catalogue_of_its_own():
    assert sum(not laws[0].outside for laws in FAMILIES.values()) >= 15
    assert sum(laws[0].outside for laws in FAMILIES.values()) >= 4


@pytest.mark.parametrize("simulator", Simulator)
def test_machines_differ_from_their_file_as_their_case_says(simulator):
    pytest.importorskip("mujoco")
    case = next(case for case in cases(CaseSet.SCORING, 400) if case.simulator is simulator)
    for off, most in ((True, AS_DRAWN), (False, SURVEYED)):
        largest = 0.0
        for seed in range(12):
            drawn = drawn_machine(case.model_copy(update={"off": off}), LABORATORY_CRANE, seed)
            actual, given = drawn.actual.joints[1], LABORATORY_CRANE.joints[1]
            ratios = [actual.dh.a / given.dh.a]
            ratios += [
                getattr(actual.actuator, n) / getattr(given.actuator, n) for n in ("j1", "j2")
            ]
            assert ratios[1] == pytest.approx(ratios[2])  # a linkage that is larger as a whole
            largest = max(largest, *(abs(ratio - 1.0) for ratio in ratios))
            assert len(drawn.flaws) == 3
        assert 0.5 * most < largest <= most


def test_machines_at_home_differ_and_stay_usual():
    case = next(case for case in cases(CaseSet.SCORING, 400) if case.simulator is Simulator.PRIMARY)
    drawn = [drawn_machine(case, LABORATORY_CRANE, seed).simulated for seed in range(40)]
    assert {parameters.step for parameters in drawn} == {1e-4, 2e-4}
    masses = [
        parameters.bodies["gripper"].mass / load_simulated_crane().bodies["gripper"].mass
        for parameters in drawn
    ]
    assert 0.7 <= min(masses) < 0.8 and 1.2 < max(masses) <= 1.3
    usual = load_usual()
    for parameters in drawn:
        assert parameters.oil.bulk_modulus > usual.bulk_modulus
        assert all(inside.leakage < usual.leakage for inside in parameters.cylinders.values())
        assert parameters.dynamic_friction is None
    assert drawn[3] == drawn_machine(case, LABORATORY_CRANE, 3).simulated


def test_nothing_is_hidden_in_clean_cases_of_the_independent_simulator():
    assert all(
        not case.effects and case.simulator is Simulator.INDEPENDENT
        for case in cases(CaseSet.INDEPENDENT_CLEAN, 20)
    )
