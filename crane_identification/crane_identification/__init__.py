"""Parameters of a crane from recordings of it: what programs use.

>>> from crane_identification import Estimator, Options
>>> Options(estimator=Estimator.ROBUST).covariance
<Covariance.CORRELATED: 'correlated'>
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.data.bag_log import read_bag as read_bag
    from crane_identification.data.log import Log as Log
    from crane_identification.data.log import Signal as Signal
    from crane_identification.estimation.estimate import Estimate as Estimate
    from crane_identification.fitting import FitResult as FitResult
    from crane_identification.fitting import fit as fit
    from crane_identification.fitting import validate as validate
    from crane_identification.options import Covariance as Covariance
    from crane_identification.options import Estimator as Estimator
    from crane_identification.options import Options as Options
    from crane_identification.preparation.prepare import Session as Session
    from crane_identification.progress_bar import ProgressBar as ProgressBar
    from crane_identification.validation.force_validation import Validation as Validation

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "data.bag_log": ("read_bag",),
        "data.log": ("Log", "Signal"),
        "estimation.estimate": ("Estimate",),
        "fitting": ("FitResult", "fit", "validate"),
        "options": ("Covariance", "Estimator", "Options"),
        "preparation.prepare": ("Session",),
        "progress_bar": ("ProgressBar",),
        "validation.force_validation": ("Validation",),
    },
)
