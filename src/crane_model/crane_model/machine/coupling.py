"""Joints whose actuators drive several of them at once, as the hollow wrist of a robot."""

from typing import Self

import numpy as np
from pydantic import model_validator

from crane_model.configuration import Schema


class Coupling(Schema):
    """The actuators of k `joints` see `matrix` q, (k, k), in the place of q.

    By virtual work, their torques act on the joints by the transpose.
    """

    joints: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _square(self) -> Self:
        k = len(self.joints)
        if len(self.matrix) != k or any(len(row) != k for row in self.matrix):
            raise ValueError(f"matrix: must have {k} rows of {k} numbers, as many as joints")
        if abs(np.linalg.det(np.array(self.matrix))) < 1e-9:
            raise ValueError("matrix: must not be singular; some motion moves no actuator")
        return self
