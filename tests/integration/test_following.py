"""A controller that uses the model, live: what it does when its transducers or its model fail."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from integration.driver_stage import Stage, made
from integration.experiments import PERIOD, SHORT, Experiments
from integration.shown_pressures import SHOWN, shown_pressures
from known_crane import write_known_model
from lifecycle_msgs.msg import Transition
from std_srvs.srv import Trigger

from crane_interfaces.action import RunExcitation
from crane_model import load_model
from crane_trajectory import Outcome
from crane_trajectory.motion.periodic import Probe

FALLEN_BACK = "pressures lost: using the load of the model"
BEGUN = 6.0  # s of the goal
CYCLE = 0.005  # s
GIVEN = 2e-3  # rad, tolerance: half a tenth of it is two counts, which a crane at rest may creep
LARGEST_STEP = 0.25  # of the command from cycle to cycle: across both dead bands


@pytest.fixture(scope="module")
def crane(stage: Stage, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Experiments]:
    """Led by adaptive_flow, and shown pressures that are passed on, or not."""
    folder = tmp_path_factory.mktemp("trajectory")
    model = write_known_model(folder / "model.yaml")
    one = Experiments(
        stage,
        folder,
        *("-p", "law:=adaptive_flow", "-p", f"model:={model}"),
        *("-p", f"learnt_output:={folder / 'learnt.yaml'}"),
        *("-r", f"cylinder_pressures:={SHOWN}"),
    )
    yield one
    stage.end(one.process)


def without_pressures(crane: Experiments) -> RunExcitation.Result:
    """The result of a completed goal under which the pressures are lost."""
    crane.commands.clear()
    with shown_pressures(crane.stage) as pressures:
        crane.stage.enabled()
        ending = crane.send(periods=2).get_result_async()
        crane.stage.until(lambda: any(one.elapsed > BEGUN for one in crane.feedback))
        pressures.lose()
    crane.stage.until(ending.done)
    result = ending.result().result
    assert result.outcome == Outcome.COMPLETED, result.message
    return result


def test_without_pressures_it_continues_by_the_simpler_law(crane: Experiments) -> None:
    stage = crane.stage
    told: list[str] = []

    def diagnosed(message: DiagnosticArray) -> None:
        for one in message.status:
            if one.name == "trajectory: experiment":
                told.extend(pair.value for pair in one.values if pair.key == "controller")

    stage.listen(DiagnosticArray, "/diagnostics", diagnosed)
    result = without_pressures(crane)
    assert any(FALLEN_BACK in one for one in told), told
    assert FALLEN_BACK in result.message
    errors = dict(zip(result.name, result.rms_tracking_error, strict=True))
    assert max(errors.values()) < 2e-3, errors
    assert crane.largest_step() < LARGEST_STEP
    crane.holds_still()


def test_what_it_has_learnt_is_told_and_saved(crane: Experiments) -> None:
    stage = crane.stage
    values = stage.diagnostics["trajectory: experiment"][2]
    assert any(name.startswith("learnt, outer_boom extending") for name in values)
    client = stage.node.create_client(Trigger, "/trajectory/save_learnt")
    stage.until_there(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    stage.until(answer.done)
    assert answer.result().success, answer.result().message
    saved = load_model(crane.folder / "learnt.yaml").hydraulics
    assert saved is not None
    assert "learnt while following" in saved.provenance


def test_a_law_changes_only_at_rest_and_a_wrong_model_is_refused(
    crane: Experiments, tmp_path: Path
) -> None:
    done, why = crane.set("law", "flow_feedforward")
    assert not done
    assert "deactivate it and clean it up first" in why
    crane.change(Transition.TRANSITION_DEACTIVATE)
    crane.change(Transition.TRANSITION_CLEANUP)
    other = write_known_model(tmp_path / "other.yaml", "single_axis")
    assert crane.set("model", str(other)) == (True, "")
    assert not crane.tries(Transition.TRANSITION_CONFIGURE)
    assert "the node is unconfigured" in crane.refused().message
    assert crane.set("model", str(crane.folder / "learnt.yaml")) == (True, "")
    assert crane.set("law", "flow_feedforward") == (True, "")
    crane.change(Transition.TRANSITION_CONFIGURE)
    crane.change(Transition.TRANSITION_ACTIVATE)


def test_a_tenth_of_the_tolerance_ends_it(crane: Experiments) -> None:
    assert crane.set("tracking_tolerance.outer_boom", GIVEN) == (True, "")
    result = crane.ended(Outcome.TRACKING_LOST)
    assert f"is beyond the tolerance {GIVEN / 10:g} rad" in result.message
    crane.holds_still()


def test_computed_force_leads_a_motion_with_a_probe_on_top(crane: Experiments) -> None:
    """The law that the report names, and the pseudo-random command that tells how fast valves are:
    what the node commands follows the probe's steps.
    """
    crane.change(Transition.TRANSITION_DEACTIVATE)
    crane.change(Transition.TRANSITION_CLEANUP)
    assert crane.set("law", "computed_force") == (True, "")
    assert crane.set("tracking_tolerance.outer_boom", 0.2) == (True, "")
    crane.change(Transition.TRANSITION_CONFIGURE)
    crane.change(Transition.TRANSITION_ACTIVATE)
    probe = Probe(amplitude=0.02)
    file = crane.folder / "probed.yaml"
    file.write_text(yaml.safe_dump({**SHORT, "probe": probe.model_dump()}))
    with shown_pressures(crane.stage):
        result = crane.ended(Outcome.COMPLETED, file)
    order = list(SHORT["joints"])
    errors = dict(zip(result.name, result.rms_tracking_error, strict=True))
    assert max(errors.values()) < 10e-3, errors
    assert likeness(crane, probe, order) > 0.8
    assert likeness(crane, probe, [*order[1:], order[0]]) < 0.25  # as by chance: none is in place


def likeness(crane: Experiments, probe: Probe, order: list[str]) -> float:
    """The correlation of the changes of all commands with those of the probe of the joints in this
    order, which began at the time at which that is largest.
    """
    time = np.array([made(one) for one in crane.commands])
    commands = [[one.command[one.name.index(joint)] for joint in order] for one in crane.commands]
    change = np.diff(commands, axis=0)
    found = [0.0]
    for begin in np.arange(time[0], time[-1] - PERIOD, CYCLE):
        within = (time >= begin) & (time < begin + PERIOD)
        steps = np.where(within[:, np.newaxis], probe.course(time - begin, PERIOD, len(order)), 0.0)
        moved, leading = np.diff(steps, axis=0), within[1:] & within[:-1]
        if np.count_nonzero(leading) < 0.5 * PERIOD / CYCLE:
            continue  # few can be alike by chance
        found.append(float(np.corrcoef(change[leading].ravel(), moved[leading].ravel())[0, 1]))
    return max(found)
