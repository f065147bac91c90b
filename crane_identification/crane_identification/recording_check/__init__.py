"""What looks wrong in a recording before anything is fitted to it."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.recording_check.suspicion import Checked as Checked
    from crane_identification.recording_check.suspicion import Suspicion as Suspicion

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "suspicion": ("Checked", "Suspicion"),
    },
)
