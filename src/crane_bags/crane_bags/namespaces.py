"""In which namespace the crane of a bag lived: bags keep the names of topics as they were."""

from pathlib import Path

from crane_bags.storage import open_bag
from crane_bags.types import JOINT_STATES
from crane_model.errors import DataError

ROOT = "/"


def namespace_of(path: Path | str) -> str:
    """The namespace whose joint states a bag holds: the root if it is one of them, or none is.

    `DataError` if the bag holds several, none of them the root, and as `open_bag` does.
    """
    with open_bag(Path(path)) as reader:
        found = {
            one.topic.removesuffix(JOINT_STATES.name) or ROOT
            for one in reader.connections
            if one.topic.endswith(JOINT_STATES.name)
            and one.msgtype == JOINT_STATES.msgtype
            and one.msgcount
        }
    if ROOT in found or not found:
        return ROOT
    if len(found) > 1:
        namespaces = ", ".join(sorted(found))
        raise DataError(
            f"{path}: holds the joint states of {len(found)} cranes, in the namespaces "
            f"{namespaces}; say which one is meant: --namespace {min(found)}"
        )
    return found.pop()
