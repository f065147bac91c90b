"""The pictures of the gap, and what a picture of the page is."""

from typing import Any, NamedTuple

from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.region import energy_shares
from crane_identification.diagnosis.report import charts
from crane_identification.notation import spoken


class Picture(NamedTuple):
    """A figure: the id of its div, what it shows, that in words, and its description."""

    key: str
    caption: str
    words: str
    description: dict[str, Any]

    @property
    def height(self) -> int:
        """What the page keeps free for it [px]."""
        return int(self.description["layout"]["height"])


def gap_pictures(diagnosis: Diagnosis) -> list[Picture]:
    """Force and simulated motion on the held-out recordings, before and after."""
    gap = diagnosis.gap
    added = diagnosis.after is not diagnosis.before
    names = [spoken(joint) for joint in diagnosis.joints]
    force = charts.grouped_bars(
        names,
        (
            ("before", charts.BEFORE, 100 * gap.before),
            *([("after", charts.AFTER, 100 * gap.after)] if added else []),
            ("learner", charts.BEST, 100 * gap.best),
            ("noise floor", charts.FLOOR, 100 * gap.floor),
        ),
        "error of the force [% of its rms]",
    )
    units = {"rad": "mrad", "m": "mm"}
    own = dict.fromkeys(units[diagnosis.before.setting.units[joint]] for joint in diagnosis.joints)
    motion = charts.grouped_bars(
        names,
        (
            ("before", charts.BEFORE, 1e3 * gap.motion_before.position_rms),
            *([("after", charts.AFTER, 1e3 * gap.motion_after.position_rms)] if added else []),
        ),
        f"error after {gap.motion_before.horizon:.2g} s [{', '.join(own)}]",
    )
    words = "The table has its numbers."
    return [
        Picture("gap-force", "Force that the model does not explain", words, force),
        Picture("gap-motion", "Simulated against measured motion", words, motion),
    ]


def where_picture(diagnosis: Diagnosis) -> Picture:
    """Which joint carries what the model does not explain."""
    names = [spoken(joint) for joint in diagnosis.joints]
    shares = energy_shares(diagnosis.training, diagnosis.proof.before)
    bars = charts.grouped_bars(
        names, (("share", charts.BEFORE, 100 * shares),), "share of the unexplained [%]"
    )
    return Picture("where", "Which joint", "The list has its numbers.", bars)
