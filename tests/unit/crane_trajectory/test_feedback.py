"""What the feedback of an experiment says of its phase."""

from unit.crane_trajectory.test_experiment import Crane

from crane_trajectory.motion.motion import Phase
from crane_trajectory.trajectory_topics import feedback_message


def test_phases_are_told_in_their_order() -> None:
    """From before the first joint state, when no reference is followed yet, to the end."""
    crane = Crane()
    told = [feedback_message(crane.experiment).phase]
    while not crane.experiment.over:
        crane.cycle()
        told.append(feedback_message(crane.experiment).phase)
    assert told == sorted(told)
    assert set(told) == {Phase.APPROACH, Phase.EXCITATION, Phase.STOP}
