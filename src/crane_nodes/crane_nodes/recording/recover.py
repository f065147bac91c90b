"""`ros2 run crane_nodes recover`: a readable bag out of one that was never closed."""

import re
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from crane_bags.storage import STORAGE_SUFFIXES
from crane_model.cli import command_line, run
from crane_model.errors import DataError
from crane_model.progress_bar import progress_bar
from crane_nodes.recording.bag import RecordedBag
from crane_nodes.recording.metadata import RecordedTopic
from crane_nodes.recording.salvage import Salvage
from crane_nodes.recording.salvage_sqlite import DatabaseSalvage
from crane_nodes.recording.statistics import table


def main(argv: Sequence[str] | None = None) -> int:
    """Write what can be read of a damaged bag as a new one."""
    parser = command_line(
        description="Makes a readable bag out of one that was not closed; that one is not touched.",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="a folder, or one file of it")
    parser.add_argument("--out", type=Path, required=True, metavar="NEW", help="a new folder")
    options = parser.parse_args(argv)
    return run(lambda: print(recover(options.bag, options.out)))


def recover(damaged: Path, out: Path) -> str:
    """Write the messages of `damaged` as the new bag `out`; what was saved, as a report.

    `DataError` if there is nothing to save or `out` cannot be made.
    """
    if damaged.resolve() in out.resolve().parents:
        raise DataError(f"{out}: would change the damaged bag; name a folder outside of it")
    salvages = [
        DatabaseSalvage(path) if path.suffix == ".db3" else Salvage(path)
        for path in _files(damaged)
    ]
    saved: dict[RecordedTopic, _Saved] = {}
    with ExitStack() as stack:
        bar = stack.enter_context(
            progress_bar(f"recovering {damaged.name}", sum(salvage.size for salvage in salvages))
        )
        bag: RecordedBag | None = None
        for salvage in salvages:
            for count, (topic, message) in enumerate(salvage):
                if bag is None:  # nothing is made before there is something to save
                    bag = stack.enter_context(RecordedBag(out))
                elif count == 0:
                    bag.begin_file()
                if topic not in saved:
                    saved[topic] = _Saved(bag.add(topic))
                saved[topic].add(message.log_time)
                bag.write(
                    saved[topic].number,
                    message.log_time,
                    message.data,
                    message.publish_time,
                    message.sequence,
                )
            bar.update(salvage.size)
    notes = [note for salvage in salvages for note in salvage.notes]
    if not saved:
        raise DataError(f"{damaged}: holds no whole message ({'; '.join(notes)}); record again")
    return _report(out, saved, notes)


@dataclass
class _Saved:
    """Messages of one topic."""

    number: int
    count: int = 0
    first: int = 2**63 - 1  # ns
    last: int = 0  # ns

    def add(self, log_time: int) -> None:
        self.count += 1
        self.first, self.last = min(self.first, log_time), max(self.last, log_time)


def _files(damaged: Path) -> list[Path]:
    """The storage files of a bag in the order of their numbers."""
    if damaged.is_file():
        return [damaged]
    for suffix in STORAGE_SUFFIXES:
        if files := list(damaged.glob(f"*{suffix}")):
            return sorted(files, key=lambda path: [*map(int, re.findall(r"\d+", path.stem))][-1:])
    raise DataError(
        f"{damaged}: no {' or '.join(STORAGE_SUFFIXES)} file here; name the folder of a bag, or "
        "its file"
    )


def _report(out: Path, saved: dict[RecordedTopic, _Saved], notes: list[str]) -> str:
    begin = min(one.first for one in saved.values())
    rows = [
        (
            topic.name,
            topic.msgtype,
            str(one.count),
            f"{(one.first - begin) * 1e-9:.3f}",
            f"{(one.last - begin) * 1e-9:.3f}",
        )
        for topic, one in saved.items()
    ]
    total = sum(one.count for one in saved.values())
    lines = [
        table(("topic", "type", "messages", "from [s]", "to [s]"), rows),
        *notes,
        f"{out}: {total} messages saved",
    ]
    return "\n".join(lines)
