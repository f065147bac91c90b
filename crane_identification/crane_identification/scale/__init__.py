"""Fits of more recordings than memory, or one machine, holds."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.scale.cluster import fit_on_cluster as fit_on_cluster
    from crane_identification.scale.information import Information as Information
    from crane_identification.scale.summed import SummedFit as SummedFit
    from crane_identification.scale.summed import fit_streamed as fit_streamed

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "cluster": ("fit_on_cluster",),
        "information": ("Information",),
        "summed": ("SummedFit", "fit_streamed"),
    },
)
