"""The hydraulics from one bag of 60 s, and the crane simulated from its valves: aims and values."""

import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import binomtest
from unit.crane_identification.hydraulics.valve_experiments import (
    FITTED,
    MACHINE,
    PERIOD,
    play,
    recorded,
    truth,
)

from crane_identification.data.log import Log
from crane_identification.fitting import fit
from crane_identification.hydraulics.identified import identify_hydraulics
from crane_identification.hydraulics.joint_estimate import identify_joint
from crane_identification.options import Options
from crane_identification.validation.command_validation import validate_commands
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_sim.parts.parameters import StandIn, load_stand_in
from crane_sim.parts.variation import vary, vary_valves

Measured = Callable[[str, str, str], None]

EXPERIMENTS = 200
CONFIDENCE = 1.959964  # standard deviations either side of a 95 % interval
LATE = 0.010  # s, mean delay of the commands of a live recording
COVERED = (
    *("dead_zone_a", "dead_zone_b", "supply_a", "a_tank", "supply_b", "b_tank"),
    *("bulk_modulus", "dead_volume_a", "dead_volume_b", "leakage", "lag"),
)


class Aim(NamedTuple):
    """What an error may be, of a made and of a live recording; absolute in `unit`, or relative."""

    names: tuple[str, ...]
    made: float
    live: float
    unit: str = ""

    def told(self, value: float) -> str:
        return f"{value:.2g} {self.unit}" if self.unit else f"{100.0 * value:.2g} %"


AIMS = {
    "dead zones": Aim(("dead_zone_a", "dead_zone_b"), 0.001, 0.002),
    "flow gains": Aim(("supply_a", "a_tank", "supply_b", "b_tank"), 0.001, 0.001),
    "1/beta": Aim(("bulk_modulus",), 0.01, 0.02),
    "dead volumes": Aim(("dead_volume_a", "dead_volume_b"), 0.05, 0.08),
    "leakage": Aim(("leakage",), 0.15, 0.15),
    "lag": Aim(("lag",), 5e-4, 5e-4, "s"),
    "hysteresis": Aim(("hysteresis",), 3e-4, 3e-4, "of the stroke"),
}


def changed(stand_in: StandIn, frequency: float | None = None, unequal: float = 0.0) -> StandIn:
    """With valves of a frequency [Hz], whose gain is larger and smaller by a share one way."""
    edges = {
        **dict.fromkeys(("supply_a", "b_tank"), 1.0 + unequal),
        **dict.fromkeys(("supply_b", "a_tank"), 1.0 - unequal),
    }
    valves = {}
    for joint in MACHINE.joint_names:
        valve = stand_in.valves[joint]
        update: dict[str, object] = {"edges": valve.edges.model_copy(update=edges)}
        if frequency is not None:
            update["natural_frequency"] = frequency
        valves[joint] = valve.model_copy(update=update)
    return stand_in.model_copy(update={"valves": type(stand_in.valves)(**valves)})


def dynamic() -> StandIn:
    return load_stand_in(machine_file("stand_in_dynamic_friction.yaml"))


PLANTS: dict[str, tuple[Callable[[], StandIn], float]] = {
    "stock": (load_stand_in, 0.0),
    "gains +-10 %": (lambda: changed(load_stand_in(), unequal=0.1), 0.0),
    "LuGre, 12 Hz, 1 % hysteresis, gains +-10 %": (lambda: changed(dynamic(), 12.0, 0.1), 0.01),
    "LuGre, 6 Hz, 3 % hysteresis, gains +-20 %": (lambda: changed(dynamic(), 6.0, 0.2), 0.03),
}


@pytest.mark.parametrize("live", [False, True], ids=["made", "live"])
@pytest.mark.parametrize("plant", PLANTS)
def test_one_bag_tells_the_hydraulics(plant: str, live: bool, measured: Measured) -> None:
    make, width = PLANTS[plant]
    stand_in = make()
    planted = [play(joint, width) for joint in FITTED] if width else []
    log = recorded(stand_in, seed=11, planted=planted, live=live)
    found = {joint: identify_joint(MACHINE, joint, [log], PERIOD).values for joint in FITTED}
    missed = []
    for what, aim in AIMS.items():
        errors = []
        for joint in FITTED:
            true = truth(stand_in, joint, width)
            true["lag"] += LATE if live else 0.0
            for name in aim.names:
                error = abs(found[joint].values[name].value - true[name])
                errors.append(error if aim.unit else error / true[name])
        allowed = aim.live if live else aim.made
        kind = "live" if live else "made"
        measured(f"{what}, {kind}, {plant}", aim.told(allowed), aim.told(max(errors)))
        if max(errors) > allowed:
            missed.append(f"{what}: {aim.told(max(errors))}, at most {aim.told(allowed)}")
    assert not missed


