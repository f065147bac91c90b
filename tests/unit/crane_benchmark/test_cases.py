"""Which cases the sets of the benchmark hold, and how well their motions excite."""

import pytest

from crane_benchmark.away.families import FAMILIES
from crane_benchmark.cases.case import CaseKind, EffectToHide, Site, Story, World
from crane_benchmark.cases.case_sets import (
    AWAY_SHARES,
    SHARES,
    STRENGTHS,
    CaseSet,
    apportioned,
    cases,
    with_others,
)
from crane_benchmark.cases.joints import LABORATORY_CRANE
from crane_benchmark.cases.motions import Richness
from crane_benchmark.cases.sites import drawn_effects
from crane_benchmark.cases.strangers import STORIES
from crane_sim.hiding.spec import HiddenEffect
from crane_sim.parts.parameters import load_stand_in


def test_sets_share_no_case():
    names = [case.name for which in CaseSet for case in cases(which, 60)]
    seeds = [case.seed for which in CaseSet for case in cases(which, 60)]
    assert len(set(names)) == len(set(seeds)) == 60 * len(CaseSet)


def test_kinds_have_their_shares_and_names_tell_nothing():
    drawn = cases(CaseSet.SCORING, 100)
    kinds = [case.kind for case in drawn]
    assert {kind: kinds.count(kind) for kind in CaseKind} == {
        kind: round(100 * share) for kind, share in SHARES.items()
    }
    assert len(set(kinds[:20])) > 2  # sorted by name, not by kind
    single = [case.effects[0].strength for case in drawn if case.kind is CaseKind.SINGLE]
    assert {strength: single.count(strength) for strength in STRENGTHS} == dict.fromkeys(
        STRENGTHS, 7
    )
    assert all(len({e.effect for e in c.effects}) == 2 for c in drawn if c.kind is CaseKind.PAIR)


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
    assert {case.world for case in cases(CaseSet.SCORING, 96)} == {World.LABORATORY}


def test_strangers_tell_every_story_and_their_effects_can_be_hidden():
    told = cases(CaseSet.STRANGERS, 24)
    stories = [case.story for case in told]
    assert {story: stories.count(story) for story in Story} == {
        story: 2 * STORIES.count(story) for story in Story
    }
    for case in told:
        for one in case.effects:
            HiddenEffect(**one.model_dump(exclude={"carried"}))


def test_effects_of_a_story_that_no_motion_shows_are_told_anew():
    for case in cases(CaseSet.STRANGERS, 12):
        again = with_others(case, 4)
        assert (again.name, again.seed, again.story) == (case.name, case.seed, case.story)
        assert [one.strength for one in again.effects] == [one.strength for one in case.effects]


def test_cases_away_hide_laws_of_their_own_families():
    drawn = cases(CaseSet.AWAY, 60)
    assert {case.site for case in drawn} == {Site.AWAY}
    kinds = [case.kind for case in drawn]
    assert {kind: kinds.count(kind) for kind in AWAY_SHARES} == {
        kind: round(60 * share) for kind, share in AWAY_SHARES.items()
    }
    for case in drawn:
        for one in case.effects:
            assert one.form in {form.name for form in FAMILIES[one.effect]}
        if case.world is World.FIELD:  # long after the start nothing is cold
            assert "warm_up" not in {one.effect for one in case.effects}
            assert "warm_up" not in {one.effect for one in with_others(case, 1).effects}
    assert {case.world for case in drawn} == set(World)


def test_families_have_three_laws_each_of_which_two_draws_differ():
    assert sum(not laws[0].outside for laws in FAMILIES.values()) == 10
    stand_in = load_stand_in()
    for effect, laws in FAMILIES.items():
        assert len({law.law for law in laws}) == 3
        for law in laws:
            joint = law.where.joints(LABORATORY_CRANE)[0]
            wanted = (EffectToHide(effect=effect, joint=joint, form=law.name, strength=0.04),)
            one, other = (drawn_effects(Site.AWAY, wanted, stand_in, seed)[0] for seed in (1, 2))
            assert len(one.values) == 1 + len(law.draws)
            assert (one.values[1:] != other.values[1:]) or not law.draws


def test_nothing_is_hidden_in_clean_cases_away():
    assert all(
        not case.effects and case.site is Site.AWAY for case in cases(CaseSet.AWAY_CLEAN, 20)
    )
