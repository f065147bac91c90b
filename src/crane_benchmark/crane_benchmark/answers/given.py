"""What an answering process is given of a case: the model, and recordings of the machine."""

from pathlib import Path

from crane_identification.data.bag_log import read_bag
from crane_identification.data.log import Log
from crane_model.model_file import Model, load_model


def given(folder: Path) -> tuple[Model, list[Log], list[Log]]:
    """The model to diagnose, the bags to train on and those to validate on, by their names.

    `CraneError` where one of them cannot be read.
    """
    model = load_model(folder / "model.yaml")
    train, validate = (
        [read_bag(bag, model.joints) for bag in sorted((folder / part).iterdir())]
        for part in ("train", "validate")
    )
    return model, train, validate
