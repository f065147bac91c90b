"""Does a model predict recordings that took no part as well as those that it is trained on?"""

from collections.abc import Sequence

import numpy as np

from crane_identification.notation import listed, short_percent, spoken

WORSE_ELSEWHERE = 1.5
"""Held-out error over that of the training and its noise, above which a model does not carry over.
"""


def elsewhere(
    joints: Sequence[str], held_out: np.ndarray, trained: np.ndarray, noise_floor: np.ndarray
) -> tuple[str, ...]:
    """A warning, if any, of the joints on which the model errs clearly more on those held out.

    Errors (j,) and `noise_floor` (j,), NaN where it is not known, are relative to the force.
    """
    expected = WORSE_ELSEWHERE * np.hypot(trained, np.nan_to_num(noise_floor))
    worse = [
        f"by {short_percent(float(there))} on the {spoken(joint)} "
        f"({short_percent(float(here))} in training)"
        for joint, there, here, limit in zip(joints, held_out, trained, expected, strict=True)
        if there > limit
    ]
    if not worse:
        return ()
    return (
        f"The model does not carry over to the held-out recordings: there it errs {listed(worse)}. "
        "The machine has changed, its motion is another, or an effect is missing; diagnose "
        "--fixed, with them as --train, says what has changed.",
    )
