"""How a reader walks who follows one fit, or one diagnosis, from function to function.

Each function of the suite counts where it is first reached. A visit is a change of module; a return
is a visit to a module that was left before. Fewer returns, fewer places to keep in mind.
"""

import sys
from collections.abc import Callable
from itertools import groupby
from types import CodeType, FrameType
from typing import Any

import pytest

from crane_identification import Log, Options, fit, read_bag
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.thresholds import load_thresholds
from crane_model import Model, load_model
from crane_model.machine_files import machine_file
from crane_sim.make_bag import main as make_bag

RETURNS_OF_FIT = 22
RETURNS_OF_DIAGNOSIS = 58
"""To modules of crane_identification; more, and rooms that are one room have been parted."""
WALK = (
    "{functions:.0f} functions, {visits:.0f} visits to {modules:.0f} modules, {returns:.0f} "
    "returns, {own:.0f} of them to crane_identification"
)


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(machine_file("model.yaml"))


@pytest.fixture(scope="module")
def logs(model: Model, tmp_path_factory: pytest.TempPathFactory) -> list[Log]:
    """Two recordings of the simulated crane, of different noise."""
    trajectory = str(machine_file("excitation_20s.yaml"))
    out = [tmp_path_factory.mktemp("bags") / f"bag_{seed}" for seed in (1, 2)]
    for seed, path in enumerate(out):
        words = ["--trajectory", trajectory, "--periods", "4", "--seed", str(seed)]
        assert make_bag([*words, "--out", str(path)]) == 0
    return [read_bag(path, model.joints) for path in out]


class Walk:
    """The modules of the suite's functions, in the order in which these are first called."""

    def __init__(self) -> None:
        self._seen: set[CodeType] = set()
        self.modules: list[str] = []

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        code, module = frame.f_code, str(frame.f_globals.get("__name__"))
        if event != "call" or not module.startswith("crane_") or code in self._seen:
            return
        self._seen.add(code)
        # Not comprehensions, nor the methods that dataclasses generate: nobody reads those.
        if not (code.co_name.startswith("<") or code.co_filename.startswith("<")):
            self.modules.append(module)

    def of(self, work: Callable[[], object]) -> "Walk":
        """The walk through `work`."""
        sys.setprofile(self)
        try:
            work()
        finally:
            sys.setprofile(None)
        return self

    def returns(self, package: str) -> int:
        """To modules of a package, others left aside."""
        visits = [key for key, _ in groupby(m for m in self.modules if m.startswith(package))]
        return len(visits) - len(set(visits))

    @property
    def numbers(self) -> dict[str, int]:
        """Those of `WALK`."""
        visits = [module for module, _ in groupby(self.modules)]
        return {
            "functions": len(self.modules),
            "visits": len(visits),
            "modules": len(set(visits)),
            "returns": self.returns("crane_"),
            "own": self.returns("crane_identification"),
        }


def test_walk_through_a_fit(model: Model, logs: list[Log], measured) -> None:
    walk = Walk().of(lambda: fit(model, logs[:1]))
    measured("walk through fit", f"{RETURNS_OF_FIT} returns", WALK, **walk.numbers)
    assert len(walk.modules) > 100
    assert walk.returns("crane_identification") <= RETURNS_OF_FIT


def test_walk_through_a_diagnosis(model: Model, logs: list[Log], measured) -> None:
    training, held_out = logs[:1], logs[1:]
    thresholds = load_thresholds()
    walk = Walk().of(lambda: diagnose(model, training, held_out, Options(), thresholds))
    measured("walk through diagnose", f"{RETURNS_OF_DIAGNOSIS} returns", WALK, **walk.numbers)
    assert walk.returns("crane_identification") <= RETURNS_OF_DIAGNOSIS
