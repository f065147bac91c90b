"""Truth of a case by its clean simulation: relative magnitude, identifiability, explainable gap."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crane_benchmark.cases.case import Case, CaseKind, HiddenInRecording
from crane_benchmark.cases.motions import LABORATORY_CRANE, PLANAR_JOINTS
from crane_benchmark.cases.simulators import Seen, load_seen
from crane_benchmark.folders import read_json
from crane_benchmark.scores.judgement import Place
from crane_identification.diagnosis.candidates import WHOLE, Candidate, Given
from crane_identification.diagnosis.findings import Findings
from crane_identification.diagnosis.flow import Usual, load_usual
from crane_model.cylinders import lever_arms
from crane_model.errors import CraneError
from crane_model.flow import EDGES, asymmetry
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import REGISTRY, Term
from crane_sim.effects.flow import MAX_LAMINAR_PA
from crane_sim.ground_truth import TrueEffect
from crane_sim.parts.parameters import SimulatedCrane

# How far a hidden effect on the flow of oil leaves what a machine's data sheet calls usual.
#
# Such effects do not show in the force. Every machine has leakage and soft oil, so that a little
# more of them is no discrepancy: no recording tells it from another machine of the same make.

WALLS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "hose_wall": lambda ratio: 1.0 / (1.0 + ratio),
    "braid": lambda ratio: np.exp(-ratio),
    "long_hose": lambda ratio: 1.0 / np.sqrt(1.0 + ratio),
}
"""How much a wall still gives, by its law, at a pressure over that which stiffens it."""
SIGMAS = 3.0  # that an error is above what noise gives, to be significant
NOTHING_LEFT = 0.002  # of the force, beyond what clean recordings leave of machines as surveyed
TELESCOPE = "telescope"  # joint whose constant force the model of ambiguous cases lacks
AMBIGUITY_TOLERANCE = 0.01  # of the energy of an injected effect that an equal rival may leave
COMPARABLE = {
    "chamber_gain": ("gain_B", ("gain",)),
    "encoder_offset": ("dq", ("offset",)),
    "hose_mass": ("rho_hose", ("density",)),
    "load_friction": ("mu_load", ("mu",)),
    "payload": ("m_payload", ("mass",)),
    "pressure_gain": ("gain", ("gain",)),
    "pressure_offset": ("dp", ("offset",)),
    "swinging_load": ("m_swinging", ("mass",)),
    "time_skew": ("delay", ("delay", "lag")),
}
"""Effect to how the name of that parameter begins which the catalogue's law shares with the hidden
one, and to its names there. Where the laws differ in form, their parameters do not mean the same.
"""


def beyond_usual(
    effect: TrueEffect, simulated: SimulatedCrane, record: Record, usual: Usual
) -> float | None:
    """Share of the quantity's value that lies beyond the limit; 0 of a usual one.

    `record` is what was recorded without noise. None where the data
    sheet has no such quantity.
    """
    joint, given = (
        effect.joint,
        {parameter.name: parameter.value for parameter in effect.parameters},
    )
    if joint is None:
        return None
    p_a, p_b = _pressures(joint, record)
    valve = simulated.valves[joint]
    match effect.name:
        case "valve_dead_band":
            dead_band = valve.dead_band
            band = given["band"] * (1.0 + abs(given.get("lean", 0.0)))
            value = dead_band + abs(valve.null_bias) + (1.0 - dead_band) * band
            limit = usual.dead_band[joint]
        case "valve_hysteresis":
            # of two plays the mean, of half the weight each
            value = given["width"] * (1.0 + given.get("inner", 1.0)) / 2.0
            limit = usual.hysteresis
        case "valve_asymmetry":
            more, less = 1.0 + given["share"], 1.0 - given["share"]
            if effect.form == "one_way":
                more, less = 1.0 + 2.0 * given["share"], 1.0
            gains = [getattr(valve.edges, edge) for edge in EDGES]
            value = abs(asymmetry(np.array(gains) * (more, less, less, more)))
            limit = usual.asymmetry
        case "internal_leakage":
            value = simulated.cylinders[joint].leakage + _leak(effect.form, given, joint, record)
            limit = usual.leakage_of(joint)
        case "oil_compressibility":
            ratio = np.maximum(np.stack([p_a, p_b]), 0.0) / given["stiffening"]
            softer = 1.0 + float((given["softness"] * WALLS[effect.form](ratio)).mean())
            value, limit = softer / simulated.oil.bulk_modulus, 1.0 / usual.bulk_modulus
        case _:
            return None
    return 0.0 if value <= limit else 1.0 - limit / value


def _leak(form: str, given: Mapping[str, float], joint: str, record: Record) -> float:
    """Its mean conductance [m3/(s Pa)]."""
    p_a, p_b = _pressures(joint, record)
    drop, size = np.abs(p_a - p_b), given["conductance"]
    if form == "orifice":
        return float((size / np.sqrt(np.hypot(drop, MAX_LAMINAR_PA))).mean())
    if form == "widening":
        return size * (1.0 + float(drop.mean()) / given["widening"])
    limits = LABORATORY_CRANE.limits[joint]
    middle = (limits.position_max + limits.position_min) / 2.0
    half = (limits.position_max - limits.position_min) / 2.0
    place = (record.position[:, record.column(joint)] - middle) / half
    return size * (1.0 + given["middle"] * float(np.exp(-4.0 * place**2).mean()))


def _pressures(joint: str, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """(n,) of chambers A and B [Pa]."""
    assert record.pressure_a is not None and record.pressure_b is not None  # clean recordings
    column = record.column(joint)
    return record.pressure_a[:, column], record.pressure_b[:, column]


@dataclass(frozen=True)
class CaseTruth:
    """A case, its machine, its labels (one a recording), and its recordings without noise."""

    case: Case
    simulated: SimulatedCrane
    labels: tuple[HiddenInRecording, ...]
    train: Seen
    validate: Seen

    @property
    def places(self) -> tuple[Place, ...]:
        return tuple((effect.effect, effect.joint or WHOLE) for effect in self.case.effects)

    @property
    def relative_magnitude(self) -> list[float]:
        """(k,) largest relative magnitude reached in any recording to train on, by its label."""
        reached = [
            {(effect.name, effect.joint): effect.relative_magnitude for effect in label.effects}
            for label in self.labels
        ]
        return [
            max(label.get((effect.effect, effect.joint), 0.0) for label in reached)
            for effect in self.case.effects
        ]

    def visibility(self, model: Model) -> list[float | None]:
        """(k,) share of each effect that recordings of this kind can show.

        In the force: the norm beside the `model`, where encoders tell which way a joint moves, over
        the whole norm. In the flow: what is beyond the usual; None where nothing says what that is.
        """
        base = _Base(model, self.train)
        usual = load_usual()
        shares: list[float | None] = []
        parts = zip(self.places, self.train.hidden, self.validate.hidden, strict=True)
        for place, part, held_out in parts:
            norm = base.whole(part)
            if norm > 0.0:
                shares.append(float(np.linalg.norm(base.beside(base.rows(part)))) / norm)
            elif held_out.any():
                shares.append(0.0)  # as of a load that reverses in no recording to train on
            else:
                effect = self._labelled(place)[-1]
                shares.append(beyond_usual(effect, self.simulated, self.train.record, usual))
        return shares

    def _labelled(self, place: Place) -> list[TrueEffect]:
        """Ground truth of an effect, one entry for each recording that carries it."""
        every = (effect for label in self.labels for effect in label.effects)
        return [effect for effect in every if (effect.name, effect.joint or WHOLE) == place]

    def parameter_errors(self, found: Findings) -> list[float]:
        """Relative errors of the parameters that mean the same in the hidden law as in the answer.

        By magnitude: either side has its own convention of signs. Where recordings differ, as in
        their loads, each value that is found is compared with the nearest hidden one.
        """
        errors = []
        for finding in found.findings:
            ours, theirs = COMPARABLE.get(finding.effect, ("", ()))
            hidden = [
                abs(given.value)
                for effect in self._labelled((finding.effect, finding.joint))
                for given in effect.parameters
                if given.name in theirs
            ]
            if hidden:
                values = (p.value or 0.0 for p in finding.parameters if p.name.startswith(ours))
                errors += [min(abs(abs(value) / true - 1.0) for true in hidden) for value in values]
        return errors

    def explains(self, model: Model, number: int, rival: Place) -> bool:
        """Return whether another effect explains the injected one as well as its own model form
        does.

        In an ambiguous case, that is the constant force that the model lacks.
        """
        base = _Base(model, self.train)
        if self.case.kind is CaseKind.AMBIGUOUS:
            place, part = (self.case.lacks[0], TELESCOPE), np.zeros(self.train.used.shape)
            part[:, PLANAR_JOINTS.index(TELESCOPE)] = 1.0
        else:
            place, part = self.places[number], self.train.hidden[number]
        hidden = base.beside(base.rows(part))
        if not hidden.any():
            return False  # acts on flows
        explained = _explained(base, hidden, place)
        return _explained(base, hidden, rival) >= explained - AMBIGUITY_TOLERANCE

    def gap(self, model: Model) -> np.ndarray:
        """(j,) explainable model error: fitted to clean recordings, on those to validate on."""
        theta = _Base(model, self.train).theta
        return _error(self.validate, model, theta)

    def above_noise(self, model: Model) -> bool:
        """Return whether the error of the model, fitted to clean recordings, is significant on
        those to validate on: above the noise of the transducers, and above the error on clean
        recordings of machines with a complete model.
        """
        seen, chain = self.validate, self.simulated.sensors
        joints, record = seen.record.joints, seen.record
        levers = seen.rms(lever_arms(LABORATORY_CRANE, record.position, joints))
        noise = levers * [chain.force_noise(LABORATORY_CRANE, joint) for joint in joints]
        noise /= seen.rms(record.needed("force", "the scorer"))
        # the energy of noise alone scatters by sqrt(2/n) of itself
        limit = np.sqrt(SIGMAS * np.sqrt(2.0 / np.maximum(seen.used.sum(axis=0), 1))) * noise
        return bool((self.gap(model) > np.maximum(limit, NOTHING_LEFT)).any())

    def closed(self, before: Model, after: Model) -> float:
        """Share of the explainable model error that `after` closes, in energy; NaN if no force."""
        if not self.train.hidden.any():
            return float("nan")
        open_ = (self.gap(before) ** 2).sum()
        left = (_error(self.validate, after, after.theta) ** 2).sum()
        return float(1.0 - left / open_) if open_ > 0.0 else float("nan")


class _Base:
    """The columns of a model on the clean training recordings, in units of each joint's force."""

    def __init__(self, model: Model, seen: Seen):
        self.model, self.seen = model, seen
        force = seen.record.needed("force", "the scorer")
        self._unit = seen.rms(force)
        columns = self.rows(model.regressor(seen.record))
        self._norms = np.linalg.norm(columns, axis=0)
        self._columns = columns / np.where(self._norms > 0.0, self._norms, 1.0)
        self._basis = np.linalg.svd(self._columns, full_matrices=False)[0]

    @property
    def theta(self) -> np.ndarray:
        """Least squares (31)."""
        force = self.rows(self.seen.record.needed("force", "the scorer"))
        return np.linalg.lstsq(self._columns, force, rcond=1e-10)[0] / self._norms

    def given(self, cls: type[Term]) -> Given:
        """The fields of a term that hold values of the model, if it has all of them."""
        values = dict(zip((p.name for p in self.model.parameters), self.theta, strict=True))
        return tuple(
            (field, tuple(float(values[name]) for name in names))
            for field, names in cls.of_model.items()
            if set(names) <= values.keys()
        )

    def rows(self, values: np.ndarray) -> np.ndarray:
        """(n, j, ...) to the rows that count."""
        unit = self._unit.reshape(1, -1, *[1] * (values.ndim - 2))
        return (values / unit)[self.seen.used]

    def whole(self, values: np.ndarray) -> float:
        """Norm of values (n, j) over all samples, at rest and close to reversals too."""
        return float(np.linalg.norm(values / self._unit))

    def beside(self, rows: np.ndarray) -> np.ndarray:
        """Residual of rows (N, ...) after a fit of the columns."""
        return rows - self._basis @ (self._basis.T @ rows)


