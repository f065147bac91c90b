"""What the study measures of hydraulics and controllers, for the manual."""

from collections.abc import Iterator, Mapping

from crane_benchmark.measured import MeasuredRow
from crane_benchmark.study.following import TRAINED, Followed
from crane_benchmark.study.hydraulic_aims import AHEAD, AIMS
from crane_trajectory.control.choice import NAMES, PD_DEAD_ZONE

RMS_AIM = "0.4 mrad, 0.6 mrad, 0.4 mm, and 40, 60, 20 times better than (36)"
MILLI = 1e3


def rows(followed: Followed) -> Iterator[MeasuredRow]:
    """Values, motion from commands, and what each controller leaves."""
    for what, aim in AIMS.items():
        found = followed.farthest_off(aim)
        yield MeasuredRow(
            cells=[
                f"{what} from that bag, farthest off; its σ",
                aim.told(aim.live),
                f"{aim.told(found.error)}; {aim.told(found.std_dev)}",
            ],
            values={f"{_key(what)}_error": found.error, f"{_key(what)}_std_dev": found.std_dev},
        )
    for one in followed.summary["simulated_from_commands"]:
        horizon = one["horizon"]
        shares = {joint: one["position_rms"][joint] / one["way"][joint] for joint in one["way"]}
        yield MeasuredRow(
            cells=[
                f"motion from valve commands alone, {horizon:g} s ahead, held out "
                f"({', '.join(shares)})",
                f"{AHEAD[horizon]:.1%}",
                ", ".join(f"{{ahead_{horizon:g}_{joint}:.3%}}" for joint in shares),
            ],
            values={f"ahead_{horizon:g}_{joint}": share for joint, share in shares.items()},
        )
    for name, by_law in followed.rms.items():
        for law in NAMES:
            yield _law_row(name, law, by_law[law], by_law[PD_DEAD_ZONE], followed.joints)


def _law_row(
    name: str, law: str, rms: Mapping[str, float], before: Mapping[str, float], joints: list[str]
) -> MeasuredRow:
    keys = [f"{name}_{law}_{joint}" for joint in joints]
    values = {key: MILLI * rms[joint] for key, joint in zip(keys, joints, strict=True)}
    shown = "/".join(f"{{{key}:.3g}}" for key in keys)
    seen = "" if name == TRAINED else ", which nothing was fitted to"
    if law == PD_DEAD_ZONE:
        what = f"rms error on {name}{seen}, by (36) ({'/'.join(joints)}) [mrad, mm]"
        return MeasuredRow(cells=[what, "", shown], values=values)
    better = {f"{key}_better": before[j] / rms[j] for key, j in zip(keys, joints, strict=True)}
    times = "/".join(f"{{{key}_better:.0f}}" for key in keys)
    return MeasuredRow(
        cells=[f"the same by `{law}`", RMS_AIM, f"{shown}; {times} times better"],
        values=values | better,
    )


def _key(what: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in what)
