"""Tables of measured figures, in the pages of the manual as they are committed: `make figures`.

Takes what commands have measured (runs/) into docs/measured, and writes the tables of the pages
anew. A table stands between `<!-- measured: NAME ... -->` and `<!-- end -->`; a name is that of a
file in docs/measured, or of a table made from what the suite ships. What no page shows stays out.
"""

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from crane_benchmark.measured import MeasuredFigures, MeasuredRow, write
from crane_machines import shipped
from crane_model.configuration import load
from crane_model.machine_files import machine_file
from crane_trajectory import FourierTrajectory
from from_code import imports

ROOT = Path(__file__).resolve().parents[2]
MEASURED = ROOT / "docs" / "measured"
SOURCES = (
    ("demo", "demo/figures.json"),
    *((f"demo_{name}", f"demo/figures_{name}.json") for name in shipped()),
    ("study", "study/figures.json"),
    ("discrepancy_primary", "discrepancy_benchmark/scoring/*/primary/figures.json"),
    ("discrepancy_independent", "discrepancy_benchmark/scoring/*/independent/figures.json"),
    ("observer", "observer/observer.json"),
    ("loads", "observer/loads.json"),
    ("sensors_stock", "observer/sensors_stock.json"),
    ("sensors_hard", "observer/sensors_hard.json"),
    ("", "bench/*.json"),  # by their own names
)
"""Names in docs/measured, and what becomes of them in runs."""
TABLE = re.compile(r"(<!-- measured: ([^>]+) -->\n).*?(<!-- end -->)", re.DOTALL)
NO_BREAK_HYPHEN = "\u2011"
BENCH = "make bench"  # of many tests: each file has figures of its own
TRAJECTORIES = ("excitation_20s", "excitation_66s", "validation_20s")


def main() -> int:
    """Take over what was measured, and write it into the pages."""
    texts = [page.read_text("utf-8") for page in pages()]
    shown = {name for text in texts for name in names_on(text)}
    for name, pattern in SOURCES:
        for source in sorted((ROOT / "runs").glob(pattern), key=lambda path: path.stat().st_mtime):
            if (known := name or source.stem) in shown:
                take_over(source, MEASURED / f"{known}.json")
            else:
                print(f"{source}: no page has <!-- measured: {known} -->, not taken over")
    count_imports(MEASURED / "imports.json")
    for page in pages():
        text = page.read_text("utf-8")
        if (new := rendered(text)) != text:
            page.write_text(new, "utf-8")
            print(f"written: {page.relative_to(ROOT)}")
    return 0


def take_over(source: Path, target: Path) -> None:
    """Put figures in the place of those that were measured before, if they are as many."""
    found = MeasuredFigures.read(source)
    if target.exists():
        before = MeasuredFigures.read(target)
        if found == before or found.date < before.date:
            return
        if len(found.rows) < len(before.rows):
            print(f"{source}: has fewer rows than {target}, not taken over; measure all of it")
            return
    found.write(target)
    print(f"taken over: {source}, measured by {found.command} on {found.date}")


def count_imports(target: Path) -> None:
    """How the components import each other now."""
    found = list(imports.Imports.of(ROOT).rows())
    if not target.exists() or MeasuredFigures.read(target).rows != found:
        write(target, "make figures", found, imports.COLUMNS)


def pages() -> list[Path]:
    """All pages that may hold tables."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")),
            *sorted((ROOT / "docs").glob("[!_]*/*.md"))]  # fmt: skip


def names_on(text: str) -> list[str]:
    """The names of the figures that a page shows."""
    return [name for _, names, _ in TABLE.findall(text) for name in names.split()]


def rendered(text: str) -> str:
    """A page with its tables as they are measured."""
    return TABLE.sub(lambda found: f"{found[1]}\n{table(found[2].split())}\n{found[3]}", text)


def table(names: Sequence[str]) -> str:
    """One table of the figures with these names; those that were not measured yet are left out."""
    names = [one for one in names if one in MADE or (MEASURED / f"{one}.json").exists()]
    if not names:
        return "Not measured yet.\n"
    files = [figures(name) for name in names]
    columns = files[0].columns
    lines: list[list[str]] = []
    for name, one in zip(names, files, strict=True):
        if one.columns != columns:
            raise ValueError(f"{name}: has the columns {one.columns}, {names[0]} {columns}")
        command = f"{name}.py" if one.command == BENCH else one.command
        date = one.date.partition(" ")[0].replace("-", NO_BREAK_HYPHEN)
        told = f"`{command}`" + (f", {date}" if date else "")
        for row in one.rows:
            lines.append([*row.shown, told])
            told = "the same"
    used = [k for k in range(len(columns) + 1) if any(line[k] for line in lines)]
    rows = [[*columns, "command"], ["---"] * (len(columns) + 1), *lines]
    return "".join(f"| {' | '.join(row[k] for k in used)} |\n" for row in rows)


def figures(name: str) -> MeasuredFigures:
    """The figures with that name."""
    if name in MADE:
        return MADE[name]()
    return MeasuredFigures.read(MEASURED / f"{name}.json")


def trajectories() -> MeasuredFigures:
    """The figures of merit in the trajectories that the suite ships."""
    shown = {
        "raw": "condition_number",
        "column-normalised": "condition_number_normalised",
        "inertial only": "condition_number_inertial",
    }
    of_report = {what: key.replace("number", "number_report") for what, key in shown.items()}
    rows = []
    for name in TRAJECTORIES:
        one = load(machine_file(f"{name}.yaml"), FourierTrajectory)
        merit = one.figures_of_merit
        sigmas = {key: v for key, v in merit.items() if key.startswith("relative_std_dev.")}
        worst = max(sigmas, key=lambda key: sigmas[key])
        values = {key: merit[key] for key in (*shown.values(), *of_report.values())}
        rows.append(
            MeasuredRow(
                cells=[
                    f"`{name}.yaml`",
                    f"{one.period:g} s, {one.harmonics}",
                    *(f"{{{key}:.3g}}" for key in shown.values()),
                    ", ".join(f"{{{key}:.3g}}" for key in of_report.values()),
                    f"{{worst:.1%}} (`{worst.partition('.')[2]}`)",
                ],
                values=values | {"worst": sigmas[worst]},
            )
        )
    columns = ["file", "period, harmonics", *shown, "the same for (9)", "worst predicted σ"]
    return MeasuredFigures(
        command="crane_trajectory design", date="", commit="", columns=columns, rows=rows
    )


MADE: dict[str, Callable[[], MeasuredFigures]] = {"trajectories": trajectories}

if __name__ == "__main__":
    sys.exit(main())
