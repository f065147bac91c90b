"""`ros2 run crane_viewer viewer`: the crane in a browser, live from its topics or from a bag."""

import argparse
import signal
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags.serde import SerdeError

from crane_bags.namespaces import namespace_of
from crane_bags.storage import announced, blocks, open_bag
from crane_bags.types import JOINT_STATES
from crane_model.cli import add_machine, command_line, run
from crane_model.errors import ConfigurationError, CraneError, DataError
from crane_model.machine import Machine, load_machine
from crane_viewer.view import SHOWN, View

if TYPE_CHECKING:
    from crane_viewer.view import View


# A bag as a view.


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


LOOPBACK = "127.0.0.1"


def main(argv: Sequence[str] | None = None) -> int:
    """Show until SIGINT or SIGTERM; a bag that is only saved ends by itself."""
    argv = sys.argv[1:] if argv is None else argv
    parser = _parser()
    ros = list(argv).index("--ros-args") if "--ros-args" in argv else len(argv)
    options = parser.parse_args(list(argv)[:ros])
    if options.no_page and not options.save:
        parser.error("--no-page: without a page there must be a file: --save FILE.rrd")
    return run(lambda: _show(options, list(argv)[ros:]))


def _show(options: argparse.Namespace, ros_arguments: list[str]) -> None:
    from crane_viewer.server import Server
    from crane_viewer.view import View

    if options.save:
        _check_place(options.save)
    machine = load_machine(options.machine)
    page = (
        nullcontext()
        if options.no_page
        else Server(options.listen, options.web_port, options.data_port)
    )
    with page as server:
        view = View(
            machine,
            live=options.bag is None,
            server=server.data if server else None,
            file=options.save,
        )
        if server:
            print(f"open in a browser: {server.page}", flush=True)
        try:
            if options.bag:
                _show_bag(view, machine, options)
                if server:
                    _wait()
            else:
                from crane_viewer.viewer_node import show_topics

                show_topics(view, ros_arguments, beside=[server.process] if server else [])
        finally:
            view.finish()


def _check_place(file: Path) -> None:
    if file.exists():
        raise ConfigurationError(f"{file}: exists; name another place")
    if not file.parent.is_dir():
        raise ConfigurationError(f"{file}: there is no folder {file.parent}; make it")


def _show_bag(view: "View", machine: Machine, options: argparse.Namespace) -> None:
    """A file of a bag that could not be read is taken away again."""

    try:
        show_bag(view, machine, options.bag)
    except CraneError:
        if options.save:
            options.save.unlink()
        raise
    print(f"shown: {options.bag}", flush=True)


def _wait() -> None:
    """Until the user has seen enough."""
    stop = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    signal.pthread_sigmask(signal.SIG_BLOCK, stop)
    signal.sigwait(stop)


def _parser() -> argparse.ArgumentParser:
    parser = command_line(
        prog="viewer",
        description="Shows the crane in a browser: live from its topics, or a bag. It only looks: "
        "it publishes nothing, calls no service, and cannot move anything.",
        epilog="Live, ROS arguments follow --ros-args: -r __ns:=/left for a crane in a namespace.",
    )
    parser.add_argument("--bag", type=Path, metavar="BAG", help="show a bag instead of the topics")
    add_machine(parser)
    parser.add_argument(
        "--save", type=Path, metavar="FILE", help="also write all into a new file of Rerun (.rrd)"
    )
    parser.add_argument(
        "--listen",
        default=LOOPBACK,
        metavar="ADDRESS",
        help="of this computer, where others may look, too: 0.0.0.0 for all of them; whoever "
        f"reaches it sees everything (default: {LOOPBACK}, this computer alone)",
    )
    for name, port, what in (
        ("--web-port", 9090, "page"),
        ("--data-port", 9876, "data; Rerun's own window connects to it, too"),
    ):
        parser.add_argument(
            name,
            type=int,
            default=port,
            metavar="N",
            help=f"of the {what} (default: {port}; 0: any)",
        )
    parser.add_argument("--no-page", action="store_true", help="only --save, nothing is served")
    return parser
