"""Identification of the parameters of a crane from recordings: the API for programs.

>>> from crane_identification import Estimator, Options
>>> Options(estimator=Estimator.ROBUST).covariance
<Covariance.CORRELATED: 'correlated'>
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.data.column_map import ColumnMap as ColumnMap
    from crane_identification.data.log import Log as Log
    from crane_identification.data.log import Signal as Signal
    from crane_identification.data.recording_log import read_bag as read_bag
    from crane_identification.data.recording_log import read_recording as read_recording
    from crane_identification.estimation.regression import Estimate as Estimate
    from crane_identification.export import IdentifiedBodies as IdentifiedBodies
    from crane_identification.export import export_mjcf as export_mjcf
    from crane_identification.export import export_urdf as export_urdf
    from crane_identification.export import identified_bodies as identified_bodies
    from crane_identification.fitting import FitResult as FitResult
    from crane_identification.fitting import fit as fit
    from crane_identification.fitting import validate as validate
    from crane_identification.options import Covariance as Covariance
    from crane_identification.options import Estimator as Estimator
    from crane_identification.options import Options as Options
    from crane_identification.preparation.prepare import Session as Session
    from crane_identification.validation.force_validation import Validation as Validation
    from crane_model.progress_bar import ProgressBar as ProgressBar

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
