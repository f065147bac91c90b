"""How much of the measured force a crane with plausible masses and friction can explain."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import lsq_linear

from crane_identification.recording_check.constants import CORRELATED
from crane_identification.recording_check.grid import Grid
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.terms.term import Setting

NEGLIGIBLE = 1e-9  # relative size of a direction that the data do not determine


def crane(machine: Machine) -> Model:
    """The model (16) of the report on the joints of this machine; what is checked must not depend
    on terms that a user tries. `ConfigurationError` if it is no crane as of the report.
    """
    model = _standard()
    names = dict(zip(model.joints, machine.as_planar().joints, strict=True))
    units = {names[joint]: unit for joint, unit in model.setting.units.items()}
    terms = tuple(
        term.model_copy(update={"joint": names[term.only_joint]}) if term.only_joint else term
        for term in model.terms
    )
    return replace(model, setting=Setting(units, machine), terms=terms)


@cache
def _standard() -> Model:
    return load_model(machine_file("model.yaml"))


@dataclass(frozen=True)
class Equations:
    """Rows (N,) of (28) where joints move, each joint's scaled by the rms of its force.

    `columns` (N, p) scaled to norm 1 by `norms` (p,); `force` (N,) by `scale` (j,) [N m, N]. The
    rows are those of the samples `sample` (N,) and the joints `joint` (N,).
    """

    columns: np.ndarray
    norms: np.ndarray
    force: np.ndarray
    scale: np.ndarray
    sample: np.ndarray
    joint: np.ndarray

    def explained(self, model: Model) -> float:
        """Share (rms) that is left of the force by plausible masses and friction that brakes."""
        assert model.machine is not None
        plausible = model.machine.plausible
        low, high = np.array(
            [
                plausible.get(one.name, (-np.inf if one.minimum is None else one.minimum, np.inf))
                for one in model.parameters
            ]
        ).T
        q, r = np.linalg.qr(self.columns)
        bounds = (low * self.norms, high * self.norms)
        found = lsq_linear(r, q.T @ self.force, bounds=bounds).x
        return float(np.sqrt(np.mean((self.force - self.columns @ found) ** 2)))

    def free(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Any masses and friction (p,), their standard deviations (p,), and the share left."""
        inverse = np.linalg.pinv(self.columns, rcond=NEGLIGIBLE)
        found = inverse @ self.force
        left = float(np.mean((self.force - self.columns @ found) ** 2))
        spread = np.sqrt(CORRELATED * left * (inverse**2).sum(axis=1))
        return found / self.norms, spread / self.norms, float(np.sqrt(left))


def equations(model: Model, whole: Grid, inside: slice = slice(None)) -> Equations:
    """Of the samples `inside`; `RangeError` where the linkages cannot be assembled."""
    used = np.zeros_like(whole.moving)
    used[inside] = whole.moving[inside]
    force = whole.generalized(whole.pistons)
    scale = np.sqrt((force**2 * used).sum(axis=0) / np.maximum(used.sum(axis=0), 1))
    scale[scale == 0.0] = 1.0
    columns = (model.regressor(whole.record) / scale[:, np.newaxis])[used]
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = 1.0
    return Equations(columns / norms, norms, (force / scale)[used], scale, *np.nonzero(used))
