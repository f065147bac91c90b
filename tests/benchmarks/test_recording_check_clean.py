"""Forty machines as they should be, half of them with a hidden effect: none is suspected.

A third has valves made for differential cylinders, a quarter runs random motions of the field.
"""

import multiprocessing

import numpy as np
from unit.crane_identification.recording_check.recorded import recorded

from crane_benchmark.cases.motions import Maker
from crane_identification.recording_check.check import check
from crane_model import RangeError, load_machine
from crane_model.machine_files import machine_file
from crane_sim import InjectedEffect, Spec, calibrate, load_simulated_crane
from crane_sim.effects.form import Form, InjectedForm
from crane_sim.effects.kernel import FORMS
from crane_sim.parts.parameters import vary, vary_valves
from crane_trajectory import load_clearance
from crane_trajectory.control.controller import load_gains

MACHINES = 40
RELATIVE_MAGNITUDE = 0.04  # of a hidden effect: rms over that of the drive force
FAULTY_CLOCK = "time_skew"  # is what it is: suspected, and not to be refused


def suspected(seed: int) -> tuple[str, list[str], bool]:
    """What the machine hides, what is suspected of its recordings, and whether decisively."""
    rng = np.random.default_rng([20261122, seed])
    machine = load_machine()
    simulated = vary(load_simulated_crane(), seed)
    if seed % 3 == 0:
        simulated = vary_valves(simulated, machine, seed)
    maker = Maker(rng, machine, simulated.start, load_clearance(machine_file("clearance.yaml")))
    train, validate = maker.of_the_field(1) if seed % 4 == 0 else maker.designed(1)
    effects: tuple[InjectedForm, ...] = ()
    if seed % 2:
        effects = _hidden(
            rng,
            machine,
            seed,
            lambda spec: calibrate(
                spec,
                machine,
                simulated,
                train[0],
                load_gains(machine_file("controller.yaml"), machine),
            ),
        )
    found = []
    for number, course in enumerate((*train, *validate)):
        checked = check(machine, recorded(simulated, course, 10 * seed + number, effects))
        found += checked.suspicions
    hidden = ", ".join(f"{one.form.effect} {one.form.name} {one.joint}" for one in effects)
    return hidden, [str(one) for one in found], any(one.decisive for one in found)


def _hidden(rng, machine, seed, effects):
    """An effect of the catalogue that this machine and motion can have at that magnitude."""
    forms: list[tuple[Form, str | None]] = [
        (form, joint)
        for forms in FORMS.values()
        for form in forms
        if not form.outside
        for joint in form.where.joints(machine) or (None,)
    ]
    for k in rng.permutation(len(forms)):
        form, joint = forms[k]
        effect = InjectedEffect(
            effect=form.effect, joint=joint, form=form.name, relative_magnitude=RELATIVE_MAGNITUDE
        )
        try:
            return effects(Spec(seed=seed, effects=(effect,)))
        except RangeError:
            continue
    raise AssertionError("no effect can be hidden")


def test_forty_clean_recordings_raise_no_suspicion(measured) -> None:
    with multiprocessing.get_context("fork").Pool(2) as pool:
        found = pool.map(suspected, range(MACHINES), chunksize=1)
    blamed = [(hidden, texts) for hidden, texts, _ in found if texts]
    for hidden, texts in blamed:
        print(f"\n{hidden or 'nothing hidden'}:", *texts, sep="\n  ")
    refused = sum(decisive for *_, decisive in found)
    measured(
        f"{MACHINES} machines as they should be, half of them with an effect: suspected; refused",
        "0; 0",
        "{suspected:.0f}; {refused:.0f}",
        suspected=len(blamed),
        refused=refused,
    )
    assert not refused
    assert all(FAULTY_CLOCK in hidden for hidden, _ in blamed)