class Outcome(NamedTuple):
    """Errors in standard deviations by joint and value, and p-values of lack of fit."""

    errors: np.ndarray  # (3, len(COVERED))
    p_values: np.ndarray  # (3,)


def outcome(seed: int) -> Outcome:
    """Of a drawn machine with drawn valves."""
    stand_in = vary_valves(vary(load_stand_in(), seed), MACHINE, seed)
    log = recorded(stand_in, seed=seed)
    errors, p_values = [], []
    for joint in FITTED:
        found, true = identify_joint(MACHINE, joint, [log], PERIOD).values, truth(stand_in, joint)
        values = [found.values[name] for name in COVERED]
        off = [(v.value - true[n]) / v.std_dev for n, v in zip(COVERED, values, strict=True)]
        errors.append(off)
        p_values.append(found.lack_of_fit)
    return Outcome(np.array(errors), np.array(p_values, dtype=float))


def test_intervals_cover_what_they_claim(measured: Measured) -> None:
    with multiprocessing.get_context("fork").Pool(2) as pool:
        found = pool.map(outcome, range(EXPERIMENTS), chunksize=5)
    errors = np.stack([one.errors for one in found])
    covered = np.abs(errors) < CONFIDENCE
    print(f"\ncoverage of 95 % intervals in {EXPERIMENTS} experiments (95 % binomial interval)")
    for i, name in enumerate(COVERED):
        hits, count = int(covered[:, :, i].sum()), covered[:, :, i].size
        low, high = binomtest(hits, count).proportion_ci()
        by_joint = ", ".join(f"{share:.1%}" for share in covered[:, :, i].mean(axis=0))
        print(f"  {name:14s} {hits / count:6.1%}  ({low:.1%} to {high:.1%}); by joint {by_joint}")
    single = covered.mean(axis=(0, 1))
    measured(
        f"95 % intervals that cover the hydraulics, {EXPERIMENTS} experiments, pooled",
        "93 to 97 %",
        f"{covered.mean():.1%}; single values {single.min():.1%} to {single.max():.1%}",
    )
    alarms = float((np.stack([one.p_values for one in found]) < 0.05).mean())
    measured(
        "lack of fit of the flow at p < 5 % where nothing is missing", "<= 5 %", f"{alarms:.1%}"
    )
    assert 0.93 <= covered.mean() <= 0.97


@pytest.fixture(scope="module")
def whole_crane() -> Model:
    """Mechanics and hydraulics from the same bag."""
    model, log = load_model(machine_file("model.yaml")), recorded(seed=12)
    hydraulics = identify_hydraulics(model, [log], PERIOD)
    return replace(fit(model, [log], Options(period=PERIOD)).model, hydraulics=hydraulics)


@pytest.fixture(scope="module")
def held_out() -> Sequence[Log]:
    return [recorded(seed=13, trajectory="validation_20s.yaml")]


def test_valve_commands_alone_move_it(
    whole_crane: Model, held_out: Sequence[Log], measured: Measured
) -> None:
    aims = {1.0: 0.002, 5.0: 0.001}
    found = validate_commands(whole_crane, held_out)
    assert [one.horizon for one in found] == list(aims)
    for one in found:
        aim = aims[one.horizon]
        errors = "/".join(f"{1e3 * error:.3f}" for error in one.position_rms)
        measured(
            f"open loop from commands, {one.horizon:g} s ahead, of the way "
            f"({'/'.join(one.joints)})",
            f"<= {aim:.1%}",
            f"{'/'.join(f'{share:.3%}' for share in one.relative)} ({errors} mrad, mm)",
        )
        assert (one.relative <= aim).all()


def test_it_is_faster_than_the_crane(
    whole_crane: Model, held_out: Sequence[Log], measured: Measured
) -> None:
    log = held_out[0].during(0.0, 30.0)
    validate_commands(whole_crane, [log])  # compiles
    began = time.process_time()
    found = validate_commands(whole_crane, [log])
    speed = sum(one.horizon * one.windows for one in found) / (time.process_time() - began)
    measured("simulation from commands, with preparation", ">= 20 x real time", f"{speed:.0f} x")
    assert speed >= 20.0
