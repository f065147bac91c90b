"""One long calculation on a core of its own, while the caller goes on with others."""

import signal
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from crane_model.errors import CraneError
from crane_model.progress_bar import Progress

LOOK = 0.2  # s between two looks at how far it is

T = TypeVar("T")


class Beside(Generic[T]):
    """Runs `function(*arguments, progress=...)` in a process of its own, which ends with the
    context at the latest. Arguments, result and errors are sent, so they must be picklable.
    """

    def __init__(self, function: Callable[..., T], *arguments: object) -> None:
        context = get_context("spawn")  # a fork would leave the threads of libraries behind
        self._name = function.__name__
        self._share = context.Value("d", 0.0)
        self._receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_work, args=(sender, self._share, function, arguments), daemon=True
        )
        self._process.start()
        sender.close()

    def result(self, progress: Progress) -> T:
        """Wait for what the function returns; raises the `CraneError` that it raises, and one if
        its process dies.
        """
        while not self._receiver.poll(LOOK):
            progress(self._name, self._share.value)
        try:
            result, error = self._receiver.recv()
        except EOFError:
            self._process.join()
            raise CraneError(
                f"{self._name}: its process ended with exit code {self._process.exitcode} and "
                f"without a result; if it was killed, memory may have run out"
            ) from None
        if error is not None:
            raise error
        progress(self._name, 1.0)
        return result

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._process.terminate()
        self._process.join()


def _work(
    sender: Connection, share: Any, function: Callable[..., object], arguments: tuple[Any, ...]
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the caller, and that this process

    def progress(phase: str, done: float) -> None:
        share.value = done

    try:
        sender.send((function(*arguments, progress=progress), None))
    except CraneError as error:
        sender.send((None, error))
