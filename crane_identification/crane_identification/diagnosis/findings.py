"""The result values of a diagnosis, as findings.json holds them.

Shares and relative magnitudes are of one; a number that is not known is null. The schema of the
file, and its page of the manual, are made from these classes.
"""

from enum import StrEnum

from crane_identification.notation import is_determined
from crane_model.result_file import Number, NumberByJoint, OpenQuestions, ResultFile, ResultPart


class Verdict(StrEnum):
    """The answer of a diagnosis."""

    NAMED = "named"
    AND_MORE = "named_and_more"
    AMBIGUOUS = "ambiguous"
    NONE = "none"
    UNKNOWN = "unknown"
    INSUFFICIENT = "insufficient_data"


class FoundEffect(ResultPart):
    """An effect and its place."""

    effect: str
    """Type of the effect, as in the catalogue and in model files."""
    name: str
    """Name of the effect in words."""
    joint: str
    """Joint, or `all` for an effect of the whole crane."""


class NearEffect(FoundEffect):
    """An effect that comes near."""

    score: Number
    """2 Δ log L of the training recordings [-]."""
    threshold: Number
    """The score that a finding needs [-]."""


class FoundParameter(ResultPart):
    """A parameter of a finding, or a value of the hydraulics."""

    name: str
    """Name, as in model files."""
    value: Number
    """Estimate [unit]."""
    std_dev: Number
    """Its standard deviation [unit]."""
    unit: str
    """SI unit; `1` for a ratio, `counts` if readings have no unit."""
    minimum: Number
    """Smallest value that physics allows [unit]."""
    determined: bool
    """True if the recordings determine it."""

    @classmethod
    def of(
        cls, name: str, value: float, std_dev: float, unit: str, minimum: float | None = None
    ) -> "FoundParameter":
        """The parameter, which is determined if its number would be printed."""
        determined = is_determined(value, std_dev, minimum)
        return FoundParameter(
            name=name,
            value=value,
            std_dev=std_dev,
            unit=unit,
            minimum=minimum,
            determined=determined,
        )


class ChangedParameter(FoundParameter):
    """A parameter whose value has changed."""

    before: Number
    """The value before the change [unit]."""
    before_std_dev: Number
    """Standard deviation [unit]."""
    change: Number
    """Change of the value [unit]."""
    change_std_dev: Number
    """Standard deviation [unit]."""


class FoundCurve(ResultPart):
    """A nonparametric curve: values at knots, straight lines between them."""

    variable: str
    """Quantity on which the force depends; for velocity and force, the absolute value."""
    variable_unit: str
    """The unit of the knots."""
    knots: list[Number]
    """Knots of the values [variable_unit]."""
    values: list[Number]
    """Force divided by its factor [unit]."""
    std_devs: list[Number]
    """Standard deviations of the values; 0 if the curve is fixed at 0 [unit]."""
    unit: str
    """The unit of the values."""
    times: str
    """Factor of the curve: the direction sgn(q'), the velocity q', or 1."""


class FindingEntry(FoundEffect):
    """An effect that the model lacks, or an effect of flow or load."""

    changed: bool = False
    """True if a value of the model has changed, false if a term is missing."""
    ambiguity_group: list[FoundEffect] = []
    """Effects that these recordings cannot discriminate from this effect."""
    parameters: list[ChangedParameter | FoundParameter]
    """Parameters of this effect, in the model with all findings."""
    curves: list[FoundCurve] = []
    """Nonparametric curves, if no model form of the catalogue fits; otherwise empty."""
    deviation: list[FoundCurve] = []
    """Force that the model form lacks; empty if the form is that of the catalogue."""
    carried_in: dict[str, list[str]] = {}
    """Recordings by the parameter of the load that they carry; `none` lists recordings without a
    load.
    """
    score: Number
    """2 Δ log L of the training recordings [-]."""
    threshold: Number
    """The score that a finding needs [-]."""
    runner_up: FoundEffect | None = None
    """The effect that explains most if this effect is left out."""
    margin: Number
    """Score minus that of the runner-up [-]."""
    margin_needed: Number = 0.0
    """Margin that rules out the runner-up [-]."""
    relative_magnitude: Number = None
    """Rms of the force of the effect over that of the drive force, while the joint slides; null for
    flows and loads [-].
    """
    visible_magnitude: Number = None
    """The same for the part that other parameters do not absorb; for a flow, relative to the flow
    [-].
    """
    discriminated_by: str
    """Experiment that discriminates the effect from similar effects."""


