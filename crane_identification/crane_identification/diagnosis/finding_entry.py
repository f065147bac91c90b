"""What findings.json says of one effect that was found, or came near."""

from crane_model.result_file import Number, NumberByJoint, ResultPart


class FoundEffect(ResultPart):
    """An effect and its place."""

    effect: str
    """Its type, as in the catalogue and in model files."""
    name: str
    """What people call it."""
    joint: str
    """The joint, or `all` where it is of the whole crane."""


class NearEffect(FoundEffect):
    """An effect that comes near."""

    score: Number
    """2 Δ log L of the training recordings [-]."""
    threshold: Number
    """What a finding has to score [-]."""


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
    """What physics keeps it above [unit]."""
    determined: bool
    """Whether the recordings determine it."""


class ChangedParameter(FoundParameter):
    """A parameter that the model had with another value."""

    before: Number
    """What it has changed from [unit]."""
    before_std_dev: Number
    """Standard deviation of that [unit]."""
    change: Number
    """By how much it has changed [unit]."""
    change_std_dev: Number
    """Standard deviation of that [unit]."""


class DrawnShape(ResultPart):
    """A dependence as it was drawn: values at knots, straight lines between them."""

    variable: str
    """What it depends on; of a velocity and of a force, their size."""
    variable_unit: str
    """Of the knots."""
    knots: list[Number]
    """Where the values are [variable_unit]."""
    values: list[Number]
    """Force over what it is multiplied by [unit]."""
    std_devs: list[Number]
    """Their standard deviations; 0 where the shape is held at 0 [unit]."""
    unit: str
    """Of the values."""
    times: str
    """What it is multiplied by: the direction sgn(q'), the velocity q', or 1."""


class FindingEntry(FoundEffect):
    """An effect that the model lacks, or of flows and loads that is found beside those."""

    changed: bool = False
    """Whether a value of the model has changed, rather than that a term is missing."""
    class_members: list[FoundEffect]
    """Effects that these recordings cannot tell from this one."""
    parameters: list[ChangedParameter | FoundParameter]
    """Of this effect, in the model with all findings."""
    shapes: list[DrawnShape] = []
    """Its law, where none of the catalogue fits; empty where one does."""
    carried_in: dict[str, list[str]]
    """Recordings that carry a load, by the parameter of the load, and by `none` those without."""
    score: Number
    """2 Δ log L of the training recordings [-]."""
    threshold: Number
    """What a finding has to score [-]."""
    false_alarm_rate: Number
    """Promised of the threshold [-]."""
    runner_up: FoundEffect | None
    """The effect that explains most in its place."""
    margin: Number
    """Score beyond the runner-up's [-]."""
    margin_needed: Number
    """Margin with which the runner-up is ruled out [-]."""
    visibility: Number
    """Share of its energy that the other parameters do not take up [-]."""
    strength: Number
    """Rms of its force over that of the drive force; null for flows and loads [-]."""
    visible_strength: Number
    """The same of the part that other parameters do not take up; for a flow, over the flow [-]."""
    held_out_gains: NumberByJoint
    """What it gains on each recording in which it acts when fitted to the others, by their names;
    where these are few, on blocks of time [-]."""
    settled_by: str
    """The experiment that tells it from what looks alike."""
