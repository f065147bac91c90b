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
    """Its type, as in the catalogue and in model files."""
    name: str
    """The name that people use."""
    joint: str
    """The joint, or `all` where it is of the whole crane."""


class NearEffect(FoundEffect):
    """An effect that comes near."""

    score: Number
    """2 Δ log L of the training recordings [-]."""
    threshold: Number
    """The score that a finding needs [-]."""


class FoundParameter(ResultPart):
    """A parameter of a finding, or a value of the hydraulics."""

    name: str
    """As in model files."""
    value: Number
    """Estimate [unit]."""
    std_dev: Number
    """Its standard deviation [unit]."""
    unit: str
    """SI; `1` for a ratio, `counts` where readings have no unit."""
    minimum: Number
    """The least value that physics allows [unit]."""
    determined: bool
    """Whether the recordings determine it."""

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
    """A parameter that the model had with another value."""

    before: Number
    """The value before the change [unit]."""
    before_std_dev: Number
    """Standard deviation of that [unit]."""
    change: Number
    """By how much it has changed [unit]."""
    change_std_dev: Number
    """Standard deviation of that [unit]."""


class FoundCurve(ResultPart):
    """A dependence as it was drawn: values at knots, straight lines between them."""

    variable: str
    """The quantity that it depends on; of a velocity and of a force, their size."""
    variable_unit: str
    """The unit of the knots."""
    knots: list[Number]
    """Places of the values [variable_unit]."""
    values: list[Number]
    """Force over what it is multiplied by [unit]."""
    std_devs: list[Number]
    """Their standard deviations; 0 where the shape is held at 0 [unit]."""
    unit: str
    """The unit of the values."""
    times: str
    """Its factor: the direction sgn(q'), the velocity q', or 1."""


class FindingEntry(FoundEffect):
    """An effect that the model lacks, or of flows and loads that is found beside those."""

    changed: bool = False
    """Whether a value of the model has changed, rather than that a term is missing."""
    ambiguity_group: list[FoundEffect] = []
    """Effects that these recordings cannot tell from this one."""
    parameters: list[ChangedParameter | FoundParameter]
    """Parameters of this effect, in the model with all findings."""
    curves: list[FoundCurve] = []
    """Its law, where none of the catalogue fits; empty where one does."""
    deviation: list[FoundCurve] = []
    """The force that its form lacks; empty where the form is that of the catalogue."""
    carried_in: dict[str, list[str]] = {}
    """Recordings that carry a load, by the parameter of the load, and by `none` those without."""
    score: Number
    """2 Δ log L of the training recordings [-]."""
    threshold: Number
    """The score that a finding needs [-]."""
    runner_up: FoundEffect | None = None
    """The effect that explains most in its place."""
    margin: Number
    """Score beyond the runner-up's [-]."""
    margin_needed: Number = 0.0
    """Margin with which the runner-up is ruled out [-]."""
    relative_magnitude: Number = None
    """Rms of its force over that of the drive force, while its joint slides; null for flows and
    loads [-]."""
    visible_magnitude: Number = None
    """The same of the part that other parameters do not take up; for a flow, over the flow [-]."""
    discriminated_by: str
    """The experiment that tells it from what looks alike."""


class FoundRegion(ResultPart):
    """The place of most of a residual."""

    variable: str
    """The quantity that the residual follows most."""
    range: tuple[Number, Number]
    """Lowest and highest value of it [unit]."""
    unit: str
    """The unit of the quantity."""
    share: Number
    """Share of the energy of the residual [-]."""


class FoundPlace(ResultPart):
    """The residual of a joint before anything is added."""

    energy_share: Number
    """Share of all that the model leaves, in units of the noise [-]."""
    region: FoundRegion | None
    """The place of the residual."""


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
    """Share of what the training recordings leave where they act [-]."""
    model_error: dict[str, ErrorChange]
    """By joint."""
    objection: str
    """Why they are no answer."""


class OwnTermEntry(FoundEffect):
    """A term of `--terms` that is not named."""

    objection: str
    """Why not."""
    tried: NearestEffects | None
    """Its effect by itself; none if these recordings cannot show it."""


class NearbySignature(ResultPart):
    """A quantity that an unknown force may depend on."""

    signature: str
    """In words: the variable, and with which symmetry."""
    effects: list[str]
    """Types of the effects that have it; none where the catalogue knows no such effect."""
    explained_share: Number
    """Share of the energy beyond noise, by the best shape of it [-]."""
    better: int
    """Recordings that it helps to predict when it is fitted to the others [-]."""
    asked: int
    """Recordings that this was asked of [-]."""
    curves: list[FoundCurve]
    """The best shape as it was drawn, for each factor; empty where it is no curve."""


class FoundDifference(ResultPart):
    """A parameter of the model that is not alike in all recordings."""

    parameter: str
    """Its name."""
    unit: str
    """SI; `1` for a ratio, `counts` where readings have no unit."""
    explained_share: Number
    """Share of the energy beyond noise, if each recording has its own value [-]."""
    changes: NumberByJoint
    """By recording: what it differs by from the value of all [unit]."""
    std_devs: NumberByJoint
    """Standard deviations of these [unit]."""


class FoundFormula(ResultPart):
    """A short formula for an unknown force."""

    equation: str
    """The force, by the position q, velocity q' and acceleration q'' of its joint and others."""
    parameters: list[FoundParameter]
    """Its coefficients."""
    before: Number
    """Held-out error of the force without it, over the rms of the force [-]."""
    after: Number
    """With it [-]."""
    closed_share: Number
    """Share of the explainable energy on held-out recordings that it explains [-]."""
    source: str
    """A Python file for `--terms` that holds it as a term; `diagnose` writes it beside this one."""


