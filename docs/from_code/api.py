"""The Python API: what programs use, with the docstrings in it."""

from types import ModuleType

from crane_bags import reader, writer
from crane_identification import fitting, options, thresholds
from crane_identification.data import bag_log, log
from crane_identification.diagnosis import diagnosis, findings
from crane_identification.estimation import estimate
from crane_identification.validation import force_validation
from crane_model import dynamics, kinematics, machine, model_file, record, simulation
from crane_model.terms import effect, joint_term, own, term
from crane_sim import make_bag
from crane_sim.hiding import calibrate
from crane_sim.parts import parameters, variation
from crane_trajectory.control import controller
from crane_trajectory.excitation import merit
from crane_trajectory.motion import check, fourier, motion, sweep

MODULES = {
    "Model": (model_file, machine, record, dynamics, kinematics, simulation),
    "Terms": (term, joint_term, effect, own),
    "Bags": (reader, writer),
    "Trajectories": (fourier, sweep, motion, check, merit, controller),
    "Identification": (log, bag_log, options, fitting, estimate, force_validation),
    "Diagnosis": (diagnosis, thresholds, findings),
    "Stand-in machine": (make_bag, parameters, variation, calibrate),
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


def _page(subject: str, modules: tuple[ModuleType, ...]) -> str:
    entries = (
        f"## {one.__name__}\n\n```{{eval-rst}}\n.. automodule:: {one.__name__}\n   :members:\n```\n"
        for one in modules
    )
    return f"# {subject}\n\n" + "\n".join(entries)
