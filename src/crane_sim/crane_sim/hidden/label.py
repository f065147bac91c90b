"""The label: what a bag hides, kept away from the bag."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import JOINTS, PLANAR_JOINTS
from crane_sim.hidden.clean import Clean
from crane_sim.hidden.form import Planted

OUTSIDE = "outside"  # in the place of the id of an effect that no catalogue has


def label(planted: Sequence[Planted], clean: Clean) -> list[dict[str, Any]]:
    """One entry an effect: what it is, its parameters, and the strength asked for and reached."""
    entries = []
    reached = clean.strength(planted)
    for k, effect in enumerate(planted):
        form = effect.form
        described = [(form.magnitude.name, form.magnitude.unit)]
        described += [(entry.name, entry.unit) for entry in form.draws]
        entries.append(
            {
                "effect": OUTSIDE if form.outside else form.effect,
                "name": form.effect,
                "joint": effect.joint,
                "form": form.name,
                "parameters": [
                    {"name": name, "value": value, "unit": form.unit(unit, effect.joint)}
                    for (name, unit), value in zip(described, effect.values, strict=True)
                ],
                "strength_requested": effect.requested,
                "strength": float(reached[k]),
                "strength_by_joint": {
                    joint: float(clean.strength_by_joint[k, JOINTS.index(joint)])
                    for joint in PLANAR_JOINTS
                },
            }
        )
    return entries


def check_place(path: Path, bag: Path) -> None:
    """`ConfigurationError` for a label in the bag's folder, `DataError` for one that exists."""
    if path.resolve().is_relative_to(bag.resolve()):
        raise ConfigurationError(
            f"--label {path}: lies in the folder of the bag, {bag}, which must not tell what is "
            "hidden; name a file elsewhere"
        )
    if path.suffix != ".json":
        raise ConfigurationError(f"--label {path}: the suffix of a label is .json")
    for file in (path, clean_path(path)):
        if file.exists():
            raise DataError(f"{file}: exists; name a label that does not exist yet")


def clean_path(path: Path) -> Path:
    """Where the arrays lie that belong to a label."""
    return path.with_suffix(".npz")


def write_label(path: Path, bag: Path, seed: int, planted: Sequence[Planted], clean: Clean) -> None:
    """The label of a bag and, beside it, the arrays of `clean`."""
    check_place(path, bag)
    content = {
        "bag": bag.name,
        "seed": seed,
        "clean": clean_path(path).name,
        "effects": label(planted, clean),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    clean.save(clean_path(path))
