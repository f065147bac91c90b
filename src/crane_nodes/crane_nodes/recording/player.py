"""`ros2 run crane_nodes player`: a bag onto the topics it was recorded from."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader

from crane_bags.clocks import NANOSECONDS
from crane_bags.storage import open_bag
from crane_model.cli import above, command_line, run
from crane_model.progress_bar import BAR, progress_bar
from crane_nodes.managed import own_arguments, ros
from crane_nodes.recording.player_node import Player, Selection, schedule, select

SECONDS = "{desc}: {n:.1f} of {total:.1f} s" + BAR


def main(argv: Sequence[str] | None = None) -> int:
    """Play a bag to its end."""
    argv = sys.argv[1:] if argv is None else argv
    options = _parser().parse_args(own_arguments(argv))
    return run(lambda: _play(argv, options))


def _play(argv: Sequence[str], options: argparse.Namespace) -> None:
    bag: Path = options.bag
    with ros(argv) as stop, open_bag(bag) as reader:
        player = Player(stop)
        allow, resolve = options.allow_valve_command, player.resolve_topic_name
        recorded = {one.topic for one in reader.connections}
        topics = [one if one in recorded else player.expanded(one) for one in options.topics]
        selection = select(bag, reader, topics, allow, resolve)
        for name, reason in selection.left_out.items():
            print(f"left out {name}: {reason}", flush=True)
        player.offer(selection.played)
        for topic in selection.played:
            print(f"playing {topic.name} ({topic.msgtype}, {topic.service})", flush=True)
        player.wait_for_subscribers(options.wait_for)
        _pass(player, bag, reader, selection, options.rate)
        while options.loop and not stop.requested:
            _pass(player, bag, reader, selection, options.rate)
        player.finish()
        if stop.requested:
            raise KeyboardInterrupt


def _pass(player: Player, bag: Path, reader: Reader, selection: Selection, rate: float) -> None:
    """Play the bag once and say how well its timing was kept."""
    delays: list[int] = []
    seconds = reader.duration / NANOSECONDS
    with progress_bar(f"playing {bag.name}", seconds, form=SECONDS) as progress:

        def played(time: int, delay: int) -> None:
            delays.append(delay)
            progress.update((time - reader.start_time) / NANOSECONDS - progress.n)

        player.play(schedule(bag, reader, selection), rate, played)
    if delays:
        median, most, largest = np.percentile(delays, [50, 99, 100]) * 1e-6
        print(
            f"{bag}: {len(delays)} messages played, behind by {median:.1f} ms (median), "
            f"{most:.1f} ms (99 %), {largest:.1f} ms (largest)",
            flush=True,
        )


def _parser() -> argparse.ArgumentParser:
    parser = command_line(
        prog="player",
        description="Plays a bag of either storage onto its topics, in its own rhythm, with the "
        "time of the bag on /clock. Header stamps are as recorded.",
        epilog="ROS arguments follow --ros-args. Valve commands can be looked at under another "
        "name: --ros-args -r /valve_command:=/recorded_command",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="a folder, or one file of it")
    parser.add_argument(
        "--rate", type=above(0.0), default=1.0, metavar="R", help="times as fast (default: 1)"
    )
    parser.add_argument(
        "--topics", nargs="+", default=(), metavar="TOPIC", help="play only these (default: all)"
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument(
        "--wait-for",
        nargs="+",
        default=(),
        metavar="TOPIC",
        help="begin when each of these has a subscriber",
    )
    parser.add_argument(
        "--allow-valve-command",
        action="store_true",
        help="also play onto /valve_command: MOVES A CRANE whose driver listens there",
    )
    return parser