class UnknownPlace(ResultPart):
    """An unknown force."""

    joint: str
    """The joint with most of it."""
    relative_magnitude: Number
    """Rms of what is beyond noise there, over that of the drive force [-]."""
    signatures: list[NearbySignature]
    """The nearest ones, best first."""
    recordings: NumberByJoint
    """By the recordings in which there is far more of it: rms over the median of all [-]."""
    difference: FoundDifference | None
    """The parameter by which recordings differ, if that is most of it."""
    formula: FoundFormula | None = None
    """A short formula, if one explains it."""


class ModelError(ResultPart):
    """Errors of a joint on the held-out recordings."""

    force_relative_error: Number
    """Rms error of the force over that of the force [-]."""
    noise_floor: Number
    """Scatter between periods over the same; null where none was repeated [-]."""
    best_achievable: Number
    """Error that a flexible learner reaches over the same [-]."""
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
    """How long each simulation lasts [s]."""
    windows: int
    """Simulations, one behind the other [-]."""
    displacement: NumberByJoint
    """How far the joint itself went in that time, on average [rad, m]."""
    before: NumberByJoint
    """Rms error at the end with the model as it came [rad, m]."""
    after: NumberByJoint
    """The same with the findings [rad, m]."""


class ModelErrors(ResultPart):
    """The proof: errors on recordings that took no part."""

    before: dict[str, ModelError]
    """Errors of the model as it came, by joint."""
    after: dict[str, ModelError]
    """Errors of the model with the findings, by joint."""
    closed: NumberByJoint
    """Share of the explainable energy that the findings explain, where training went; null where
    there is none [-]."""
    loads: list[CarriedLoad]
    """Loads of single held-out recordings."""
    from_commands: list[CommandedError] = []
    """By how far ahead; empty where that cannot be simulated."""
    from_commands_reason: str = ""
    """Why no motion was simulated from commands; empty if it was."""


class LeftResidual(ResultPart):
    """The residual of a joint after the findings."""

    learnable_share: Number
    """Share of its energy that a flexible learner predicts [-]."""
    systematic: bool
    """Whether that is more than chance gives."""
    beyond_noise: bool
    """Whether the error is clearly larger than the noise floor."""
    region: FoundRegion | None
    """The place of the residual."""


class Untried(FoundEffect):
    """An effect that was not tried."""

    reason: str
    """Why not."""


class PartlySeen(FoundEffect):
    """Friction that may stay unseen: rows close to reversals and at rest are left out."""

    seen_share: Number
    """Share of its energy in the used rows, at the nonlinear parameters with the least [-]."""


class FoundPulsation(ResultPart):
    """A line in the spectrum of what the model leaves."""

    joint: str
    """On which."""
    frequency: Number
    """Frequency of the line [Hz]."""
    relative_magnitude: Number
    """Its rms over that of the force [-]."""


class HydraulicQuantity(FoundParameter):
    """A value of the hydraulics, beside what is usual."""

    usual_limit: Number
    """Limit of what is usual [unit]."""
    identified: bool = False
    """Whether that is of the machine's own identified value, not of the data sheet."""


class FlowBalance(ResultPart):
    """The balance of the oil of a cylinder."""

    unexplained_share: Number
    """Rms of what is unexplained over that of the piston's flow [-]."""
    known_time: Number
    """For which everything is known that the balance needs [s]."""
    recorded_time: Number
    """Time of the recordings [s]."""
    quantities: dict[str, HydraulicQuantity]
    """By name in the catalogue; empty where too much is left for any to be good."""


class Findings(ResultFile):
    """The answer of `diagnose`, and all that it rests on."""

    verdict: Verdict
    """The answer."""
    reason: str
    """Why, in a sentence."""
    values_kept: bool
    """Whether the values of the model were kept (`--fixed`)."""
    where: dict[str, FoundPlace]
    """By joint: where the model as it came disagrees."""
    findings: list[FindingEntry]
    """Effects of the force, strongest first; then of the flow; then loads."""
    nearest: NearestEffects | None
    """The nearest effects, if nothing is named."""
    own_terms: list[OwnTermEntry] = []
    """Terms of `--terms` that are not named."""
    unknown: UnknownPlace | None = None
    """An unknown force; beside names, on the joint without one that most is left on."""
    model_error: ModelErrors
    """Errors before and after."""
    left: dict[str, LeftResidual]
    """By joint."""
    undetermined: list[str]
    """Parameters of the model that the recordings do not determine: terms of theirs alone were left
    out, of combinations with others counts what is determined."""
    clock: str | None
    """Why the recordings have no time in common, through which oil warms up; null if they have."""
    needs_units: list[str]
    """Quantities that came in counts, and without whose unit no value has one."""
    warnings: list[str]
    """About the recordings, and about results that do not carry over."""
    without: list[str]
    """Effects that were not asked for (`--without`)."""
    not_testable: list[Untried]
    """Effects that hide behind the parameters of the model."""
    not_observable: list[Untried]
    """Effects of which these recordings show nothing."""
    partly_seen: list[PartlySeen] = []
    """Friction of which these recordings may show too little."""
    pulsations: list[FoundPulsation]
    """Lines that are the same in all recordings."""
    flow: dict[str, FlowBalance]
    """By joint whose flow was recorded."""
    open: OpenQuestions
    """Questions for another experiment: `design --discriminate` finds its motion."""
    named_from: NumberByJoint
    """By joint: strength from which nine in ten effects are named, before any filter [-]."""
    suspicions: list[str] = []
    """Suspicions of the recordings themselves."""
