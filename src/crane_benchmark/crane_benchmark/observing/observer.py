"""`observer`: what the observers are to reach, and what they reach, on machines at work."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from crane_benchmark.measured import MeasuredRow, write
from crane_benchmark.observing.machines import Observed, hard, stock
from crane_benchmark.observing.positions import FILTER, FLOW, NO_LOAD, OFF, observe
from crane_identification.identify import main as identify
from crane_model import cli
from crane_model.arguments import between, whole
from crane_model.errors import CraneError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_sim.make_bag import make
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import plan
from crane_trajectory.motion.periodic import load_trajectory

MACHINES: dict[str, tuple[Callable[[], Observed], tuple[float, ...], float]] = {
    "stock": (stock, (2e-3, 2e-3, 5e-3), 0.01),
    "hard": (hard, (10e-3, 10e-3, 20e-3), 0.06),
}
"""How it is made; aims with one encoder missing [rad, rad, m], and of the tip with all [m]."""
PERIODS = 5  # of the excitation, for the identification
COLUMNS = ("what", "aim", "position sensor", "flow alone", "without load", "NEES")


def identified(observed: Observed, seed: int, folder: Path) -> Model:
    """The model that `identify` makes of a bag of this machine; never its planted values."""
    motion = plan(
        observed.machine,
        load_trajectory(machine_file("excitation_20s.yaml")),
        observed.stand_in.start,
        PERIODS,
        load_clearance(machine_file("clearance.yaml")),
    )
    bag, out = folder / "train", folder / "model"
    make(bag, observed.machine, observed.stand_in, motion, observed.gains, seed, observed.hidden)
    given = ["--model", str(machine_file("model.yaml")), "--train", str(bag), "--out", str(out)]
    if identify(given) != 0:
        raise CraneError(f"{bag}: the machine was not identified; the lines above say why")
    return load_model(out / "model.yaml")


def measure(name: str, duration: float, seed: int) -> list[MeasuredRow]:
    """The rows of one machine."""
    make_it, aims, tip_aim = MACHINES[name]
    observed = make_it()
    with tempfile.TemporaryDirectory() as folder:
        model = identified(observed, seed, Path(folder))
    made, _ = observed.at_work(duration, seed)
    rows = []
    every = np.ones(len(model.joints), dtype=bool)
    kinds = (FILTER, FLOW, NO_LOAD)
    for j, joint in enumerate(model.joints):
        hidden = np.arange(len(model.joints)) == j
        unit = "mm" if model.setting.units[joint] == "m" else "mrad"
        found = [observe(observed, made, model, hidden, kind) for kind in kinds]
        errors = [1e3 * float(one.joints[j]) for one in found]
        what = f"{name}: {joint} without encoder [{unit}]"
        rows.append(_row(what, 1e3 * aims[j], errors, found[0].nees))
    found = [observe(observed, made, model, every, kind) for kind in kinds]
    tips = [1e2 * one.tip for one in found]
    rows.append(_row(f"{name}: tip, no encoder [cm]", 1e2 * tip_aim, tips, found[0].nees))
    found = [observe(observed, made, model, every, kind, OFF) for kind in kinds]
    tips = [1e2 * one.tip for one in found]
    what = f"{name}: tip, no encoder, {OFF} off at the start, after a minute [cm]"
    rows.append(_row(what, 1e2 * tip_aim, tips, found[0].nees))
    return rows


def _row(what: str, aim: float, values: Sequence[float], nees: float) -> MeasuredRow:
    names = ("sensor", "flow", "no_load")
    return MeasuredRow(
        cells=[what, f"{aim:g}", *(f"{{{name}:.2f}}" for name in names), "{nees:.2f}"],
        values=dict(zip(names, values, strict=True)) | {"nees": nees, "aim": aim},
    )


def missed(rows: Sequence[MeasuredRow]) -> list[str]:
    """What the position sensor does not reach, in words."""
    return [
        f"{row.cells[0]}: {row.values['sensor']:.2f}, aim {row.values['aim']:g}"
        for row in rows
        if row.values["sensor"] > row.values["aim"]
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the position sensor on machines at work: root mean square errors, beside its aims.

    The exit status is 1 where an aim is missed.
    """
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument(
        "--seconds", type=between(10.0, 36000.0), default=600.0, help="of work (default: 600)"
    )
    parser.add_argument("--seed", type=whole(0), default=1, help="of motion, loads and noise")
    parser.add_argument("--out", type=Path, help="file for the figures (JSON)")
    arguments = parser.parse_args(argv)

    def body() -> None:
        rows = [
            row for name in MACHINES for row in measure(name, arguments.seconds, arguments.seed)
        ]
        table = Table(*COLUMNS)
        for row in rows:
            table.add_row(*row.shown)
        Console().print(table)
        if arguments.out is not None:
            write(arguments.out, "make observer-benchmark", rows, COLUMNS)
        if misses := missed(rows):
            raise CraneError(f"aims are missed: {'; '.join(misses)}")

    return cli.run(body)
