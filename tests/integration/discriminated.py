"""Ambiguity groups of a narrow motion, and the experiments that discriminate them, end to end.

A crane that hides one effect is recorded twice on motions that are narrow, above all of the other
joints, and diagnosed; `design --discriminate` finds a motion, which is recorded once; and all of
them are diagnosed.
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from crane_identification.diagnose import main as diagnose
from crane_model.configuration import save
from crane_model.machine_files import machine_file
from crane_model.terms import REGISTRY
from crane_sim.make_bag import main as make_bag
from crane_trajectory import FourierTrajectory, load_trajectory
from crane_trajectory.design import main as design

MODEL = machine_file("model.yaml")
NOISE = "pressure_noise: 5.0e+4"  # Pa: transducers of half a bar
OWN, OTHER, QUICKER = 0.3, 0.06, 0.75
"""Of the amplitudes of the joint with the effect and of the others, and of the period."""
RECORDINGS = (("first", "excitation_20s"), ("second", "validation_20s"))
HELD_OUT = "held_out"


@dataclass(frozen=True)
class HiddenCase:
    """An effect to hide, with its relative magnitude on `excitation_20s`."""

    effect: str
    joint: str
    relative_magnitude: float
    seed: int = 3

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.effect}_{self.joint}_{self.seed}"


@dataclass(frozen=True)
class Answer:
    """Effects and joints that a diagnosis names: `named`, or one of each of `classes`."""

    verdict: str
    classes: list[set[tuple[str, str]]]

    @classmethod
    def read(cls, folder: Path) -> "Answer":
        """From findings.json."""
        content = findings(folder)
        return cls(
            content["verdict"],
            [
                {(one["effect"], one["joint"]) for one in (found, *found["ambiguity_group"])}
                for found in content["findings"]
            ],
        )

    def holds(self, case: HiddenCase) -> bool:
        """Whether the effect is among what is named."""
        return any(same(one, case) for members in self.classes for one in members)

    def discriminated(self, case: HiddenCase) -> bool:
        """Whether it is named, and nothing beside it; another law of it is the same effect."""
        return (
            self.verdict == "named"
            and len(self.classes) == 1
            and all(same(one, case) for one in self.classes[0])
        )


CASES = (
    HiddenCase("load_friction", "outer_boom", 0.03, seed=3),
    HiddenCase("load_friction", "outer_boom", 0.026, seed=5),
    HiddenCase("load_friction", "inner_boom", 0.028, seed=3),
    HiddenCase("load_friction", "inner_boom", 0.028, seed=4),
    HiddenCase("load_friction", "inner_boom", 0.03, seed=5),
    HiddenCase("load_friction", "inner_boom", 0.026, seed=6),
    HiddenCase("encoder_offset", "inner_boom", 0.03, seed=3),
    HiddenCase("encoder_offset", "inner_boom", 0.028, seed=4),
    HiddenCase("encoder_offset", "inner_boom", 0.028, seed=5),
    HiddenCase("chamber_gain", "outer_boom", 0.03, seed=3),
)


def same(one: tuple[str, str], case: HiddenCase) -> bool:
    """Whether a finding is the hidden effect, by whichever law of it."""
    effect, joint = one
    kinds = []
    for name in (effect, case.effect):
        term = REGISTRY[name]
        own = {term.effect.law_of or name, *term.effect.kin} if term.effect else set()
        kinds.append(own | set(term.draws))
    return joint == case.joint and bool(kinds[0] & kinds[1])


def findings(folder: Path) -> dict[str, Any]:
    """Of a diagnosis."""
    content: dict[str, Any] = json.loads((folder / "findings.json").read_text(encoding="utf-8"))
    return content


def record(folder: Path, name: str, trajectory: Path, periods: int, seed: int) -> None:
    """A bag of the machine that hides the effect of the folder."""
    known = folder / f"{RECORDINGS[0][0]}.json"  # a label is the same machine again, and quicker
    run(
        make_bag,
        *("--trajectory", trajectory, "--periods", periods, "--seed", seed),
        *("--out", folder / name, "--inject", known if known.exists() else folder / "spec.yaml"),
        *("--ground-truth", folder / f"{name}.json", "--plant", folder / "simulated_crane.yaml"),
    )


def narrowly_recorded(folder: Path, case: HiddenCase) -> None:
    """Bags of narrow motions: two to train on, one to hold out."""
    effect = {
        "effect": case.effect,
        "joint": case.joint,
        "relative_magnitude": case.relative_magnitude,
    }
    spec = {"seed": case.seed, "effects": [effect]}
    (folder / "spec.yaml").write_text(yaml.safe_dump(spec), encoding="utf-8")
    plant = machine_file("simulated_crane.yaml").read_text(encoding="utf-8")
    noisy = re.sub("pressure_noise: .*", NOISE, plant)
    (folder / "simulated_crane.yaml").write_text(noisy, encoding="utf-8")
    for seed, (name, wide) in enumerate((*RECORDINGS, (HELD_OUT, RECORDINGS[1][1])), start=1):
        given = load_trajectory(machine_file(f"{wide}.yaml"))
        assert isinstance(given, FourierTrajectory)
        waves = given.coefficients
        waves[1:] *= np.where([joint == case.joint for joint in given.joint_names], OWN, OTHER)
        narrow = FourierTrajectory.from_coefficients(
            "narrow", QUICKER * given.period, given.joint_names, np.round(waves, 6)
        )
        save(folder / f"{wide}.yaml", narrow)
        record(folder, name, folder / f"{wide}.yaml", 2, seed)


def diagnosed(folder: Path, out: str, *more: str) -> Answer:
    """On the narrow recordings, and those named beside them."""
    train = [folder / name for name in (*(name for name, _ in RECORDINGS), *more)]
    run(
        diagnose,
        *("--model", MODEL, "--train", *train, "--validate", folder / HELD_OUT),
        *("--out", folder / out),
    )
    return Answer.read(folder / out)


def designed(folder: Path, out: str) -> dict[str, Any]:
    """The plan for what a diagnosis left open; its motion is recorded as `discriminating`."""
    run(design, "--discriminate", folder / out, "--out", folder / "discriminate.yaml")
    plan: dict[str, Any] = json.loads((folder / "discriminate.json").read_text(encoding="utf-8"))
    record(folder, "discriminating", folder / "discriminate.yaml", plan["periods"], 4)
    return plan


def run(command: Any, *arguments: object) -> None:
    """A command that must succeed."""
    assert command([str(one) for one in arguments]) == 0
