"""The public names of each package have an example that holds, or a reason why they have none."""

import doctest
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from unit.crane_model.test_architecture import FOLDERS

RESULT = "what a function above returns"
ERROR = "an error: texts and tests show when"
NODE = "needs a ROS graph: tests/integration shows it at work"
BUS = "needs a bus or the nodes around it: tests/integration shows it at work"
LIKE = "as the one beside it"
REASONS = {
    "crane_bags": {"TopicData": RESULT, "ArrayChannel": RESULT},
    "crane_nodes": dict.fromkeys(("ros", "DriverClient", "run_managed", "declare"), NODE)
    | {"NoDriverError": ERROR},
    "crane_driver": {"Link": BUS, "SafetySettings": RESULT},
    "crane_trajectory": {
        "Clearance": RESULT, "Motion": RESULT, "SweepTrajectory": LIKE,
        "DesignSettings": RESULT, "load_design_settings": "as load_clearance",
        "Experiment": NODE, "Outcome": NODE,
    },
    "crane_benchmark": {"Case": RESULT, "Folders": "of the process that makes cases",
                        "Judgement": RESULT},
    "crane_model": {
        "ConfigurationError": ERROR, "CraneError": ERROR, "DataError": ERROR, "RangeError": ERROR,
        "Machine": RESULT, "Simulation": RESULT, "Record": "made by whatever reads recordings",
        "forward_kinematics": "tip_position is its last row", "tip_jacobian": "of tip_position",
    },
    "crane_sim": {
        "SimulatedCrane": RESULT, "SimulatedRecording": RESULT,
        "load_spec": "as load_simulated_crane", "save_simulated_crane": "as load_simulated_crane",
        "Sensors": "part of make_bag", "record": "in make_bag",
        "make": "make_bag is its command line", "calibrate": "takes half a minute",
    },
    "crane_viewer": {"View": NODE, "ground_arc": "as side_outline",
                     "reached_places": "as side_outline"},
    "crane_observer": {
        "PositionEstimator": "texts and tests show it on recordings", "SensorWatch": LIKE,
        "PoseEstimate": RESULT, "HeardRecording": RESULT, "learn": "needs minutes of recordings",
    },
    "crane_identification": {
        "FitResult": RESULT, "Estimate": RESULT, "Validation": RESULT,
        "Session": "made by fit", "ProgressBar": "draws on a terminal",
        "IdentifiedBodies": RESULT, "export_mjcf": "needs MuJoCo, which is not always installed",
        "read_bag": "the tutorials read bags", "read_recording": "as read_bag",
    },
}  # fmt: skip
WORDS = re.compile(r"\w+")


def examples(package: str) -> Iterator[tuple[ModuleType, doctest.DocTest]]:
    """All examples in the docstrings of a package."""
    folder = FOLDERS[package]
    for file in sorted(folder.rglob("*.py")):
        if "\n>>> " in (text := file.read_text("utf-8")) or "    >>> " in text:
            parts = file.relative_to(folder).with_suffix("").parts
            names = [part for part in (package, *parts) if part != "__init__"]
            module = import_module(".".join(names))
            for one in doctest.DocTestFinder().find(module):
                if one.examples:
                    yield module, one


@pytest.mark.parametrize("package", FOLDERS)
def test_examples_hold(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    found = list(examples(package))
    assert found
    for number, (_, example) in enumerate(found):
        (folder := tmp_path / str(number)).mkdir()
        monkeypatch.chdir(folder)
        failed = doctest.DocTestRunner().run(example).failed
        assert not failed, f"{example.name}: {capfd.readouterr().out}"


@pytest.mark.parametrize("package", REASONS)
def test_public_names_have_an_example_or_a_reason(package: str) -> None:
    sources = [one.source for _, example in examples(package) for one in example.examples]
    used = {word for source in sources for word in WORDS.findall(source)}
    public = set(import_module(package).__all__)
    assert public - used == REASONS[package].keys() & public - used
    stale = REASONS[package].keys() - public | REASONS[package].keys() & used
    assert not stale, "no reason is needed any more"
