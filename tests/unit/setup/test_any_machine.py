"""No code names a joint of a machine, or counts its joints: machines are data."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
FILES = [
    *(file for folder in ("src", "scripts", "docs") for file in (ROOT / folder).rglob("*.py")),
    *(file for folder in ROOT.glob("crane_*") for file in folder.rglob("*.py")),
]
CODE = sorted(file for file in FILES if "build" not in file.relative_to(ROOT).parts)
JOINTS = "slew|inner_boom|outer_boom|telescope|swing|stick|bucket"
NAMES = re.compile(rf"(?<![A-Za-z])({JOINTS})(?![a-z])")
TABLES = {"JOINTS", "PLANAR_JOINTS", "JOINT_UNITS", "PerJoint"}
SHAPED = {"arange", "empty", "full", "ones", "range", "zeros"}
COUNT = 4  # joints of the laboratory crane

ID, MODEL, SIM = (
    "crane_identification/crane_identification",
    "src/crane_model/crane_model",
    "src/crane_sim/crane_sim",
)
NO_JOINTS = (  # other fours, and other things of these names
    "src/crane_bags/crane_bags/storage.py",  # columns of an index
    f"{ID}/estimation/autoregression.py",  # results of a test
    f"{ID}/hydraulics/balance.py",  # metering edges
    f"{MODEL}/linkages.py",  # bars
    "src/crane_observer/crane_observer/payload/filter.py",  # places of states
    f"{SIM}/effects/kernel.py",  # what a load that hangs does
    f"{SIM}/parts/mujoco_model.py",  # a quaternion
)
OF_THE_REPORT = (  # what is its crane: base parameters by name, the drawing, the old file format
    *(f"{MODEL}/{name}.py" for name in ("base_parameters", "machine")),
    f"{MODEL}/terms/rigid_body.py",
    f"{ID}/estimation/consistent.py",
    *(f"{SIM}/{name}.py" for name in ("drawing/bodies", "true_values")),
    "src/crane_benchmark/",  # measured on it
)
OF_SOME_MACHINES = (  # effects of what slews or telescopes, and the signals that they follow
    *(f"{MODEL}/terms/{name}.py" for name in ("term", "gravity_and_load", "sensing")),
    *(f"{MODEL}/terms/{name}.py" for name in ("nonparametric", "friction")),
    f"{MODEL}/record.py",
    *(f"{ID}/data/{name}.py" for name in ("recording_log", "column_map", "resample")),
    *(f"{ID}/diagnosis/{name}.py" for name in ("evidence", "formula", "residuals")),
    f"{ID}/validation/motion_validation.py",
    f"{ID}/preparation/run.py",
    f"{SIM}/effects/loads.py",
)
LET_BE = (*NO_JOINTS, *OF_THE_REPORT, *OF_SOME_MACHINES)


def named(tree: ast.Module) -> Iterator[str]:
    """What of a module names a joint, or counts them."""
    told = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in told and NAMES.search(text):
                yield f"line {node.lineno}: {text!r}"
            case ast.Name(id=name) | ast.Attribute(attr=name) if name in TABLES:
                yield f"line {node.lineno}: {name}"
            case ast.Attribute(attr=name) | ast.AnnAssign(target=ast.Name(id=name)) if (
                NAMES.fullmatch(name)
            ):
                yield f"line {node.lineno}: {name}"
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=args) if (
                name in SHAPED and any(_counts(one) for one in args)
            ):
                yield f"line {node.lineno}: {ast.unparse(node)}"


def _counts(argument: ast.expr) -> bool:
    parts = argument.elts if isinstance(argument, ast.Tuple) else [argument]
    numbers = [one.value for one in parts if isinstance(one, ast.Constant)]
    return len(parts) < 3 and numbers.count(COUNT) == 1  # (4, 4) is a frame


def test_no_joint_is_named_or_counted() -> None:
    assert len(CODE) > 400
    found = {
        str(file.relative_to(ROOT)): list(named(ast.parse(file.read_text(encoding="utf-8"))))
        for file in CODE
    }
    wrong = {file: lines for file, lines in found.items() if lines and not file.startswith(LET_BE)}
    assert not wrong
    idle = [name for name in LET_BE if not any(found[f] for f in found if f.startswith(name))]
    assert not idle, "strike it out"


@pytest.mark.parametrize(
    "code",
    [
        'limits["slew"]',
        'f"gains.inner_boom.{name}"',
        "machine.limits.telescope",
        "class Gains:\n    slew: float",
        "from crane_model.machine import JOINTS\nJOINTS[0]",
        "np.zeros(4)",
        "np.zeros((4, n))",
        "range(4)",
    ],
)
def test_what_names_or_counts_joints_is_seen(code: str) -> None:
    assert list(named(ast.parse(code)))


def test_what_does_not_is_let_be() -> None:
    code = '"""The telescope slides."""\nnp.eye(4)\nnp.zeros((n, 4, 4))\nslewing = "a stickler"\n'
    assert not list(named(ast.parse(code)))
