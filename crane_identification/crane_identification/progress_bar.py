"""Progress on the terminal: one bar a phase, shown for phases that take longer than two seconds."""

from types import TracebackType
from typing import Self

from tqdm import tqdm

PATIENCE = 2.0  # s before a bar appears
STEPS = 1000


class ProgressBar:
    """A `crane_identification.progress.Progress` that draws bars on standard error."""

    def __init__(self) -> None:
        self._phase = ""
        self._bar: tqdm | None = None

    def __call__(self, phase: str, done: float) -> None:
        """Show `phase` at the share `done`, 0 to 1."""
        if phase != self._phase or self._bar is None:
            self.close()
            self._phase = phase
            self._bar = tqdm(
                desc=phase,
                total=STEPS,
                delay=PATIENCE,
                bar_format="{desc}: {percentage:3.0f} % |{bar}| {elapsed} < {remaining}",
            )
        self._bar.update(round(done * STEPS) - self._bar.n)

    def close(self) -> None:
        """End the bar that is shown."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
