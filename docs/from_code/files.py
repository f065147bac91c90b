"""The YAML files that the suite reads: keys, values and defaults, as their schemas have them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from crane_driver import SafetySettings
from crane_driver.can.mapping import Mapping
from crane_identification import ColumnMap
from crane_identification.diagnosis.flow import Usual
from crane_identification.thresholds import Thresholds
from crane_model import Machine
from crane_model.configuration import packaged
from crane_model.machine_files import machine_file
from crane_model.model_file import _ModelFile
from crane_model.sensors import SensorChain
from crane_nodes.joint_notes import JointNotes
from crane_sim import SimulatedCrane, Spec
from crane_sim.work import WorkCycle
from crane_trajectory import Clearance, DesignSettings, FourierTrajectory, SweepTrajectory
from crane_trajectory.control.controller import Gains


class Kind(NamedTuple):
    """A kind of file."""

    title: str
    about: str
    schema: type[BaseModel]
    ships: Path | None = None


KINDS = (
    Kind("Machine", "What the machine is.", Machine, machine_file("machine.yaml")),
    Kind("Model", "The terms of a model and, once fitted, their values; see "
         "[Equations](../../explanation/equations.md#a-model-file).", _ModelFile,
         machine_file("model.yaml")),
    Kind("Column map", "See [Column maps](../column_map.md).", ColumnMap),
    Kind("Fourier trajectory", "See [Excite the machine](../../how_to/excite.md#design).",
         FourierTrajectory, machine_file("validation_20s.yaml")),
    Kind("Sweep trajectory", "Written by `design --sweeps`.", SweepTrajectory),
    Kind("Design settings", "Margins and effort of `design`.", DesignSettings,
         machine_file("design.yaml")),
    Kind("Clearance", "The clearance that the boom tip keeps.", Clearance,
         machine_file("clearance.yaml")),
    Kind("Controller", "The gains of (36).", Gains, machine_file("controller.yaml")),
    Kind("Joints", "What nodes and operator need to know of each joint.", JointNotes,
         machine_file("joints.yaml")),
    Kind("Mapping", "Which signal of the bus is which joint, chamber or spool.", Mapping,
         machine_file("can.yaml")),
    Kind("Safety", "The safety functions of the driver; see [Safety](../../explanation/safety.md).",
         SafetySettings, machine_file("safety.yaml")),
    Kind("Thresholds", "What `diagnose` decides by.", Thresholds,
         packaged("crane_identification", "discrepancy.yaml")),
    Kind("Hydraulics", "What is usual of valves and oil.", Usual,
         machine_file("hydraulics.yaml")),
    Kind("Sensors", "The encoders of the laboratory crane.", SensorChain,
         machine_file("sensors.yaml")),
    Kind("Simulated crane", "All that the simulated crane is.", SimulatedCrane,
         machine_file("simulated_crane.yaml")),
    Kind("Work", "The poses of an operator's work cycle, for `make_bag --work`.", WorkCycle,
         machine_file("work.yaml", "field_excavator")),
    Kind("Injected effects", "See [Inject an effect](../../developers/injected_effects.md).", Spec),
)  # fmt: skip
INTRODUCTION = """# Input files

YAML files, in UTF-8, of 1 MB at most. Unknown keys are errors, which name the file, the line and
the key. Keys without a default are required. The comments in the shipped files explain the numbers.
"""


def pages() -> dict[str, str]:
    """All kinds of files on one page."""
    return {"files.md": "\n".join([INTRODUCTION, *map(_entry, KINDS)])}


def _entry(kind: Kind) -> str:
    schema = kind.schema.model_json_schema()
    whole = _table(schema) if "properties" in schema else f"{value_of(schema)}."
    parts = [f"## {kind.title}", kind.about, whole]
    for name, part in schema.get("$defs", {}).items():
        if "properties" in part:
            about = part.get("description", "").split("\n\n")[0].replace("\n", " ")
            parts.append(f"**{name.strip('_')}** {about}\n\n{_table(part)}")
    if kind.ships:
        text = kind.ships.read_text("utf-8")
        parts.append(f"The file that ships, `{kind.ships.name}`:\n\n```yaml\n{text}```")
    return "\n\n".join(parts) + "\n"


def _table(schema: dict[str, Any]) -> str:
    lines = ["| key | value | default |", "|---|---|---|"]
    for key, part in schema["properties"].items():
        default = "" if key in schema.get("required", ()) else f"`{_plain(part.get('default'))}`"
        lines.append(f"| `{key}` | {value_of(part)} | {default} |")
    return "\n".join(lines)


def value_of(part: dict[str, Any]) -> str:
    """The kind of value that a part of a schema asks for, in words."""
    if "$ref" in part:
        return part["$ref"].rpartition("/")[2].strip("_")
    if several := part.get("anyOf") or part.get("oneOf") or part.get("allOf"):
        kinds = [value_of(one) for one in several if one.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    if "enum" in part or "const" in part:
        return ", ".join(f"`{one}`" for one in part.get("enum", [part.get("const")]))
    kind = part.get("type", "any")
    if kind == "array":
        least = 0 if "prefixItems" in part else part.get("minItems", 0)
        return f"list of {_items(part)}" + (f", at least {least}" if least else "")
    if kind == "object" and isinstance(part.get("additionalProperties"), dict):
        return f"names, each with: {value_of(part['additionalProperties'])}"
    words = {"number": "number", "integer": "whole number", "string": "text", "object": "mapping",
             "boolean": "true or false", "any": "anything"}  # fmt: skip
    return ", ".join([words[kind], *_bounds(part)])


def _items(part: dict[str, Any]) -> str:
    if "prefixItems" in part:
        return ", ".join(map(value_of, part["prefixItems"]))
    return value_of(part["items"]) if "items" in part else "anything"


def _bounds(part: dict[str, Any]) -> Iterator[str]:
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    for key, sign in signs.items():
        if key in part:
            yield f"{sign} {part[key]:g}"


def _plain(default: Any) -> str:
    if default is None:
        return "absent"
    return str(default).lower() if isinstance(default, bool) else str(default)
