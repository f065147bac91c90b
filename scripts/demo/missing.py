"""The last act: an effect that the model lacks is injected into the crane, and found in its bags.

The effect is drawn from the seed, and the ground truth is opened only after the answer.
"""

import numpy as np
import yaml
from laws import OUT
from rich.table import Table

from crane_benchmark.rehearsal.crane_run import EXCITATION, VALIDATION, WARM_S, CraneRun
from crane_benchmark.rehearsal.processes import Processes
from crane_identification.diagnosis.findings import Findings
from crane_identification.report.terminal import plain_table
from crane_model import load_machine, load_model
from crane_model.terms import REGISTRY
from crane_sim.effects.kernel import FORMS
from crane_sim.ground_truth import GroundTruth, TrueEffect

# What such motions show on any machine; `make discrepancy-benchmark` hides everything.
EFFECTS = ("stribeck", "viscous_quadratic", "load_friction", "position_friction", "hose_stiffness")
PERIODS = 3
MAGNITUDE = 0.04  # rms of the force of the effect over that of the drive
FOLDER = OUT / "missing_effect"
ANSWER = FOLDER / "diagnosis"
TRUTH = FOLDER / "truth"  # outside of the bags' folders: nobody who reads these sees it
TRAIN = {"train_0": EXCITATION, "train_1": VALIDATION, "train_2": EXCITATION}
HELD_OUT = {"held_out": VALIDATION}


def make_bags(suite: Processes, law: CraneRun, seed: int) -> None:
    """Record the machine with the effect, faster than real time."""
    effect, form, joint = drawn(law, np.random.default_rng(seed))
    spec_of_effect = {
        "effect": effect, "form": form, "joint": joint, "relative_magnitude": MAGNITUDE,
    }  # fmt: skip
    TRUTH.mkdir(parents=True)
    spec = TRUTH / "injected.yaml"
    spec.write_text(yaml.safe_dump({"seed": seed, "effects": [spec_of_effect]}), encoding="utf-8")
    bags = TRAIN | HELD_OUT
    for number, (name, trajectory) in enumerate(bags.items(), start=1):
        suite.start(
            *(name, "crane_sim", "make_bag", "--out", FOLDER / "bags" / name),
            *("--machine", law.machine, "--trajectory", law.file(trajectory)),
            *("--periods", PERIODS, "--seed", 10 * seed + number, "--running", WARM_S),
            *("--inject", spec, "--ground-truth", TRUTH / f"{name}.json"),
        )
    suite.finish(*bags)


def drawn(law: CraneRun, rng: np.random.Generator) -> tuple[str, str, str]:
    """One of EFFECTS that the machine can have, any law of its family, and one of the joints that
    can have it.
    """
    machine, known = load_machine(law.machine), load_model(law.file("model.yaml")).joints
    joints = {
        effect: [joint for joint in FORMS[effect][0].where.joints(machine) if joint in known]
        for effect in EFFECTS
    }
    effect = str(rng.choice([effect for effect in EFFECTS if joints[effect]]))
    form = str(rng.choice([form.name for form in FORMS[effect]]))
    return effect, form, str(rng.choice(joints[effect]))


def diagnose(suite: Processes, law: CraneRun) -> None:
    """Answer from the bags alone."""
    bags = FOLDER / "bags"
    suite.start(
        *("diagnose", "crane_identification", "diagnose", "--out", ANSWER),
        *("--model", law.file("model.yaml"), "--hydraulics", law.file("hydraulics.yaml")),
        *("--train", *(bags / name for name in TRAIN)),
        *("--validate", *(bags / name for name in HELD_OUT)),
    )
    suite.finish("diagnose")


def answer(suite: Processes) -> str:
    """The answer in a few lines."""
    return suite.output("explain", "crane_identification", "diagnose", "--explain", ANSWER)


def table() -> Table:
    """The answer and the ground truth, which is opened here."""
    result = plain_table("Ground truth and answer")
    for heading in ("", "effect", "joint"):
        result.add_column(heading, no_wrap=True)
    for heading in ("magnitude", "force unexplained before", "after"):
        result.add_column(heading, justify="right")
    found = Findings.read(ANSWER / "findings.json")
    true = injected()
    for effect in true:
        result.add_row(
            "injected",
            effect.effect,
            effect.joint or "all",
            f"{effect.relative_magnitude:.1%}",
            "",
            "",
        )
    for finding in found.findings:
        errors = (
            f"{error.force_relative_error:.2%}" if error else ""
            for error in (
                gap.get(finding.joint)
                for gap in (found.model_error.before, found.model_error.after)
            )
        )
        result.add_row("found", finding.effect, finding.joint, "", *errors)
        term = REGISTRY.get(finding.effect)
        forms = {*term.effect.kin, term.effect.law_of} if term and term.effect else set()
        if same := forms & {effect.effect for effect in true}:
            result.caption = f"{finding.effect}: a model form of the same effect as {min(same)}"
    if not found.findings:
        result.add_row(found.verdict, "", "", "", "", "")
    return result


def injected() -> list[TrueEffect]:
    """The ground truth; opened after the answer."""
    return GroundTruth.read(TRUTH / "held_out.json").effects
