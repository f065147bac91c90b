"""Sensors that began to lie while a bag was recorded, by an earlier model of the machine."""

from collections.abc import Sequence
from pathlib import Path

from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_observer.monitor.replay import watch


def lying(model: Model, recordings: Sequence[Path], end: float) -> tuple[str, ...]:
    """Warnings of bags that are not fit for identification up to `end` [s].

    By a model with hydraulics, and of bags that hold pressures and valve commands:
    without them, too little is told for the time that it takes.
    """
    if model.hydraulics is None:
        return ()
    warnings = []
    for bag in filter(Path.is_dir, recordings):
        try:
            seen = watch(bag, model, None)
        except DataError:  # without them there is nothing to compare
            continue
        warnings += [f"{bag}: {one}" for one in seen.findings if one.onset < end]
    return tuple(warnings)
