"""demo.json: what only the demo knows; the rest is in the files of `identify` and `diagnose`."""

from pathlib import Path

import bags
from laws import OUT

from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_benchmark.rehearsal.outcome import LostEncoder
from crane_identification.report.summary import Summary
from crane_model.result_file import Number, NumberByJoint, ResultFile, ResultPart
from crane_sim.ground_truth import TrueEffect
from crane_trajectory.run_excitation_node import ExcitationResult

FILE = OUT / "demo.json"


class OnlineEstimate(ResultPart):
    """What the identification node found, beside the truth."""

    name: str
    """Of the parameter."""
    true_value: float
    """In the simulated crane [SI]."""
    value: Number
    """The node's estimate at the end of the recording [SI]; null where it was not determined."""
    std_dev: Number
    """Its standard deviation [SI]."""


class Recording(ResultPart):
    """A bag that was recorded live."""

    messages: dict[str, int]
    """By topic [-]."""
    gaps: dict[str, int]
    """Pauses of more than 1.5 cycles in the topics of the control loop [-]."""


class Following(ResultPart):
    """How well the fitted model led the crane through the first experiment again."""

    controller: str
    """By its name."""
    tracking_rms: NumberByJoint
    """Rms of reference minus position [rad, m]."""
    times_better: NumberByJoint
    """Than (36) in the first experiment [-]; null where the joint was held."""


class Unplugged(LostEncoder):
    """What became of a crane that lost an encoder in mid-motion."""

    estimate_error: float
    """Estimate minus encoder, once home and plugged in again [rad, m]."""
    true_load: float
    """At the tip [kg]."""
    load: float
    """Its estimate at home [kg]."""
    load_std_dev: float
    """Its standard deviation [kg]."""


class DemoOutcome(ResultFile):
    """What the demo measured itself."""

    online: list[OnlineEstimate]
    """Of all parameters that have a true value and were fitted."""
    tracking_rms: NumberByJoint
    """Rms of reference minus position in the first experiment, led by (36) [rad, m]."""
    following: Following | None = None
    """The same led by the fitted model; null where it cannot lead."""
    unplugged: Unplugged | None = None
    """What happened without an encoder; null where the machine permits no substitute."""
    recorded: dict[str, Recording]
    """By use, `train` and `validate`."""
    injected: list[TrueEffect] = []
    """Effects that were injected in the last act."""
    wall_seconds: dict[str, float] = {}
    """By phase [s]."""


def recorded(law: CraneRun) -> DemoOutcome:
    """What is known once the live bags have been identified."""
    uses = {use: law.bag(use) for use in ("train", "validate")}
    return DemoOutcome(
        online=_online(law, uses["train"]),
        tracking_rms=ExcitationResult.read(law.result("train")).rms_tracking_error,
        recorded={
            use: Recording(messages=bags.messages(bag), gaps=bags.gaps(bag))
            for use, bag in uses.items()
        },
    )


def motion_errors(summary: Summary) -> tuple[str, dict[str, float]]:
    """Heading of the errors of simulated motion, and those of the joints that can be simulated."""
    motion = summary.simulated_motion
    if motion is None:
        return "motion", {}
    pairs = {
        joint: (error, motion.displacement_rms[joint])
        for joint, error in motion.position_rms.items()
    }
    errors = {joint: error / rms for joint, (error, rms) in pairs.items() if error and rms}
    return f"motion {motion.horizon:.3g} s ahead", errors


def _online(law: CraneRun, bag: Path) -> list[OnlineEstimate]:
    true_values = law.true_values()
    estimates = bags.online_estimate(bag)
    return [
        OnlineEstimate(name=name, true_value=true_values[name], value=value, std_dev=std_dev)
        for name, (value, std_dev) in estimates.items()
    ]
