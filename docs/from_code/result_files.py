"""The files that the suite writes for programs: keys and units, as their schemas have them."""

from typing import Any, NamedTuple

from pydantic import BaseModel

from crane_benchmark.rehearsal.outcome import Rehearsal
from crane_benchmark.scores.summary import BenchmarkResults
from crane_driver.operator.bringup.results import RESULTS
from crane_identification.diagnosis.findings import Findings
from crane_identification.report.summary import ClusterSummary, Summary
from crane_sim.ground_truth import GroundTruth
from crane_trajectory.excitation.discrimination import DiscriminationPlan
from crane_trajectory.run_excitation_node import ExcitationResult
from from_code.files import value_of


class Kind(NamedTuple):
    """A kind of file."""

    title: str
    about: str
    schema: type[BaseModel]


KINDS = (
    Kind("summary.json", "Written by `identify`.", Summary),
    Kind("summary.json of a cluster", "Written by `identify --cluster`.", ClusterSummary),
    Kind("findings.json", "Written by `diagnose`; `diagnose --explain` prints it.", Findings),
    Kind(
        "Plan of an experiment",
        "Written by `design --discriminate`, beside its trajectory.",
        DiscriminationPlan,
    ),
    Kind("Result of an excitation", "Written by `run_excitation --result`.", ExcitationResult),
    Kind(
        "Ground truth of a bag",
        "Written by `make_bag --ground-truth`; `make_bag --inject` reads it, too.",
        GroundTruth,
    ),
    Kind("results.json", "Written by `discrepancy`, once every case is scored.", BenchmarkResults),
    Kind("rehearsal.json", "Written by `rehearse`; `bringup` reads it.", Rehearsal),
    *(
        Kind(f"result.yaml of {step}", f"Written by `bringup {step}`.", schema)
        for step, schema in RESULTS.items()
    ),
)
INTRODUCTION = """# Result files

Results for programs, in JSON or, with six digits, in YAML. Units are SI, in brackets: [-] is a
ratio or a count, [rad, m] depends on the joint, and [unit] is given by `unit` next to it. An
unknown number is `null`. Models and trajectories are [input files](files.md).
"""


def pages() -> dict[str, str]:
    """All kinds of files on one page."""
    return {"result_files.md": "\n".join([INTRODUCTION, *map(_entry, KINDS)])}


def _entry(kind: Kind) -> str:
    schema = kind.schema.model_json_schema(mode="serialization")
    parts = [f"## {kind.title}", f"{_about(schema)} {kind.about}", _table(schema)]
    for name, part in schema.get("$defs", {}).items():
        if "properties" in part:
            parts.append(f"**{name}** {_about(part)}\n\n{_table(part)}")
        else:
            words = ", ".join(f"`{one}`" for one in part["enum"])
            parts.append(f"**{name}** {_about(part)} One of {words}.")
    return "\n\n".join(parts) + "\n"


def _about(schema: dict[str, Any]) -> str:
    return " ".join(schema.get("description", "").split("\n\n")[0].split())


def _table(schema: dict[str, Any]) -> str:
    lines = ["| key | value | meaning |", "|---|---|---|"]
    for key, part in schema["properties"].items():
        meaning = " ".join(part.get("description", "").split()).replace("|", "\\|")
        lines.append(f"| `{key}` | {value_of(part)} | {meaning} |")
    return "\n".join(lines)
