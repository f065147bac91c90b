"""`rehearse`: bring-up, identification, control and sensor faults on a user's simulated crane.

All steps run as the processes that a user would start, in simulated time, around the simulated
crane of the machine folder. Results and a report are left in `--out`.
"""

import os
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from domain_coordinator import domain_id

from crane_benchmark.rehearsal import page
from crane_benchmark.rehearsal.bring_up import bring_up
from crane_benchmark.rehearsal.crane_run import EXCITATION, VALIDATION, CraneRun, identify
from crane_benchmark.rehearsal.live_node import (
    LEADING,
    Onlooker,
    experiment,
    follow,
    foreign_domain,
    start,
    stop,
)
from crane_benchmark.rehearsal.operator_node import lose_encoder
from crane_benchmark.rehearsal.outcome import Rehearsal, RehearsedParameter
from crane_benchmark.rehearsal.processes import Processes
from crane_benchmark.rehearsal.tried import (
    check_faults,
    every_kind,
    margins,
    refusal,
    sensor_faults,
    stopping_distances,
)
from crane_driver.operator.bringup.rehearsed import REHEARSAL_FILE
from crane_driver.safety.commands import load_safety
from crane_model import cli
from crane_model.errors import ConfigurationError, CraneError, DataError
from crane_model.machine import Machine
from crane_model.machine_files import DEFAULT_MACHINE, machine_digest, machine_file
from crane_model.model_file import Model, load_model
from crane_nodes import this_computer
from crane_sim.parts.parameters import SimulatedCrane, load_both
from crane_trajectory.control.choice import PD_DEAD_BAND
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import plan
from crane_trajectory.motion.periodic import load_trajectory
from crane_trajectory.run_excitation_node import ExcitationResult

MARK = ".rehearsal"  # file that marks a folder of results, which --replace may delete
VALIDATION_PERIODS = 2
STEP_NAMES = ("bring-up", "excitation", "identification", "control", "encoder fault", "trials")


class RehearsalRequest(NamedTuple):
    """The command line."""

    machine: str | None
    out: Path
    periods: int
    fault: Sequence[str]
    seed: int
    replace: bool


class IncompleteRehearsalError(CraneError):
    """A step of the rehearsal failed; the report says which one and why."""


def main(argv: Sequence[str] | None = None) -> int:
    """Rehearse bring-up, excitation, identification, control and sensor faults on the simulated
    crane of a machine folder, in simulated time; write a report.
    """
    parser = cli.command_line(prog="rehearse", description=main.__doc__)
    cli.add_machine(parser)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("runs/rehearsal"),
        help="new folder for results and report (default: %(default)s)",
    )
    parser.add_argument(
        "--periods",
        type=cli.whole(2),
        default=3,
        help="periods of the excitation to identify from (default: %(default)s)",
    )
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="TARGET.PART.KIND[=SIZE]",
        help="fault to try in a recording, as for make_bag, but without onset; may be repeated "
        "(default: each kind of one joint)",
    )
    parser.add_argument(
        "--seed", type=cli.whole(0), default=1, help="seed of sensor noise (default: %(default)s)"
    )
    parser.add_argument("--replace", action="store_true", help="delete the folder first")
    return cli.run(lambda: _rehearse(RehearsalRequest(**vars(parser.parse_args(argv)))))


def _rehearse(request: RehearsalRequest) -> None:
    name = request.machine or DEFAULT_MACHINE
    machine, simulated = load_both(name, None)
    run = CraneRun("rehearsal", name, machine_file("simulated_crane.yaml", name), request.out)
    run.check()
    check_faults(request.fault, machine)
    _make_folder(request)
    (run.folder / "bags").mkdir()
    began, digest = time.monotonic(), machine_digest(name)
    rehearsed = _Rehearsal(run, machine, simulated, request)
    rehearsed.all_steps()
    outcome = Rehearsal(
        machine=machine.name,
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        digest=digest,
        failed=rehearsed.failed,
        seed=request.seed,
        wall_seconds=round(time.monotonic() - began, 1),
        **rehearsed.results,
    )
    outcome.write(run.folder / REHEARSAL_FILE)
    html = page.render(outcome, machine, name, run.folder)
    (run.folder / page.PAGE).write_text(html, encoding="utf-8")
    print(f"report: {run.folder / page.PAGE}")
    if outcome.failed:
        raise IncompleteRehearsalError(
            f"rehearsal not complete: {', '.join(outcome.failed)} failed; see {page.PAGE}, correct "
            "the files of the machine, and rehearse again with --replace"
        )


def _make_folder(request: RehearsalRequest) -> None:
    """Make the folder of the results; only one that an earlier rehearsal wrote is deleted."""
    out = request.out
    if out.exists() and any(out.iterdir()):
        if not request.replace or not (out / MARK).exists():
            remedy = " or --replace" if (out / MARK).exists() else ""
            raise ConfigurationError(f"{out}: exists; name another folder{remedy}")
        shutil.rmtree(out)
    out.mkdir(parents=True, exist_ok=True)
    (out / MARK).touch()


