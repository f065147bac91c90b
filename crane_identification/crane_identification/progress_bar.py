"""Progress of computations: one bar a phase."""

from typing import Self

from tqdm import tqdm

from crane_model.progress_bar import progress_bar

BAR_STEPS = 1000


class ProgressBar:
    """Progress of computations as bars on standard error, one bar for each phase.

    A `crane_model.progress_bar.Progress` for `fit` and its like, and a context manager.
    """

    def __init__(self) -> None:
        self._phase = ""
        self._bar: tqdm | None = None

    def __call__(self, phase: str, done: float) -> None:
        """Show `phase` at the share `done`, 0 to 1."""
        if phase != self._phase or self._bar is None:
            self.close()
            self._phase = phase
            self._bar = progress_bar(phase, BAR_STEPS)
        self._bar.update(round(done * BAR_STEPS) - self._bar.n)

    def close(self) -> None:
        """End the bar that is shown."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
