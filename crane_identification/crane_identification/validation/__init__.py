"""How well a model predicts forces and motions that it has not seen."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.validation.force_validation import Validation as Validation
    from crane_identification.validation.force_validation import compare as compare
    from crane_identification.validation.motion_validation import (
        MotionValidation as MotionValidation,
    )
    from crane_identification.validation.motion_validation import validate_motion as validate_motion

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "force_validation": ("Validation", "compare"),
        "motion_validation": ("MotionValidation", "validate_motion"),
    },
)
