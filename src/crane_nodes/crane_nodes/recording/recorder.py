"""`ros2 run crane_nodes recorder`: topics into a bag, until Ctrl-C."""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from crane_bags.types import TOPICS
from crane_model.cli import above, command_line, run
from crane_nodes.executor import KeptExecutor
from crane_nodes.managed import own_arguments, ros
from crane_nodes.recording.bag import RecordedBag, Split
from crane_nodes.recording.recorder_node import Recorder
from crane_nodes.recording.statistics import shown, table

NAMES = tuple(topic.relative for topic in TOPICS)
MEGABYTE = 1_000_000


def main(argv: Sequence[str] | None = None) -> int:
    """Record until SIGINT, SIGTERM or SIGHUP."""
    argv = sys.argv[1:] if argv is None else argv
    options = _parser().parse_args(own_arguments(argv))
    split = Split(options.split_size * MEGABYTE, options.split_seconds)
    return run(lambda: _record(argv, options.out, options.topics, split))


def _record(argv: Sequence[str], out: Path, topics: Sequence[str], split: Split) -> None:
    with ros(argv) as stop:
        with RecordedBag(out, split) as bag:
            recorder = Recorder(bag, topics)
            executor = KeptExecutor()
            executor.add_node(recorder)
            while not stop.requested:
                executor.spin_once(timeout_sec=0.1)
            recorder.visit()
            silences = recorder.silences()
            bag.remarks |= {f"silent {name}": text for name, text in silences.items()}
        print(_summary(bag, recorder), flush=True)


def _summary(bag: RecordedBag, recorder: Recorder) -> str:
    rows = []
    for name in recorder.topics:
        if name in recorder.recorded:
            recorded = recorder.recorded[name]
            arrivals = recorded.arrivals
            rows.append((name, recorded.topic.msgtype, str(arrivals.count), shown(arrivals.lost)))
        else:
            rows.append(
                (name, "not recorded" if name in recorder.problems else "no publisher", "0", "")
            )
    lines = [
        table(("topic", "type", "messages", "lost"), rows),
        *(f"{topic}: {text}, though it had a publisher" for topic, text in bag.remarks.items()),
        f"{bag.path}: {sum(bag.counts)} messages",
    ]
    return "\n".join(lines)


def _parser() -> argparse.ArgumentParser:
    parser = command_line(
        prog="recorder",
        description="Records topics to an mcap bag until Ctrl-C, as their publishers come.",
        epilog="ROS arguments follow --ros-args, for example -p use_sim_time:=true for a bag of "
        "simulated time. A bag whose recorder was killed is mended by: "
        "ros2 run crane_nodes recover BAG --out NEW",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="BAG", help="a new folder")
    parser.add_argument(
        "--topics", nargs="+", default=NAMES, metavar="TOPIC", help=f"default: {' '.join(NAMES)}"
    )
    parser.add_argument(
        "--split-size",
        type=above(0.0),
        default=math.inf,
        metavar="MB",
        help="begin a new file when one has reached this size (10^6 bytes)",
    )
    parser.add_argument(
        "--split-seconds",
        type=above(0.0),
        default=math.inf,
        metavar="S",
        help="begin a new file after this time",
    )
    return parser
