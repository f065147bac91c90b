"""What the forces say of wiring, names, signs and clocks."""

from collections.abc import Iterator

from crane_identification.notation import spoken
from crane_identification.recording_check.absolute import absolute
from crane_identification.recording_check.constants import BETTER, NEEDED, POOR, UNEXPLAINED
from crane_identification.recording_check.delay import Delay, find_delay
from crane_identification.recording_check.flow import commands, fit
from crane_identification.recording_check.forces import crane, equations
from crane_identification.recording_check.grid import Grid
from crane_identification.recording_check.masses import masses
from crane_identification.recording_check.repairs import Repair, repairs, unexplained
from crane_identification.recording_check.suspicion import Suspicion


def wiring(whole: Grid) -> Iterator[Suspicion]:
    """Mix-ups that explain what plausible masses and friction cannot; then finer ones.

    `RangeError` where the linkages cannot be assembled at the positions.
    """
    model = crane(whole.machine)
    found = equations(model, whole)
    left = found.explained(model)
    values, std_devs, least = found.free()
    implausible = tuple(masses(model, values, std_devs)) if left > NEEDED * least else ()
    delay = find_delay(model, whole)
    if left > POOR:
        tried = [(unexplained(model, one), one) for one in repairs(whole)]
        without, best = min(tried, key=lambda one: one[0])
        late = delay is not None and delay.common and delay.left_without < without
        scaled = any(one.decisive for one in implausible)  # which explains as much without a mix-up
        if not late and BETTER * without < (least if scaled else left):
            yield _mixed_up(whole, best, left, without)
            return
    if delay is not None:
        yield _late(delay)
        if delay.common:
            return
    yield from implausible
    if left > UNEXPLAINED and not implausible:
        yield Suspicion(
            "forces",
            f"{left:.0%} of them are left by any plausible masses and friction",
            "the machine file (linkages, areas) is of another machine, or several things are "
            "mixed up",
            decisive=False,
        )
    if whole.force is None:
        yield from absolute(whole)
        if whole.record.command is not None:
            yield from commands(whole)


def _mixed_up(whole: Grid, repair: Repair, left: float, without: float) -> Suspicion:
    evidence = (
        f"plausible masses and friction leave {left:.1%} of the force, without that {without:.1%}"
    )
    if repair.joint is not None and whole.record.command is not None:
        j = whole.joints.index(repair.joint)
        flow, other = fit(whole, j, j), fit(whole, j, j, exchanged=True)
        if other.left < flow.left:
            evidence += (
                f"; valve command and cylinder speed disagree by {flow.left:.1%}, without that by "
                f"{other.left:.1%}"
            )
    return Suspicion(repair.where, evidence, repair.what, decisive=True)


def _late(delay: Delay) -> Suspicion:
    where = ", ".join(spoken(joint) for joint in delay.joints)
    behind = f"{abs(delay.delay):.2f} s {'behind' if delay.delay > 0.0 else 'ahead of'} positions"
    evidence = (
        f"forces fit {behind}{f', drifting by {delay.drift:+.2%}' if delay.drift else ''}: "
        f"{delay.left:.1%} of them unexplained, without that {delay.left_without:.1%}"
    )
    cause = (
        "the two are stamped by clocks that run apart"
        if delay.drift
        else "pressures and positions are stamped by clocks that differ"
        if delay.common
        else "a slow transducer or encoder, wrong geometry, or an effect that looks like a delay"
    )
    return Suspicion(where, evidence, cause, decisive=delay.common)
