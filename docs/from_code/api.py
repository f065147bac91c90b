"""The Python API: what programs use, with the docstrings in it."""

from importlib import import_module

MODULES = {
    "Model": (
        "crane_model.model_file",
        "crane_model.machine",
        "crane_model.record",
        "crane_model.dynamics",
        "crane_model.kinematics",
        "crane_model.simulation",
    ),
    "Terms": ("crane_model.terms.term", "crane_model.terms.joint_term"),
    "Bags": ("crane_bags.reader", "crane_bags.writer"),
    "Trajectories": (
        "crane_trajectory.motion.periodic",
        "crane_trajectory.motion.motion",
        "crane_trajectory.motion.check",
        "crane_trajectory.excitation.criterion",
        "crane_trajectory.control.controller",
    ),
    "Identification": (
        "crane_identification.data.log",
        "crane_identification.data.column_map",
        "crane_identification.data.recording_log",
        "crane_identification.options",
        "crane_identification.fitting",
        "crane_identification.estimation.regression",
        "crane_identification.validation.force_validation",
    ),
    "Diagnosis": (
        "crane_identification.diagnosis.diagnosis",
        "crane_identification.thresholds",
        "crane_identification.diagnosis.findings",
    ),
    "Simulated crane": (
        "crane_sim.make_bag",
        "crane_sim.parts.parameters",
        "crane_sim.calibration",
    ),
}
INTRODUCTION = """# Python API

What programs use, with the docstrings in it. Arrays are described by their shape, (n,) being one
value a sample; units are SI.

```{{toctree}}
:maxdepth: 1

{names}
```
"""


def pages() -> dict[str, str]:
    """An index, and one page for each subject."""
    made = {
        f"api_{subject.lower().replace(' ', '_')}.md": _page(subject, modules)
        for subject, modules in MODULES.items()
    }
    names = "\n".join(name.removesuffix(".md") for name in made)
    return {"api.md": INTRODUCTION.format(names=names)} | made


def _page(subject: str, modules: tuple[str, ...]) -> str:
    entries = (
        f"## {module}\n\n```{{eval-rst}}\n.. automodule:: {module}\n"
        f"   :members: {_public(module)}\n```\n"
        for module in modules
    )
    return f"# {subject}\n\n" + "\n".join(entries)


def _public(module: str) -> str:
    """The names in a module that its package, or the folder that it is in, exports."""
    packages = module.partition(".")[0], module.rpartition(".")[0]
    exported = dict.fromkeys(
        name for package in packages for name in getattr(import_module(package), "__all__", ())
    )
    found = import_module(module)
    defined = [
        name for name, value in vars(found).items() if getattr(value, "__module__", "") == module
    ]
    return ", ".join(name for name in exported if name in defined)
