"""make demo: the whole suite live around the stand-in machine, then a fitted and validated model.

Simulated crane, driver, trajectory, identification and recorder run as processes; two experiments
are recorded, the model is fitted to one bag and validated on the other. The same from bags of a
machine with dynamic friction (LuGre), made faster than real time: the model cannot represent that
law, and the bias this brings is seen. Then the fitted model leads the crane through the first
motion again. An encoder is unplugged in mid-motion, and the crane goes home without it. Last, the
machine gets an effect that the model lacks, and its bags alone must tell which. Everything is done
by the executables that a user would call; results are left in runs/demo.
"""

import argparse
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import following
import homecoming
import live
import missing
import unplugged
from figures import write_figures
from laws import OUT, Law, dynamic_law, identify, make_bags, report_law
from outcome import FILE, Following, Unplugged, recorded
from processes import DemoError, Processes
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from tables import bags_table, errors_table, table

from crane_identification.report import terminal
from crane_model.cli import add_machine
from crane_model.errors import ConfigurationError
from crane_model.machine_files import DEFAULT_MACHINE
from crane_nodes import this_computer

SEED = 1
WIDTH = 100  # characters, where the output is no terminal


class Phases:
    """Wall time of each phase, shown while it runs."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.seconds: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str, description: str) -> Iterator[None]:
        """Show and time one phase."""
        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        start = time.monotonic()
        with Progress(*columns, console=self.console) as progress:
            task = progress.add_task(description, total=1)
            yield
            progress.update(task, completed=1)
        self.seconds[name] = round(time.monotonic() - start, 2)


def main() -> int:
    """Run the demo; exit status 0, 1 if something failed, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(description="The whole suite at work.")
    parser.add_argument("--view", action="store_true", help="show it in a browser meanwhile")
    parser.add_argument("--seed", type=int, default=SEED, help="of noise and of what is hidden")
    parser.add_argument(
        "--realtime", action="store_true", help="at the pace of a real crane, not simulated time"
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
    phases = Phases(console)
    shutil.rmtree(OUT, ignore_errors=True)  # only ever written by this script
    domain = live.own_domain()
    OUT.mkdir(parents=True)
    variables = this_computer.patient_variables(os.environ, OUT)
    environment = {"ROS_DOMAIN_ID": str(domain)} | variables
    os.environ.update(environment)
    try:
        with Processes(OUT / "logs", environment, not options.realtime) as suite:
            if options.view:
                console.print(f"open in a browser: {live.show(suite, laws[0])}")
            _demo(console, phases, suite, domain, laws, options.seed)
    except DemoError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        bags = ", ".join(str(folder) for folder in sorted(OUT.glob("bags/*")))
        print(f"interrupted; recorded: {bags or 'nothing'}", file=sys.stderr)
        return 130
    return 0


def _demo(
    console: Console,
    phases: Phases,
    suite: Processes,
    domain: int,
    laws: tuple[Law, Law],
    seed: int,
) -> None:
    law, dynamic = laws
    for one in laws:
        (one.folder / "bags").mkdir(parents=True)
        one.note_planted(suite)
    start = time.monotonic()
    live.record(suite, domain, law, seed, console.print)
    phases.seconds["live"] = round(time.monotonic() - start, 2)
    with phases.phase("bags", f"two bags of {dynamic.name}, faster than real time"):
        make_bags(suite, dynamic)
    with phases.phase("identify", "identification: fit, validation on the other bag, report"):
        identify(suite, *laws)
    outcome = recorded(law)
    console.print(
        table(law, outcome),
        errors_table(law.summary(), dynamic.summary()),
        bags_table(law, outcome),
    )
    followed = _follow(console, phases, suite, domain, law, seed)
    lost = _unplug(console, phases, suite, domain, law, seed) if followed else None
    with phases.phase("missing_bags", "last act: bags of a machine with an effect the model lacks"):
        missing.make_bags(suite, law, seed)
    with phases.phase("diagnose", "which effect is it? asked of the bags alone"):
        missing.diagnose(suite, law)
    console.print(missing.answer(suite), highlight=False)
    console.print(missing.table())
    outcome = outcome.model_copy(
        update={
            "following": followed,
            "unplugged": lost,
            "hidden": missing.hidden(),
            "wall_seconds": phases.seconds,
        }
    )
    outcome.write(FILE)
    write_figures(law, dynamic, outcome)
    console.print(f"Reports: {OUT}/report.html, {missing.ANSWER}/report.html   Measured: {FILE}")


def _follow(
    console: Console, phases: Phases, suite: Processes, domain: int, law: Law, seed: int
) -> Following | None:
    """The fitted model leads the crane: how well, or None where it cannot."""
    if refusal := following.refusal(law):
        console.print(f"not led by its model: {refusal}", highlight=False)
        return None
    start = time.monotonic()
    live.follow(suite, domain, law, seed, following.CONTROLLER, console.print)
    followed = following.measured(law)
    following.draw(law)
    phases.seconds["follow"] = round(time.monotonic() - start, 2)
    console.print(following.table(law, followed), f"Picture: {following.PICTURE}")
    return followed


def _unplug(
    console: Console, phases: Phases, suite: Processes, domain: int, law: Law, seed: int
) -> Unplugged | None:
    """An encoder lost in motion: what became of it, or None where none may be."""
    joint = unplugged.joint_to_lose(law)
    if not joint:
        console.print("no encoder is unplugged: safety.yaml permits no substitute")
        return None
    start = time.monotonic()
    pulled = unplugged.unplug(suite, domain, law, seed, joint, console.print)
    found = homecoming.measured(law, pulled)
    homecoming.draw(law, pulled, found)
    phases.seconds["unplugged"] = round(time.monotonic() - start, 2)
    console.print(homecoming.table(law, found), f"Picture: {homecoming.PICTURE}")
    return found


if __name__ == "__main__":
    sys.exit(main())