class FoundRegion(ResultPart):
    """Region that holds most of a residual."""

    variable: str
    """Quantity on which the residual depends most."""
    range: tuple[Number, Number]
    """Lowest and highest value of the quantity [unit]."""
    unit: str
    """The unit of the quantity."""
    share: Number
    """Share of the energy of the residual [-]."""


class FoundPlace(ResultPart):
    """The residual of a joint before anything is added."""

    energy_share: Number
    """Share of the whole residual, in units of the noise [-]."""
    region: FoundRegion | None
    """Region of the residual."""


class ErrorChange(ResultPart):
    """Held-out error of the force of a joint."""

    before: Number
    """Without the effects, over the rms of the force [-]."""
    after: Number
    """With them [-]."""


class NearestEffects(ResultPart):
    """The effects that come closest if nothing is named."""

    effects: list[NearEffect]
    """Strongest first."""
    explained_share: Number
    """Share of the residual of the training recordings that they explain [-]."""
    model_error: dict[str, ErrorChange]
    """Values by joint."""
    objection: str
    """Reason why they are not an answer."""


class OwnTermEntry(FoundEffect):
    """A term of `--terms` that is not named."""

    objection: str
    """Reason."""
    tried: NearestEffects | None
    """Effect of the term alone; none if these recordings cannot show it."""


class NearbySignature(ResultPart):
    """A quantity that an unknown force may depend on."""

    signature: str
    """Variable and symmetry, in words."""
    effects: list[str]
    """Types of the effects with this signature; none if the catalogue contains no such effect."""
    explained_share: Number
    """Share of the energy beyond noise that its best curve explains [-]."""
    better: int
    """Recordings that the curve helps to predict if fitted to the others [-]."""
    asked: int
    """Recordings that were tested [-]."""
    curves: list[FoundCurve]
    """Best nonparametric curve for each factor; empty if it is not a curve."""


class FoundDifference(ResultPart):
    """A parameter of the model that differs between recordings."""

    parameter: str
    """Its name."""
    unit: str
    """SI unit; `1` for a ratio, `counts` if readings have no unit."""
    explained_share: Number
    """Share of the energy beyond noise, if each recording has its own value [-]."""
    changes: NumberByJoint
    """Difference from the common value, by recording [unit]."""
    std_devs: NumberByJoint
    """Standard deviations of the differences [unit]."""


class FoundFormula(ResultPart):
    """A short formula for an unknown force."""

    equation: str
    """The force, by the position q, velocity q' and acceleration q'' of its joint and others."""
    parameters: list[FoundParameter]
    """Its coefficients."""
    before: Number
    """Held-out error of the force without the formula, over the rms of the force [-]."""
    after: Number
    """The same with the formula [-]."""
    closed_share: Number
    """Share of the explainable energy on held-out recordings that the formula explains [-]."""
    source: str
    """Python file for `--terms` with the formula as a term, in the folder of the results."""


class UnknownPlace(ResultPart):
    """An unknown force."""

    joint: str
    """Joint with most of the unknown force."""
    relative_magnitude: Number
    """Rms of the force beyond noise there, over that of the drive force [-]."""
    signatures: list[NearbySignature]
    """Nearest signatures, best first."""
    recordings: NumberByJoint
    """Recordings with far more of it than others: rms over the median of all [-]."""
    difference: FoundDifference | None
    """Parameter by which recordings differ, if it explains most of the force."""
    formula: FoundFormula | None = None
    """A short formula, if one explains it."""


class ModelError(ResultPart):
    """Errors of a joint on the held-out recordings."""

    force_relative_error: Number
    """Rms error of the force over that of the force [-]."""
    noise_floor: Number
    """Scatter between periods over the rms of the force; null if no period was repeated [-]."""
    best_achievable: Number
    """Error of a flexible learner over the rms of the force [-]."""
    motion_error: Number
    """Rms error of the simulated motion [rad, m]."""


class CarriedLoad(ResultPart):
    """A load estimated from a held-out recording."""

    recording: str
    """Its name."""
    value: Number
    """Mass beyond that of the lightest recording [kg]."""
    std_dev: Number
    """Its standard deviation [kg]."""


class CommandedError(ResultPart):
    """Errors of the motion from valve commands alone, simulated from measured states."""

    horizon: Number
    """Duration of each simulation [s]."""
    windows: int
    """Number of simulations, one after the other [-]."""
    displacement: NumberByJoint
    """Mean displacement of the joint in that time [rad, m]."""
    before: NumberByJoint
    """Rms error at the end with the given model [rad, m]."""
    after: NumberByJoint
    """The same with the findings [rad, m]."""


