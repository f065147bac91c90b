"""A bag as a view."""

from pathlib import Path

from rosbags.serde import SerdeError

from crane_bags.namespaces import namespace_of
from crane_bags.storage import announced, blocks, open_bag
from crane_bags.types import JOINT_STATES
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_viewer.view import SHOWN, View


def show_bag(view: View, machine: Machine, bag: Path) -> None:
    """All that a bag holds of one crane; `DataError` if there is nothing of it to show."""
    namespace = namespace_of(bag)
    within = {one.within(namespace).name: one for one in SHOWN if one.name != "/diagnostics"}
    within |= {one.name: one for one in SHOWN if one.name == "/diagnostics"}
    with open_bag(bag) as reader:
        types = {one.topic: one.msgtype for one in reader.connections}
        topics = {
            name: one
            for name, one in within.items()
            if types.get(name) == one.msgtype and announced(reader, name)[0]
        }
        if not topics:
            raise DataError(
                f"{bag}: holds none of {', '.join(within)}; it holds {', '.join(sorted(types))}"
            )
        for block in blocks(bag, reader, topics):
            try:
                view.take(topics[block.topic], block.log_times, block.messages)
            except (SerdeError, ValueError) as error:
                raise DataError(
                    f"{bag}: topic {block.topic}: {error}; the bag is damaged"
                ) from error
    if JOINT_STATES.within(namespace).name in topics and not view.posed:
        raise DataError(
            f"{bag}: no joint states of {', '.join(machine.joint_names)}, the joints of "
            f"{machine.name}; name the machine of the bag by --machine"
        )
