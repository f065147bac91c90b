"""A crane that is wired otherwise than the driver believes, brought up step by step."""

import math
import signal
import subprocess
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_prefix
from integration.processes import DRIVER, IMPATIENT
from integration.workshop import OFFSETS, VALVES, WIRING, Tool, Workshop
from laboratory_crane import JOINTS

from crane_driver import VelocityFilter
from crane_driver.can.mapping import Mapping
from crane_driver.operator.bringup.results import DeadBands, Result
from crane_model import load_machine, load_model
from crane_model.configuration import load
from crane_model.machine_files import machine_file
from crane_model.sensors import in_counts
from crane_sim import Plant, load_simulated_crane
from crane_trajectory.control.controller import command, load_gains

MEASURED = ("inner_boom", "outer_boom")
QUICK = ["--seconds", "0.5", "--rate", "0.1", "--repeats", "1"]
BEYOND = 0.09  # command, at which a valve is open beyond its dead bands
SLOWLY = ["--seconds", "0.5", "--rate", "0.0125", "--repeats", "2"]  # as the slew is heavy
FAST = ["--joints", *MEASURED, *QUICK]


@pytest.fixture(scope="module")
def shop(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    one = Workshop(tmp_path_factory.mktemp("bringup"))
    try:
        drive_with(one, one.naive)
        yield one
    finally:
        one.close()


@pytest.fixture
def wired(shop: Workshop) -> Workshop:
    """With polarities that are right, though this test be run without those before it."""
    if not runs(shop, "valves"):
        drive_with(shop, shop.truth)
    return shop


@pytest.fixture
def banded(wired: Workshop) -> Workshop:
    """With dead bands, though this test be run without those before it."""
    done = {joint for path in runs(wired, "dead_band") for joint in dead_bands(path)}
    if not done >= set(MEASURED):
        moves(wired, "dead_band")
    return wired


def drive_with(shop: Workshop, mapping: Path, program: str = DRIVER) -> None:
    options = [f"bus.options:={shop.port}", f"mapping:={mapping}", "use_sim_time:=true"]
    shop.start_driver(
        "--ros-args", *(word for option in options for word in ("-p", option)), program=program
    )
    # valves: a driver that has not begun as yet cannot be ended properly
    shop.until(lambda: shop.true.keys() >= set(JOINTS) and shop.valves[0])


def moves(shop: Workshop, step: str, *options: str) -> tuple[Tool, dict[str, float]]:
    """Run a step that moves the crane; the step, and where the joints stood before."""
    before = {joint: shop.still(joint) for joint in MEASURED}
    tool = Tool(shop, step, *FAST, *options)
    assert tool.agree() == 0, tool.output
    return tool, before


def runs(shop: Workshop, step: str) -> list[Path]:
    """Folders of a step, oldest first: each try makes one."""
    return sorted((shop.folder / "bringup").glob(f"*_{step}"))


def dead_bands(run: Path) -> dict[str, DeadBands]:
    return load(run / "result.yaml", Result[DeadBands]).results


def result(shop: Workshop, step: str) -> dict[str, Any]:
    folder = runs(shop, step)[-1]
    assert (folder / f"{step}.png").stat().st_size > 5000
    return yaml.safe_load((folder / "result.yaml").read_text())["results"]


def test_encoders(shop: Workshop, measured: Callable[..., None]) -> None:
    tool = Tool(shop, "encoders", *FAST)
    for joint in MEASURED:
        tool.expect(f"{joint}: let it stand still")
        tool.answer(f"{math.degrees(shop.still(joint)):.3f}")
        tool.expect("now move it")
        tool.answer(f"{math.degrees(shop.pull(joint, 0.12)):.3f}")
    assert tool.done() == 0
    found = result(shop, "encoders")
    worst = max(abs(one["zero"] - WIRING["positions"][joint][1]) for joint, one in found.items())
    measured("zeros of encoders, with an exact inclinometer: error", "2e-4 rad", "{worst:.0e} rad",
             worst=worst)  # fmt: skip
    for joint, one in found.items():
        sign, zero = WIRING["positions"][joint]
        assert one["sign"] == sign
        assert one["zero"] == pytest.approx(zero, abs=2e-4)
        assert one["scale"] == pytest.approx(1.0, abs=0.01)


def test_a_driver_with_another_mapping_is_refused(shop: Workshop) -> None:
    tool = Tool(shop, "pressures")
    assert tool.done() == 1
    assert "the driver runs with the mapping" in tool.output
    assert str(runs(shop, "encoders")[-1] / "mapping.yaml") in tool.output
    shop.restart_driver(tool)


def test_pressures(shop: Workshop, measured: Callable[..., None]) -> None:
    tool = Tool(shop, "pressures", *FAST)
    tool.expect("Engine stopped")
    tool.answer("yes")  # though it runs
    assert tool.done() == 1
    assert "not vented" in tool.output
    shop.hands("engine=off")
    tool = Tool(shop, "pressures", *FAST)
    tool.answer("yes")
    assert tool.done() == 0
    found = result(shop, "pressures")
    worst = max(abs(one["offset"] - OFFSETS.get(name, 0.0)) for name, one in found.items())
    measured("offsets of pressures: error", "0.1 bar", "{worst:.2f} bar", worst=1e-5 * worst)
    for name, one in found.items():
        # a transducer ends at 0 bar: half of the noise of one without offset is cut off
        assert one["offset"] == pytest.approx(OFFSETS.get(name, 0.0), abs=1e4)
    shop.hands("engine=on")
    shop.restart_driver(tool)


def test_what_is_not_confirmed_moves_nothing(shop: Workshop) -> None:
    tool = Tool(shop, "valves", *FAST)
    tool.answer("y")
    assert tool.done() == 1
    assert "not confirmed" in tool.output
    assert not shop.valves[1]


def test_a_joint_that_moves_against_its_command_is_stopped(shop: Workshop) -> None:
    """Its polarity is asked for before the command has risen to its limit."""
    before = shop.still("outer_boom")
    tool = Tool(shop, "dead_band", *QUICK, "--joints", "outer_boom")
    assert tool.agree() == 1
    assert "outer_boom moves against its command" in tool.output
    assert "bringup valves" in tool.output
    assert shop.still("outer_boom") == pytest.approx(before, abs=0.02)


def test_valves(shop: Workshop) -> None:
    tool, before = moves(shop, "valves")
    for joint, one in result(shop, "valves").items():
        assert one["polarity"] == WIRING["commands"][joint]
        assert shop.still(joint) == pytest.approx(before[joint], abs=0.02)
    shop.restart_driver(tool)


def test_the_last_mapping_is_the_wiring_of_the_machine(shop: Workshop) -> None:
    found = load(runs(shop, "valves")[-1] / "mapping.yaml", Mapping)
    true = load(shop.truth, Mapping)
    for joint in JOINTS:
        assert found.commands[joint].sign == true.commands[joint].sign
        assert found.positions[joint].sign == true.positions[joint].sign
        assert found.positions[joint].zero == pytest.approx(true.positions[joint].zero, abs=2e-4)
    for name, one in true.pressures.items():
        assert found.pressures[name].zero == pytest.approx(one.zero, abs=1e4)


def test_dead_band(wired: Workshop, measured: Callable[..., None]) -> None:
    errors = []
    _, before = moves(wired, "dead_band")
    run = runs(wired, "dead_band")[-1]
    for joint, one in dead_bands(run).items():
        valve = VALVES[joint]
        for direction, found in ((1, one.positive), (-1, one.negative)):
            true = valve["dead_band"] + direction * valve["null_bias"]
            errors.append(abs(found.dead_band - true))
            assert found.dead_band == pytest.approx(true, abs=0.003)
        assert wired.still(joint) == pytest.approx(before[joint], abs=0.01)
    measured("dead bands, one repeat: error", "0.003", "{worst:.4f}", worst=max(errors))


def test_identify_takes_the_valve_of_the_slew_from_its_ramps(
    wired: Workshop, tmp_path: Path
) -> None:
    """No bag tells it: the slew has no transducers."""
    assert Tool(wired, "dead_band", *SLOWLY, "--joints", "slew").agree() == 0
    ramps = runs(wired, "dead_band")[-1] / "result.yaml"
    bag, out = tmp_path / "bag", tmp_path / "identified"
    motion = "--trajectory", machine_file("excitation_20s.yaml"), "--periods", 3, "--seed", 5
    installed("crane_sim", "make_bag", *motion, "--out", bag)
    what = "--model", machine_file("model.yaml"), "--train", bag, "--ramps", ramps, "--out", out
    installed("crane_identification", "identify", *what)
    found = load_model(out / "model.yaml").hydraulics
    assert found is not None
    assert f"slew: ramps of {date.today()}" in found.provenance
    assert set(found.joints) == set(JOINTS)
    valve, true = found.joints["slew"].valve, load_simulated_crane().valves["slew"]
    gain = true.rated_flow / math.sqrt(true.rated_drop)
    for dead_band, edge in (
        (valve.dead_band_a, valve.supply_a),
        (valve.dead_band_b, valve.supply_b),
    ):
        assert dead_band.value == pytest.approx(true.dead_band, abs=0.003)
        assert edge.value == pytest.approx(gain, rel=0.1)  # ramps take friction for no load


def installed(package: str, executable: str, *arguments: object) -> None:
    """Run it as a user does."""
    path = Path(get_package_prefix(package)) / "lib" / package / executable
    done = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def open_by(shop: Workshop, command: float) -> bool:
    """Whether the valve of the inner boom is open by more than this."""
    return shop.valves[1] and abs(shop.valves[0]["inner_boom"]) > command


def test_a_stall_costs_one_ramp(wired: Workshop) -> None:
    """The driver has a fault then, which is reset when the operator has said so."""
    told = runs(wired, "valves")
    mapping = told[-1] / "mapping.yaml" if told else wired.truth
    drive_with(wired, mapping, IMPATIENT + DRIVER)
    slowly = "--seconds", "0.5", "--rate", "0.03", "--repeats", "1"
    tool = Tool(wired, "dead_band", *slowly, "--joints", "inner_boom")
    tool.answer("yes")
    wired.until(lambda: open_by(wired, 0.06))
    tool.process.send_signal(signal.SIGSTOP)
    wired.until(lambda: not wired.valves[1])
    tool.process.send_signal(signal.SIGCONT)
    assert tool.agree() == 0, tool.output
    assert "only this ramp of inner_boom is repeated" in tool.output
    drive_with(wired, mapping)
    assert "Reset the fault and repeat this ramp?" in tool.output
    (found,) = dead_bands(runs(wired, "dead_band")[-1])
    assert found == "inner_boom"


def test_ctrl_c_while_it_moves_is_neutral_disabled_and_the_end(wired: Workshop) -> None:
    before = runs(wired, "dead_band")
    tool = Tool(wired, "dead_band", *FAST)
    tool.answer("yes")
    wired.until(lambda: open_by(wired, BEYOND))
    tool.process.send_signal(signal.SIGINT)
    tool.done()
    wired.until(lambda: not wired.valves[1] and not any(wired.valves[0].values()))
    assert tool.process.returncode == 130
    assert runs(wired, "dead_band") == before


def test_gains(banded: Workshop, measured: Callable[..., None]) -> None:
    controller = machine_file("controller.yaml")
    moves(banded, "gains", "--controller", str(controller))
    path = runs(banded, "gains")[-1] / "controller.yaml"
    found, base = load_gains(path, load_machine()), load_gains(controller, load_machine())
    assert found["slew"] == base["slew"]
    assert found["inner_boom"] != base["inner_boom"]
    errors, end_speed = tracked(banded.plant, path)
    measured("a sine of 0.1 rad by the first gains: error", "0.02 rad", "{worst:.3f} rad",
             worst=np.abs(errors).max())  # fmt: skip
    assert np.abs(errors).max() < 0.02
    assert np.abs(end_speed).max() < 1e-3


def test_status_tells_what_has_been_done(shop: Workshop) -> None:
    tool = Tool(shop, "status")
    assert tool.done() == 0
    assert "done: encoders, pressures, valves, dead_band, gains; to be done: nothing" in tool.output
    assert "_valves/mapping.yaml" in tool.output


def tracked(plant_file: Path, controller: Path) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 2) of a sine of 0.1 rad and 0.03 Hz, and speeds (m, 2) after it, by new gains."""
    parameters, machine = load_simulated_crane(plant_file), load_machine()
    plant = Plant(parameters, machine, parameters.start)
    gains = load_gains(controller, load_machine()).arrays
    chain, density = parameters.sensors, parameters.jerk_density
    speed_filter = VelocityFilter(
        [density[joint] for joint in JOINTS], [chain.encoder_resolution[joint] for joint in JOINTS]
    )
    columns = [JOINTS.index(joint) for joint in MEASURED]
    period, frequency, u = 0.005, 2.0 * np.pi * 0.03, np.zeros(4)
    errors, speeds = [], []
    moving = 2.0 * np.pi / frequency
    for time_ in np.arange(0.0, moving + 4.0, period):
        phase = frequency * min(time_, moving)
        reference, reference_speed = parameters.start.copy(), np.zeros(4)
        reference[columns] += 0.05 * (1.0 - np.cos(phase))
        reference_speed[columns] = 0.05 * frequency * np.sin(phase)
        plant.advance(u, period)
        position = in_counts(plant.q, chain.counts(JOINTS))
        _, speed, _ = speed_filter.update(time_, position)
        if np.isfinite(speed).all():
            u = command(gains, position, speed, reference, reference_speed, machine.units)
        errors.append((plant.q - reference)[columns])
        if time_ > moving + 3.0:
            speeds.append(plant.v[columns])
    return np.array(errors), np.array(speeds)
