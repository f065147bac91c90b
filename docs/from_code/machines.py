"""What the pages of the machines that ship include: picture, numbers, true values."""

import io
from collections.abc import Iterator, Sequence

import matplotlib

from crane_machines import shipped
from crane_model import Machine, Model, load_machine, load_model
from crane_model.inspection.machine_command import picture, told
from crane_model.machine_files import DEFAULT_MACHINE, machine_file
from crane_sim import load_simulated_crane
from crane_sim.true_values import true_parameters

SALT = "crane"  # the same picture of the same machine


def pages() -> dict[str, str]:
    """Of each machine a picture and a text."""
    return {name: text for machine in shipped() for name, text in pages_of(machine)}


def pages_of(name: str) -> Iterator[tuple[str, str]]:
    """Names of files, and what is in them."""
    machine, model = load_machine(name), load_model(machine_file("model.yaml", name))
    yield f"machine_{name}.svg", drawn(machine)
    yield f"machine_{name}.txt", f"{looks(name, machine)}\n{known(name, machine, model)}"


def drawn(machine: Machine) -> str:
    """The picture of `machine --check`."""
    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": SALT}):
        picture(machine).savefig(file, format="svg", metadata={"Date": None}, dpi=110)
    return file.getvalue()


def looks(name: str, machine: Machine) -> str:
    """What `machine --check` shows and prints."""
    option = "" if name == DEFAULT_MACHINE else f" MACHINE={name}"
    return f"""![{machine.name} in three poses](../reference/generated/machine_{name}.svg)

The picture and these numbers are those of the command that looks at any machine file:

```bash
ros2 run crane_model machine --check {name}
```

```text
{told(machine)}
```

Its files are in `src/crane_machines/crane_machines/{name}`. Its demo, around its simulated crane:

```bash
make demo{option}
```
"""


def known(name: str, machine: Machine, model: Model) -> str:
    """The parameters that its model finds, beside what its simulated crane has."""
    plant = load_simulated_crane(machine_file("simulated_crane.yaml", name), machine)
    values = {one.name: one.value for one in true_parameters(plant, machine)}
    rows = [
        (f"`{one.name}`", one.meaning, f"{values[one.name]:.6g}", one.unit)
        for one in model.parameters
    ]
    friction = sum(len(one.parameters(model.setting)) for one in model.terms if one.is_friction())
    text = (
        f"{_measured(machine, model)} Of {10 * len(machine.joints)} inertial parameters of "
        f"{_bodies(len(machine.joints))}, {len(rows) - friction} combinations show in the forces; "
        f"friction (13) adds {friction}. The true values are those of the simulated crane; `ros2 "
        f"run crane_sim true_values --machine {name}` prints them."
    )
    return f"""## True values, and identifiable parameters

{text}

{_table(("parameter", "meaning", "true value", "unit"), rows)}
"""


def _bodies(count: int) -> str:
    return f"{count} bod{'y' if count == 1 else 'ies'}"


def _measured(machine: Machine, model: Model) -> str:
    if set(model.joints) == set(machine.joint_names):
        return "The forces of all joints are measured."
    blind = [joint for joint in machine.joint_names if joint not in model.joints]
    return (
        f"Forces are measured on {', '.join(model.joints)}, not on {', '.join(blind)}, which is "
        "taken to stand still."
    )


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
