"""The Python API: what programs use, with the docstrings in it."""

MODULES = {
    "Model": (
        "crane_model.model_file",
        "crane_model.machine",
        "crane_model.record",
        "crane_model.dynamics",
        "crane_model.kinematics",
        "crane_model.simulation",
    ),
    "Terms": (
        "crane_model.terms.term",
        "crane_model.terms.joint_term",
        "crane_model.terms.catalogue",
    ),
    "Bags": ("crane_bags.reader", "crane_bags.writer"),
    "Trajectories": (
        "crane_trajectory.motion.periodic",
        "crane_trajectory.motion.motion",
        "crane_trajectory.motion.check",
        "crane_trajectory.excitation.criterion",
        "crane_trajectory.control.pd_dead_zone",
    ),
    "Identification": (
        "crane_identification.data.log",
        "crane_identification.data.bag_log",
        "crane_identification.options",
        "crane_identification.fitting",
        "crane_identification.estimation.estimate",
        "crane_identification.validation.force_validation",
    ),
    "Diagnosis": (
        "crane_identification.diagnosis.diagnosis",
        "crane_identification.thresholds",
        "crane_identification.diagnosis.findings",
    ),
    "Stand-in machine": (
        "crane_sim.make_bag",
        "crane_sim.parts.parameters",
        "crane_sim.hiding.calibrate",
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
        f"## {one}\n\n```{{eval-rst}}\n.. automodule:: {one}\n   :members:\n```\n"
        for one in modules
    )
    return f"# {subject}\n\n" + "\n".join(entries)
