"""What looks wrong in a recording before anything is fitted to it."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.recording_check.suspicion import Checked as Checked
    from crane_identification.recording_check.suspicion import Suspicion as Suspicion

_HOMES = {
    "Checked": "suspicion",
    "Suspicion": "suspicion",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
