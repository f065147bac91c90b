"""What the page and the summary of an identification are made of."""

import platform
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from crane_identification.data.log import Log
from crane_identification.fitting import FitResult
from crane_identification.online.replay import Recursive
from crane_identification.options import Options
from crane_identification.report.errors import JointErrors, pooled
from crane_identification.validation.command_validation import (
    CommandValidation,
    commands_validated,
)
from crane_identification.validation.force_validation import Validation, compare
from crane_identification.validation.motion_validation import MotionValidation, validate_motion

PACKAGES = (
    "crane_identification",
    "crane_model",
    "crane_driver",
    "numpy",
    "scipy",
    "numba",
    "filterpy",
    "cvxpy-base",
    "clarabel",
    "rosbags",
    "plotly",
)


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from; `date` as it is to be printed."""

    date: str
    command: str
    model_file: str
    versions: Mapping[str, str]

    @classmethod
    def of(cls, date: str, command: Sequence[str], model_file: str) -> "Provenance":
        """With the versions of Python and of the packages that the numbers depend on."""
        versions = {"Python": platform.python_version()}
        for package in PACKAGES:
            try:
                versions[package] = version(package)
            except PackageNotFoundError:  # run from the source tree
                versions[package] = "from source"
        return cls(date, shlex.join(command), model_file, versions)


@dataclass(frozen=True)
class IdentificationReport:
    """A fit, what it was made of, and its validation.

    `training` holds the recordings of `fit`, `validations` the predictions on recordings that it
    has not seen (none: not validated). `recursive` is the recursion over the same recordings.
    `seen_by_none` holds the recordings of `validations`.
    `planted` gives the true value of parameters where a stand-in machine makes them known.
    """

    fit: FitResult
    options: Options
    training: tuple[Log, ...]
    validations: tuple[Validation, ...]
    warnings: tuple[str, ...]
    provenance: Provenance
    planted: Mapping[str, float] | None = None
    recursive: Recursive | None = None
    seen_by_none: tuple[Log, ...] = ()

    @cached_property
    def held_out(self) -> JointErrors | None:
        """Errors on the validation recordings; None without any."""
        return pooled(self.fit.model, self.validations) if self.validations else None

    @cached_property
    def trained(self) -> JointErrors:
        """Errors on the training recordings, counted as the held-out ones: over all samples."""
        return pooled(self.fit.model, self.compared)

    @cached_property
    def compared(self) -> tuple[Validation, ...]:
        """What the model predicts on the training recordings."""
        fit = self.fit
        return tuple(compare(fit.model, p, fit.decimation) for p in fit.preparations)

    @cached_property
    def recursive_held_out(self) -> JointErrors | None:
        """Errors of the recursive estimate on the validation recordings; None without either."""
        if self.recursive is None or not self.validations:
            return None
        model, factor = self.recursive.model, self.fit.decimation
        validations = [compare(model, v.preparation, factor) for v in self.validations]
        return pooled(model, validations)

    @cached_property
    def friction_share(self) -> np.ndarray:
        """How much of the drive force of the training data is friction: ‖friction‖/‖τ‖, (j,)."""
        model, records = self.fit.model, [p.record for p in self.fit.preparations]
        friction = np.concatenate([model.friction(record) for record in records])
        force = np.concatenate([record.force for record in records])
        return np.linalg.norm(friction, axis=0) / np.linalg.norm(force, axis=0)

    @cached_property
    def simulated(self) -> MotionValidation | None:
        """Simulated against measured motion on the validation recordings; None without any."""
        if not self.validations:
            return None
        return validate_motion(self.fit.model, [v.preparation.record for v in self.validations])

    @cached_property
    def commanded(self) -> tuple[CommandValidation, ...]:
        """The same from valve commands alone; none where the hydraulics are not known."""
        model = self.fit.model
        if model.hydraulics is None or not self.seen_by_none:
            return ()
        return commands_validated(model, self.seen_by_none, self.options)

    @property
    def training_bags(self) -> list[str]:
        """Sources of the fit, each once."""
        return list(dict.fromkeys(log.source for log in self.training))

    @property
    def validation_bags(self) -> list[str]:
        """Sources of the validation, each once."""
        return list(dict.fromkeys(v.source for v in self.validations))
