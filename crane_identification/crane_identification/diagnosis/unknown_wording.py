"""What findings.json says of an unknown force, in the words that page and terminal share."""

from collections.abc import Iterator

from crane_identification.diagnosis import finding_wording
from crane_identification.diagnosis.finding_wording import Content
from crane_identification.notation import human, listed, short_percent, spoken, with_uncertainty

CLEAR_SHARE = 0.05  # of the energy beyond noise, that speaks against a signature where it is left
CLEAR_SIGMAS = 3.0  # from which a recording differs from the others


def title(content: Content) -> str:
    """Where it is, and how large; empty where nothing is unknown."""
    unknown = content.get("unknown")
    if unknown is None:
        return ""
    size = short_percent(unknown["strength"])
    what = "What more there is" if content["findings"] else "What it"
    return f"{what} may depend on ({spoken(unknown['joint'])}, rms {size} of the drive force)"


def lines(content: Content) -> list[str]:
    """What an unknown force may depend on, what speaks against that, and how recordings differ."""
    unknown = content.get("unknown")
    return [] if unknown is None else [*_signatures(unknown), *_recordings(unknown)]


def nearest_drawn(unknown: Content) -> Content | None:
    """The nearest signature that is drawn over a variable; None where none is."""
    return next((one for one in unknown["signatures"] if one["shapes"]), None)


def _signatures(unknown: Content) -> Iterator[str]:
    nearest = nearest_drawn(unknown)
    for place, one in enumerate(unknown["signatures"]):
        yield (
            f"{one['signature']}: some shape of it explains "
            f"{short_percent(one['explained_share'])}, and helps to predict {one['better']} of "
            f"{one['asked']} recordings it is not fitted to; {_against(one, place)}"
        )
        if nearest is not None and one is nearest:
            yield from finding_wording.drawn(nearest)


def _against(one: Content, place: int) -> str:
    """What speaks against a signature at a place of the list, the best first."""
    said = []
    left = 1.0 - (one["explained_share"] or 0.0)
    if left > CLEAR_SHARE:
        said.append(f"{short_percent(left)} are left")
    if one["better"] < one["asked"]:
        said.append(f"it predicts {one['asked'] - one['better']} recordings worse")
    if place:
        said.append("the first explains more")
    if not one["effects"]:
        said.append("no effect of the catalogue is that")
    return f"against it: {listed(said)}" if said else "nothing but its law speaks against it"


def _recordings(unknown: Content) -> Iterator[str]:
    """In which recordings there is more of it, and what differs between them."""
    differing = [f"{name} ({ratio:.1f} times)" for name, ratio in unknown["recordings"].items()]
    if differing:
        yield f"far more of it than in most recordings is in {listed(differing)}"
    if one := unknown["difference"]:
        unit, factor = human(one["unit"])
        changes = [
            f"{' ± '.join(with_uncertainty(factor * change, factor * std_dev))} in {name}"
            for name, change in one["changes"].items()
            if abs(change) > CLEAR_SIGMAS * (std_dev := one["std_devs"][name])
        ]
        yield (
            f"recordings differ from each other: {one['parameter']} of each by itself explains "
            f"{short_percent(one['explained_share'])}; beside that of all it is off by "
            f"{listed(changes)} {unit}".rstrip()
        )
