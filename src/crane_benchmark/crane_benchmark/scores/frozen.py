"""What is frozen: everything that a verdict depends on between a bag and the answer."""

import ast
import hashlib
import json
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from crane_benchmark.folders import read_json
from crane_identification.data import bag_log
from crane_identification.diagnosis import diagnosis
from crane_identification.diagnosis.flow.usual import load_usual
from crane_identification.thresholds import load_thresholds
from crane_model.errors import ConfigurationError

RECORD = Path(__file__).with_name("frozen.json")
AWAY_GATES = RECORD.with_name("gates_away.json")  # calibrated on the plant of other make
VALUES = (
    "gates",
    "method",
    "hydraulics",
    "away_gates",
)  # parts of a state; the other one is the code
LIST_MODULES = f"""
import sys
import {bag_log.__name__}, {diagnosis.__name__}
for name, module in sorted(sys.modules.items()):
    if name.startswith("crane_") and module.__file__:
        print(module.__file__)
"""


def state() -> dict[str, Any]:
    """The gates and the method, what is usual of the hydraulics, and a digest of the code."""
    thresholds = load_thresholds()
    sources = (path.read_text(encoding="utf-8") for path in modules())
    return {
        "gates": thresholds.gates.model_dump(),
        "method": thresholds.method.model_dump(),
        "hydraulics": load_usual().model_dump(),
        "away_gates": read_json(AWAY_GATES) if AWAY_GATES.exists() else {},
        "code": digest_of_code(sources),
    }


@cache
def modules() -> tuple[Path, ...]:
    """The files of the suite that reading a bag and diagnosing it import, asked of a process that
    does nothing else.
    """
    command = [sys.executable, "-c", LIST_MODULES]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return tuple(Path(line) for line in listed.splitlines())


def digest_of_code(sources: Iterable[str]) -> str:
    """Of what modules do, by this version of Python: comments, docstrings, imports and the place of
    a module do not count; words that are printed do.
    """
    digests = (hashlib.sha256(_statements(source).encode()).hexdigest() for source in sources)
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()


def _statements(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not _says_nothing(one)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _says_nothing(node: ast.stmt) -> bool:
    """Whether a statement is an import, or a text by itself."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return isinstance(node, ast.Import | ast.ImportFrom)


def digest(found: dict[str, Any]) -> str:
    """Of a state."""
    return hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()


def differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Where two states differ, in words."""
    said = []
    for part in VALUES:
        old, new = before.get(part, {}), now[part]
        said += [
            f"{part}.{name} is {new.get(name)}, frozen at {old.get(name)}"
            for name in sorted(old.keys() | new.keys())
            if old.get(name) != new.get(name)
        ]
    return said + (["the code that decides has changed"] if before["code"] != now["code"] else [])


def require_frozen() -> str:
    """The name of the freeze; `ConfigurationError` if anything that decides is not as frozen."""
    record = read_json(RECORD)
    if said := differences(record["state"], state()):
        raise ConfigurationError(
            f"not what was frozen on {record['date']}: {'; '.join(said)}. The scoring set is for "
            "what is frozen: calibrate with --set calibration --freeze or, where answers are the "
            "same as before, carry the freeze over (crane_benchmark.scores.carry_over)"
        )
    return str(record["digest"])
