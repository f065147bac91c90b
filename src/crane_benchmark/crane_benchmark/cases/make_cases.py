"""First process of the benchmark: makes the bags of a set, and seals what is hidden in them."""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from crane_benchmark.cases.case import (
    TRAIN,
    VALIDATE,
    Case,
    EffectToHide,
    HiddenInRecording,
    Simulator,
    World,
    recordings,
)
from crane_benchmark.cases.case_sets import CaseSet, cases, with_others
from crane_benchmark.cases.motions import Maker, Richness
from crane_benchmark.cases.simulators import drawn_effects, drawn_machine, save_clean
from crane_benchmark.folders import Folders, done, in_processes, new, write_json
from crane_model.errors import CraneError, RangeError
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model, save_model
from crane_sim.calibration import UnmovedError, reach
from crane_sim.effects.form import InjectedForm
from crane_sim.ground_truth import ground_truth
from crane_sim.make_bag import make
from crane_trajectory.control.controller import load_gains
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import Motion

WEAKER_FACTOR = 0.5  # what is asked for next of an effect that cannot be so strong
DRAW_ATTEMPTS = 4
SETS = 2  # of three motions to train on
REDRAWN = 4  # times as many, with other effects


def make_case(folders: Folders, asked: Case) -> None:
    """Bags, the model to diagnose, and the sealed truth of one case.

    Motions on which the machine cannot carry what is to be hidden are drawn anew; what no motion
    shows, as the cushioning of an end where the boom cannot get, makes way for other effects.
    """
    case = asked
    for attempt in range(REDRAWN * DRAW_ATTEMPTS):
        if attempt and attempt % DRAW_ATTEMPTS == 0:
            case = with_others(asked, attempt)
        try:
            _make(folders, case, attempt)
            return
        except CraneError as error:
            reason = error
    raise reason


def _make(folders: Folders, case: Case, attempt: int) -> None:
    entropy = np.random.SeedSequence([20261121, *case.seed, attempt])
    of_machine, of_motions, of_effects, of_sensors, of_session = (
        int(sequence.generate_state(1)[0]) for sequence in entropy.spawn(5)
    )
    machine = load_machine()
    gains = load_gains(machine_file("controller.yaml"), machine)
    clearance = load_clearance(machine_file("clearance.yaml"))
    drawn = drawn_machine(case, machine, of_machine)
    simulated, build = drawn.simulated, drawn.build
    maker = Maker(np.random.default_rng(of_motions), machine, simulated.start, clearance)
    if case.excitation is Richness.POOR:
        train, validate = maker.poor()
        measured = maker.designed(1)[0][:1]  # how strong an effect is does not depend on the data
    elif case.world is World.FIELD:
        train, validate = maker.of_the_field(SETS)
        measured = [*validate, *train]  # not every random motion shows every effect
    else:
        train, validate = maker.designed(SETS)
        measured = train[:1]

    def injected(effects: tuple[EffectToHide, ...], motion: Motion) -> tuple[InjectedForm, ...]:
        wanted = drawn_effects(case.simulator, effects, simulated, of_effects)
        return reach(wanted, machine, simulated, replace(motion, periods=1), gains, build)

    effects, found = _strongest(injected, case.effects, measured)
    case = case.model_copy(update={"effects": effects})
    with new(folders.bags / case.name) as bags, new(folders.sealed / case.name) as sealed:
        write_json(sealed / "case.json", case.model_dump(mode="json"))
        write_json(sealed / "simulated_crane.json", simulated.model_dump(mode="json"))
        for place in (bags, sealed):
            save_model(place / "model.yaml", _model(case))
        for part in (TRAIN, VALIDATE):
            (bags / part).mkdir()
        rng = np.random.default_rng(of_session)
        for seed, recording in enumerate(recordings(rng, case, train, validate), of_sensors):
            there, name = recording.present(found), f"{recording.part}-{recording.number}"
            bag = bags / recording.part / str(recording.number)
            clean = make(
                bag, machine, simulated, recording.motion, gains, seed, there, recording.moment,
                build=build, flaws=drawn.flaws,
            )  # fmt: skip
            hidden = HiddenInRecording(effects=ground_truth(there, clean, machine))
            hidden.write(sealed / f"{name}.json")
            save_clean(sealed / f"{name}.npz", clean)


def _strongest(
    injected: Callable[[tuple[EffectToHide, ...], Motion], tuple[InjectedForm, ...]],
    effects: tuple[EffectToHide, ...],
    motions: Sequence[Motion],
) -> tuple[tuple[EffectToHide, ...], tuple[InjectedForm, ...]]:
    """As strong as asked for on the first motion that shows it so; or half of it, and so on."""
    showing = list(motions)
    for _ in range(DRAW_ATTEMPTS):
        for motion in tuple(showing):
            try:
                return effects, injected(effects, motion)
            except UnmovedError as error:  # nor would half of it do
                showing.remove(motion)
                reason: CraneError = error
            except RangeError as error:
                reason = error
        effects = tuple(
            effect.model_copy(
                update={"relative_magnitude": WEAKER_FACTOR * effect.relative_magnitude}
            )
            for effect in effects
        )
    raise reason


def _model(case: Case) -> Model:
    """The model of the suite without the terms that the case lacks."""
    model = load_model(machine_file("model.yaml"))
    kept = tuple(
        term
        for term in model.terms
        if not (term.type in case.lacks and term.only_joint == "telescope")
    )
    return replace(model, terms=kept)


def main(argv: Sequence[str] | None = None) -> int:
    """Make the bags of a set of cases, and seal what is hidden in them."""
    parser = argparse.ArgumentParser(prog="make_cases", description=main.__doc__)
    add = parser.add_argument
    add("--set", type=CaseSet, choices=list(CaseSet), required=True, dest="which")
    add("--count", type=int, required=True, help="cases of the set")
    add("--from", type=int, default=0, dest="first", help="first case to make")
    add("--to", type=int, dest="last", help="case to stop before")
    add("--simulator", type=Simulator, help="simulator of the cases (default: both)")
    add("--quick", action="store_true", help="one short recording to train on instead")
    add("--folder", type=Path, required=True, help="of the set")
    add("--round", default="", help="of answers: cases that are answered there are not made")
    add("--workers", type=int, default=1)
    arguments = parser.parse_args(argv)
    folders = Folders(arguments.folder, arguments.round)
    there = done(folders.bags) | done(folders.answers)
    wanted = cases(arguments.which, arguments.count)[arguments.first : arguments.last]
    if arguments.simulator is not None:
        wanted = [case for case in wanted if case.simulator is arguments.simulator]
    if arguments.quick:
        wanted = [case.model_copy(update={"excitation": Richness.POOR}) for case in wanted]
    waiting = {case.name: case for case in wanted if case.name not in there}
    if waiting:
        in_processes(partial(make_case, folders), waiting, arguments.workers, "bags")
    return 0


if __name__ == "__main__":
    sys.exit(main())
