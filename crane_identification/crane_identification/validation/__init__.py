"""How well a model predicts forces and motions that it has not seen."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.validation.force_validation import Validation as Validation
    from crane_identification.validation.force_validation import compare as compare
    from crane_identification.validation.motion_validation import (
        MotionValidation as MotionValidation,
    )
    from crane_identification.validation.motion_validation import validate_motion as validate_motion

_HOMES = {
    "MotionValidation": "motion_validation",
    "Validation": "force_validation",
    "compare": "force_validation",
    "validate_motion": "motion_validation",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
