"""make demo: the whole suite live around the simulated crane, then a fitted and validated model.

Simulated crane, driver, trajectory, identification and recorder run as processes; two experiments
are recorded, the model is fitted to one bag and validated on the other. The same is done
with bags of a machine with dynamic friction (LuGre), which the model cannot represent. Then the
fitted model controls the crane on the first motion. An encoder is unplugged in motion, and the
crane returns home without it. Last, the machine gets an effect that the model lacks, and `diagnose`
finds it from bags alone. The demo calls the executables that a user would call, and writes its
results to runs/demo.
"""

import argparse
import os
import shutil
import sys
from contextlib import ExitStack

import following
import homecoming
import live
import missing
import real_time
import unplugged
from domain_coordinator import domain_id
from figures import write_figures
from laws import OUT, dynamic_law, make_bags, report_law
from outcome import FILE, Unplugged, recorded
from steps import Steps
from tables import bags_table, errors_table, table

from crane_benchmark.rehearsal.crane_run import CraneRun, identify
from crane_benchmark.rehearsal.live_node import follow, foreign_domain
from crane_benchmark.rehearsal.processes import ProcessError, Processes
from crane_benchmark.rehearsal.tried import refusal
from crane_identification.report import terminal
from crane_model import ConfigurationError, load_model
from crane_model.cli import add_machine
from crane_model.machine_files import DEFAULT_MACHINE
from crane_nodes import this_computer

SEED = 1
WIDTH = 100  # characters, where the output is no terminal


def main() -> int:
    """Run the demo; exit status 0, 1 if something failed, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(description="Run the whole suite on the simulated crane.")
    parser.add_argument("--view", action="store_true", help="show the crane in a browser")
    parser.add_argument(
        "--seed",
        type=int,
        default=SEED,
        help="seed of the noise and of the injected effect (default: 1)",
    )
    parser.add_argument(
        "--realtime",
        action="store_true",
        help="run at the pace of a real crane, without simulated time",
    )
    parser.add_argument(
        "--rate",
        type=int,
        choices=real_time.RATES,
        default=real_time.RATES[0],
        help="rate of the encoders in real time [Hz] (default: %(default)s)",
    )
    add_machine(parser)
    options = parser.parse_args()
    try:
        name = options.machine or DEFAULT_MACHINE
        laws = report_law(name), dynamic_law(name)
        laws[0].check()
    except ConfigurationError as error:
        parser.error(str(error))
    console = terminal.console(WIDTH)
    steps = Steps(console, 8 if options.realtime else 7)
    shutil.rmtree(OUT, ignore_errors=True)  # only ever written by this script
    OUT.mkdir(parents=True)
    try:
        with ExitStack() as stack:
            domain = stack.enter_context(domain_id(foreign_domain))
            environment = this_computer.patient_variables(os.environ, OUT)
            environment["ROS_DOMAIN_ID"] = str(domain)
            os.environ.update(environment)
            suite = Processes(OUT / "logs", environment, not options.realtime)
            stack.enter_context(suite)
            if options.view:
                console.print(f"open in a browser: {live.show(suite, laws[0])}")
            try:
                if options.realtime:
                    usual = 40.0 * (1 + real_time.RATES.index(options.rate))
                    with steps.step("check", "can this computer hold the rate?", usual):
                        real_time.check(suite, domain, laws[0], options.rate)
                _demo(steps, suite, domain, laws, options.seed)
            except OSError as error:
                raise ProcessError(f"{error}; logs: {OUT}/logs") from error
    except ProcessError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        bags = ", ".join(str(folder) for folder in sorted(OUT.glob("bags/*")))
        print(f"interrupted; recorded: {bags or 'nothing'}", file=sys.stderr)
        return 130
    return 0


def _demo(
    steps: Steps, suite: Processes, domain: int, laws: tuple[CraneRun, CraneRun], seed: int
) -> None:
    law, dynamic = laws
    say = steps.console.print
    for friction_law in laws:
        (friction_law.folder / "bags").mkdir(parents=True, exist_ok=True)
        friction_law.note_true_values(suite)
    with steps.step("live", "two experiments, live: driver, trajectory, identification", 90.0):
        live.record(suite, domain, law, seed, say)
    with steps.step("bags", f"two bags of a crane with {dynamic.name}", 5.0):
        make_bags(suite, dynamic)
    with steps.step("identify", "identification: fit, validation on the other bag, report", 50.0):
        identify(suite, *laws)
    outcome = recorded(law)
    say(
        table(law, outcome),
        errors_table(law.summary(), dynamic.summary()),
        bags_table(law, outcome),
    )
    followed = lost = None
    with steps.step("follow", "the fitted model controls the crane", 50.0):
        if why_not := refusal(law.machine, load_model(law.fitted)):
            say(f"not controlled by its model: {why_not}", highlight=False)
        else:
            follow(suite, domain, law, seed, say)
            followed = following.measured(law)
            following.draw(law)
            say(following.table(law, followed), f"Picture: {following.PICTURE}")
    with steps.step("unplugged", "an encoder fails in motion; home without it", 55.0):
        if followed:
            lost = _unplug(steps, suite, domain, law, seed)
    with steps.step("missing_bags", "bags of a machine with an effect the model lacks", 60.0):
        missing.make_bags(suite, law, seed)
    with steps.step("diagnose", "which effect is it? from the bags alone", 25.0):
        missing.diagnose(suite, law)
    say(missing.answer(suite), highlight=False)
    say(missing.table())
    outcome = outcome.model_copy(
        update={
            "following": followed,
            "unplugged": lost,
            "injected": missing.injected(),
            "wall_seconds": steps.seconds,
        }
    )
    outcome.write(FILE)
    write_figures(law, dynamic, outcome)
    say(f"Reports: {OUT}/report.html, {missing.ANSWER}/report.html   Measured: {FILE}")


def _unplug(
    steps: Steps, suite: Processes, domain: int, law: CraneRun, seed: int
) -> Unplugged | None:
    """An encoder that fails in motion: what became of it, or None if none may fail."""
    say = steps.console.print
    if why_not := unplugged.refusal(law):
        say(f"no encoder is unplugged: {why_not}", highlight=False)
        return None
    joint = unplugged.joint_to_lose(law)
    pulled = unplugged.unplug(suite, domain, law, seed, joint, say)
    found = homecoming.measured(law, pulled)
    homecoming.draw(law, pulled, found)
    say(homecoming.table(law, found), f"Picture: {homecoming.PICTURE}")
    return found


if __name__ == "__main__":
    sys.exit(main())
