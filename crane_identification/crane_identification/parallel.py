"""Work on several recordings, joints or effects at once, on all cores."""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_parallel(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """`[function(item) for item in items]`, in as many processes as there are cores.

    The processes are forks of this one, so that the function may refer to anything; results are
    copied back. If anything fails, all is computed again here, so that the first error is raised.
    A process that another one started computes everything itself, and so does a system that is
    not Linux, where forks are not safe.

    Parameters
    ----------
    function : callable
        Its result is all that counts: what else it changes in another process is lost.
    items : iterable
        Its arguments.

    Returns
    -------
    list
        The results in the order of the items.
    """
    items = list(items)
    alone = sys.platform != "linux" or parent_process() is not None
    count = 1 if alone else min(len(os.sched_getaffinity(0)), len(items))
    if count < 2:
        return [function(item) for item in items]
    here = (len(items) - 1) % count  # the share of the last item, with which progress ends
    shares: dict[int, Sequence[Result]] = {}
    context, running = get_context("fork"), {}
    for k in set(range(count)) - {here}:
        receiver, sender = context.Pipe(duplex=False)
        work = (sender, function, items[k::count])
        process = context.Process(target=_send_results, args=work, daemon=True)
        process.start()
        sender.close()
        running[k] = process, receiver
    try:
        shares[here] = [function(item) for item in items[here::count]]
        shares |= {k: receiver.recv() for k, (_, receiver) in running.items()}
    except Exception:
        return [function(item) for item in items]
    finally:
        for process, receiver in running.values():
            receiver.close()
            process.terminate()
            process.join()
    return [shares[i % count][i // count] for i in range(len(items))]


def _send_results(
    sender: Connection, function: Callable[[Item], Result], items: Sequence[Item]
) -> None:
    """Send the results of a share; nothing if one fails, which the other end notices."""
    try:
        sender.send([function(item) for item in items])
    except BaseException:
        os._exit(1)