def _explained(base: _Base, hidden: np.ndarray, place: Place) -> float:
    """Share of the energy of `hidden` that a law of the catalogue explains at its best shape."""
    effect, where = place
    if effect not in REGISTRY:
        return 0.0
    joint = None if where == WHOLE else where
    candidate = Candidate(REGISTRY[effect], joint, base.given(REGISTRY[effect]))
    energy = float(hidden @ hidden)
    best = 0.0
    for shape in candidate.grid():
        try:
            columns = candidate.at(shape).columns(base.seen.record, base.model.setting)
        except CraneError:
            continue  # not logged
        rows = base.beside(base.rows(columns))
        left = hidden - rows @ np.linalg.lstsq(rows, hidden, rcond=1e-9)[0]
        best = max(best, 1.0 - float(left @ left) / energy)
    return best


def _error(seen: Seen, model: Model, theta: np.ndarray) -> np.ndarray:
    force = seen.record.needed("force", "the scorer")
    return seen.rms(force - model.regressor(seen.record) @ theta) / seen.rms(force)


def load_truth(folder: Path) -> CaseTruth:
    """Open what is sealed."""
    case = Case.model_validate(read_json(folder / "case.json"))
    train, validate = (_part(folder, case, part) for part in ("train", "validate"))
    simulated = SimulatedCrane.model_validate(read_json(folder / "simulated_crane.json"))
    return CaseTruth(case, simulated, (*train[0], *validate[0]), train[1], validate[1])


def _part(folder: Path, case: Case, part: str) -> tuple[list[HiddenInRecording], Seen]:
    files = sorted(folder.glob(f"{part}-*.npz"))
    labels = [HiddenInRecording.read(file.with_suffix(".json")) for file in files]
    return labels, load_seen(files, [_present(case, label) for label in labels], len(case.effects))


def _present(case: Case, label: HiddenInRecording) -> Sequence[int]:
    labelled = {(effect.name, effect.joint) for effect in label.effects}
    return [i for i, effect in enumerate(case.effects) if (effect.effect, effect.joint) in labelled]
