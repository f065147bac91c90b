"""Fits of more recordings than one machine holds."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.scale.cluster import fit_on_cluster as fit_on_cluster
    from crane_identification.scale.information import ClusterFit as ClusterFit
    from crane_identification.scale.information import Information as Information

_HOMES = {
    "ClusterFit": "information",
    "Information": "information",
    "fit_on_cluster": "cluster",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