class ModelErrors(ResultPart):
    """Errors on held-out recordings."""

    before: dict[str, ModelError]
    """Errors of the given model, by joint."""
    after: dict[str, ModelError]
    """Errors of the model with the findings, by joint."""
    closed: NumberByJoint
    """Share of the explainable energy that the findings explain, in the range of the training; null
    if there is none [-].
    """
    loads: list[CarriedLoad]
    """Loads of single held-out recordings."""
    from_commands: list[CommandedError] = []
    """Errors by horizon; empty if the motion cannot be simulated."""
    from_commands_reason: str = ""
    """Reason why no motion was simulated from commands; otherwise empty."""


class LeftResidual(ResultPart):
    """The residual of a joint after the findings."""

    learnable_share: Number
    """Share of its energy that a flexible learner predicts [-]."""
    systematic: bool
    """True if this share exceeds chance."""
    beyond_noise: bool
    """True if the error is clearly larger than the noise floor."""
    region: FoundRegion | None
    """Region of the residual."""


class Untried(FoundEffect):
    """An effect that was not tried."""

    reason: str
    """Reason."""


class PartlySeen(FoundEffect):
    """Friction that may be invisible, because rows close to reversals and at rest are left out."""

    seen_share: Number
    """Share of its energy in the used rows, at the nonlinear parameters with the least [-]."""


class FoundPulsation(ResultPart):
    """A line in the spectrum of the residual."""

    joint: str
    """Joint of the line."""
    frequency: Number
    """Frequency of the line [Hz]."""
    relative_magnitude: Number
    """Its rms over that of the force [-]."""


class HydraulicQuantity(FoundParameter):
    """A value of the hydraulics, and its usual limit."""

    usual_limit: Number
    """Limit of the usual range [unit]."""
    identified: bool = False
    """True if the limit follows from the identified value of the machine; otherwise from the data
    sheet.
    """


class FlowBalance(ResultPart):
    """Flow balance of a cylinder."""

    unexplained_share: Number
    """Rms of the unexplained flow over that of the piston [-]."""
    known_time: Number
    """Time in which all signals of the balance are known [s]."""
    recorded_time: Number
    """Time of the recordings [s]."""
    quantities: dict[str, HydraulicQuantity]
    """Values by name in the catalogue; empty if too much flow is unexplained."""


class Findings(ResultFile):
    """Answer of `diagnose`, with its evidence."""

    verdict: Verdict
    """The answer."""
    reason: str
    """Reason for the verdict, in a sentence."""
    values_kept: bool
    """True if the values of the model were kept (`--fixed`)."""
    where: dict[str, FoundPlace]
    """Residual of the given model, by joint."""
    findings: list[FindingEntry]
    """Effects of the force, strongest first; then of the flow; then loads."""
    nearest: NearestEffects | None
    """The nearest effects, if nothing is named."""
    own_terms: list[OwnTermEntry] = []
    """Terms of `--terms` that are not named."""
    unknown: UnknownPlace | None = None
    """Unknown force; with findings, on the joint without a finding that has the largest residual.
    """
    model_error: ModelErrors
    """Errors before and after."""
    left: dict[str, LeftResidual]
    """Values by joint."""
    undetermined: list[str]
    """Parameters of the model that the recordings do not determine. Terms that consist of them are
    left out; of combinations with others, the determined part counts.
    """
    clock: str | None
    """Reason why the recordings have no common time, in which oil warms up; null if they have."""
    needs_units: list[str]
    """Quantities in counts, whose unit is needed for parameters in units."""
    warnings: list[str]
    """Warnings about recordings, and about results that do not generalize."""
    without: list[str]
    """Excluded effects (`--without`)."""
    not_testable: list[Untried]
    """Effects that the parameters of the model absorb."""
    not_observable: list[Untried]
    """Effects that are not observable in these recordings."""
    partly_seen: list[PartlySeen] = []
    """Friction that these recordings may show too little."""
    pulsations: list[FoundPulsation]
    """Spectral lines that are the same in all recordings."""
    flow: dict[str, FlowBalance]
    """Flow balance by joint."""
    open: OpenQuestions
    """Questions for another experiment: `design --discriminate` finds its motion."""
    named_from: NumberByJoint
    """Relative magnitude from which nine in ten effects are named, by joint, before any filter [-].
    """
    suspicions: list[str] = []
    """Problems of the recordings, from `check_recording`."""