@dataclass
class _Rehearsal:
    """The steps, what they found, and why those that failed did."""

    run: CraneRun
    machine: Machine
    simulated: SimulatedCrane
    request: RehearsalRequest
    failed: dict[str, str] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)

    def all_steps(self) -> None:
        """Run the steps; one that needs the result of a failed one is left out."""
        with ExitStack() as stack:
            domain = stack.enter_context(domain_id(foreign_domain))
            environment = this_computer.patient_variables(os.environ, self.run.folder)
            environment["ROS_DOMAIN_ID"] = str(domain)
            os.environ.update(environment)
            suite = stack.enter_context(Processes(self.run.folder / "logs", environment, True))
            self.run.note_true_values(suite)
            self._step("bring-up", suite, lambda: self._bring_up(suite))
            if self._step("excitation", suite, lambda: self._excite(suite, domain)) and self._step(
                "identification", suite, lambda: self._identify(suite)
            ):
                self._step("control", suite, lambda: self._control(suite, domain))
                self._step("encoder fault", suite, lambda: self._lose_encoder(suite, domain))
                self._step("trials", suite, self._try)

    def _step(self, name: str, suite: Processes, work: Callable[[], None]) -> bool:
        """Run one step and return whether it ended well; its processes are ended in any case."""
        print(f"[{STEP_NAMES.index(name) + 1}/{len(STEP_NAMES)}] {name}", flush=True)
        try:
            work()
        except (CraneError, OSError) as error:
            self.failed[name] = str(error)
            print(f"{name} failed: {error}", file=sys.stderr)
        finally:
            suite.stop_all()
        return name not in self.failed

    def _bring_up(self, suite: Processes) -> None:
        joints = load_model(self.run.file("model.yaml")).joints
        seed = self.request.seed
        self.results["valves"] = bring_up(suite, self.run, joints, self.simulated, seed)

    def _excite(self, suite: Processes, domain: int) -> None:
        run, periods = self.run, self.request.periods
        with Onlooker(suite, domain) as onlooker:
            start(suite, run, self.request.seed, listeners=LEADING)
            experiment(suite, onlooker, run, "train", EXCITATION, periods, LEADING)
            experiment(suite, onlooker, run, "validate", VALIDATION, VALIDATION_PERIODS, LEADING)
            stop(suite)

    def _identify(self, suite: Processes) -> None:
        identify(suite, self.run)
        summary, true = self.run.summary(), self.run.true_values()
        self.results["parameters"] = [
            RehearsedParameter.of(found, true[found.name])
            for found in (*summary.parameters, *summary.hydraulics)
            if found.name in true
        ]
        self.results["heldout_relative_error"] = summary.heldout_relative_error
        self.results["noise_floor"] = summary.noise_floor

    def _control(self, suite: Processes, domain: int) -> None:
        found = ExcitationResult.read(self.run.result("train")).rms_tracking_error
        tracking = {PD_DEAD_BAND: found}
        self.results["tracking"] = tracking
        if why_not := refusal(self.run.machine, load_model(self.run.fitted)):
            raise DataError(f"the fitted model does not control the crane: {why_not}")
        follow(suite, domain, self.run, self.request.seed, _unsaid)
        followed = ExcitationResult.read(self.run.result("follow"))
        tracking[self.run.controller] = followed.rms_tracking_error

    def _lose_encoder(self, suite: Processes, domain: int) -> None:
        joint = _joint_to_fail(load_model(self.run.fitted))
        lost = lose_encoder(suite, domain, self.run, self.request.seed, joint)
        self.results["lost_encoder"] = lost

    def _try(self) -> None:
        run, machine, simulated = self.run, self.machine, self.simulated
        model = load_model(run.fitted)
        safety = load_safety(run.file("safety.yaml"), machine)
        self.results["stopping"] = stopping_distances(machine, simulated, safety, model.joints)
        self.results["margins"] = margins(run.machine, model, EXCITATION)
        motion = plan(
            machine,
            load_trajectory(run.file(EXCITATION)),
            simulated.start,
            1,
            load_clearance(run.file("clearance.yaml")),
        )
        faults = self.request.fault or every_kind(machine, _joint_to_fail(model))
        tried = sensor_faults(
            *(run.machine, model, simulated, motion, faults),
            *(run.bag("faults"), self.request.seed),
        )
        self.results["faults"] = list(tried)


def _unsaid(_: str) -> None:
    """Say nothing: the step has been announced."""


def _joint_to_fail(model: Model) -> str:
    """The last joint that turns, or the last one."""
    turning = [joint for joint in model.joints if model.setting.units[joint] == "rad"]
    return (turning or list(model.joints))[-1]
