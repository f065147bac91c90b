"""One good recording, spoilt in every way that was seen: the right sensor and cause are named."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.recording_check.corruption import (
    CHAMBERS,
    PRESSURES,
    chambers,
    clipped,
    column,
    each,
    exchanged,
    held,
    stuck,
    thinned,
    timed,
    unreceived,
)
from unit.crane_identification.recording_check.recorded import recorded

from crane_bags.clocks import SetBack
from crane_identification import Log, Signal
from crane_identification.notation import spoken
from crane_identification.recording_check.check import check, vetted
from crane_identification.recording_check.suspicion import RecordingVerdict
from crane_model import DataError, Machine, generalized_forces, load_machine

INNER, OUTER, TELESCOPE = range(3)
JOINTS = ("inner boom", "outer boom", "telescope")


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load_machine()


@pytest.fixture(scope="module")
def good() -> Log:
    return recorded()


def with_forces(machine: Machine, log: Log, factor: float = 1.0) -> Log:
    """As a table that holds generalized forces instead of pressures."""
    assert log.pressure_a is not None and log.pressure_b is not None
    pressures = log.pressure_a.value, log.pressure_b.value
    force = generalized_forces(machine, log.position.value, *pressures, log.joints)
    signal = Signal(log.pressure_a.time, factor * force, "columns of forces")
    return replace(log, pressure_a=None, pressure_b=None, force=signal, command=None)


def test_a_good_recording_is_not_suspected(machine: Machine, good: Log) -> None:
    for log in (good, with_forces(machine, good)):
        found = check(machine, log)
        assert found.verdict is RecordingVerdict.RIGHT


def spoilt() -> list:
    """(how, where, cause): the cause in words that the suspicion must hold."""
    positions = ("position",)
    cases: dict[str, tuple[Callable[[Log], Log], str, str]] = {}
    for j, joint in enumerate(JOINTS):
        cases |= {
            f"chambers {joint}": (lambda x, j=j: chambers(x, j), joint, "chambers A and B"),
            f"position sign {joint}": (
                lambda x, j=j: each(x, positions, column(j, np.negative)),
                joint,
                "sign",
            ),
            f"pressure sign {joint}": (
                lambda x, j=j: each(x, PRESSURES, column(j, np.negative)),
                f"pressures of the {joint}",
                "sign is reversed",
            ),
        }
        for name, letter in zip(PRESSURES, "AB", strict=True):
            cases[f"stuck {joint} {letter}"] = (
                lambda x, j=j, name=name: each(x, (name,), column(j, stuck)),
                f"{joint}, chamber {letter}",
                "stuck",
            )
            cases[f"clipped {joint} {letter}"] = (
                lambda x, j=j, name=name: each(x, (name,), column(j, clipped)),
                f"{joint}, chamber {letter}",
                "clipped",
            )
    for j in (INNER, OUTER):
        cases[f"degrees {JOINTS[j]}"] = (
            lambda x, j=j: each(x, positions, column(j, np.degrees)),
            JOINTS[j],
            "look like degrees",
        )
        cases[f"turn {JOINTS[j]}"] = (
            lambda x, j=j: each(x, positions, column(j, lambda q: q + 2.0 * np.pi)),
            JOINTS[j],
            "off by +1 turn",
        )
    cases["millimetres"] = (
        lambda x: each(x, positions, column(TELESCOPE, lambda q: 1e3 * q)),
        "telescope",
        "look like mm",
    )
    for i, k in ((INNER, OUTER), (INNER, TELESCOPE), (OUTER, TELESCOPE)):
        pair = f"{JOINTS[i]} {JOINTS[k]}"
        for what, signals in (
            ("positions", positions),
            ("pressures", PRESSURES),
            ("names", (*positions, *PRESSURES)),
        ):
            cases[f"exchanged {what} {pair}"] = (
                lambda x, i=i, k=k, signals=signals: each(x, signals, exchanged(i, k)),
                JOINTS[k],
                "exchanged",
            )
    for unit, size in {"kPa": 1e3, "bar": 1e5, "MPa": 1e6, "psi": 6894.757}.items():
        cases[unit] = (
            lambda x, size=size: each(x, PRESSURES, lambda p: p / size),
            "pressures of the telescope",
            f"look like {unit}",
        )
    cases |= {
        "half": (lambda x: each(x, PRESSURES, lambda p: 0.5 * p), "masses", "0.51 times"),
        "double": (
            lambda x: each(x, PRESSURES, lambda p: 2.0 * p),
            "pressures of the outer boom",
            "too large",
        ),
        "10 Hz": (lambda x: thinned(x, positions, 20), "/joint_states", "too slow"),
        "20 Hz held": (
            lambda x: each(x, positions, held(10)),
            "telescope",
            "measured 20 times a second",
        ),
    }
    for late in (-0.1, 0.05, 0.1, 0.4, 1.0):
        side = "behind" if late > 0.0 else "ahead of"
        cases[f"late {late}"] = (
            lambda x, late=late: timed(unreceived(x), CHAMBERS, lambda t: t + late),
            "inner boom, outer boom, telescope",
            f"forces fit {abs(late):.2f} s {side} positions",
        )
    cases["slow clock"] = (
        lambda x: timed(unreceived(x), CHAMBERS, lambda t: 1.01 * t),
        "inner boom, outer boom, telescope",
        "clocks that drift apart",
    )
    cases["slow clock, recorder"] = (
        lambda x: timed(x, CHAMBERS, lambda t: 1.01 * t),
        "/cylinder_pressures",
        "drift by -0.99%",
    )
    return [pytest.param(*case, id=name) for name, case in cases.items()]


def test_twenty_samples_a_second_are_doubtful_and_no_more(machine: Machine, good: Log) -> None:
    """As the bus of an excavator sends them."""
    found = check(machine, thinned(good, ("position",), 10))
    assert any("too slow" in suspicion.cause for suspicion in found.suspicions)
    assert not found.decisive, [str(suspicion) for suspicion in found.decisive]


@pytest.mark.parametrize(("spoil", "where", "cause"), spoilt())
def test_what_was_spoilt_is_named(
    machine: Machine, good: Log, spoil: Callable[[Log], Log], where: str, cause: str
) -> None:
    found = check(machine, spoil(good))
    named = [
        suspicion
        for suspicion in found.decisive
        if where in suspicion.where and cause in str(suspicion)
    ]
    assert named, [str(suspicion) for suspicion in found.suspicions]


def test_what_makes_results_wrong_is_refused_unless_trusted(machine: Machine, good: Log) -> None:
    bad = replace(each(good, PRESSURES, lambda p: 1e-3 * p), source="bad")
    with pytest.raises(DataError, match="bad: .*look like kPa[^$]*--trust-recordings"):
        vetted(machine, [good, bad], trusted=False)
    trusted = vetted(machine, [good, bad], trusted=True)
    assert len(trusted) == 3 and all("look like kPa" in text for text in trusted)


def commanded_from(log: Log, begin: float) -> Log:
    """The first command comes later than the first position, as live."""
    command = log.command
    assert command is not None
    later = command.time >= command.time[0] + begin
    signal = Signal(command.time[later], command.value[later], command.origin)
    return replace(log, command=signal)


MILD = {
    "absolute chambers": (
        lambda x: each(x, PRESSURES, lambda p: p + 101_325.0),
        "pressures of all cylinders",
        "absolute",
    ),
    "absolute everywhere": (
        lambda x: each(x, CHAMBERS, lambda p: p + 101_325.0),
        "tank pressure",
        "absolute",
    ),
    "commands exchanged": (
        lambda x: each(x, ("command",), exchanged(INNER, OUTER)),
        "valve command of the outer boom",
        "exchanged names",
    ),
    "commands exchanged and late": (
        lambda x: commanded_from(each(x, ("command",), exchanged(INNER, OUTER)), 2.0),
        "valve command of the inner boom",
        "exchanged names",
    ),
    "command sign": (
        lambda x: each(x, ("command",), np.negative),
        "valve command of the telescope",
        "sign is reversed",
    ),
    "zero of an encoder": (
        lambda x: each(x, ("position",), column(OUTER, lambda q: q + 0.3)),
        "outer boom",
        "zero of the encoder",
    ),
    "sent late": (
        lambda x: replace(x, pressure_a=replace(x.pressure_a, received=x.pressure_a.time + 0.4)),
        "/cylinder_pressures",
        "0.400 s later",
    ),
    "sent at another rate": (
        lambda x: replace(
            x, **{n: replace(getattr(x, n), received=1.01 * x.position.time) for n in ALL}
        ),
        "/joint_states",
        "drift by +1.00%",
    ),
    "one joint late": (
        lambda x: each(x, PRESSURES, column(TELESCOPE, lambda p: np.roll(p, 20))),
        "telescope",
        "forces fit 0.10 s behind",
    ),
    "coarse encoder": (
        lambda x: each(x, ("position",), column(TELESCOPE, lambda q: np.round(q, 2))),
        "telescope",
        "steps of the encoder",
    ),
}
ALL = ("position", "pressure_a", "pressure_b", "command")


@pytest.mark.parametrize(("spoil", "where", "cause"), MILD.values(), ids=MILD)
def test_what_spoils_little_is_a_warning(
    machine: Machine, good: Log, spoil: Callable[[Log], Log], where: str, cause: str
) -> None:
    found = check(machine, spoil(good))
    named = [
        suspicion
        for suspicion in found.suspicions
        if where in suspicion.where and cause in str(suspicion)
    ]
    assert named and not found.decisive, [str(suspicion) for suspicion in found.suspicions]


@pytest.mark.parametrize(
    ("factor", "cause"), [(2.0, "2 times what is plausible"), (-1.0, "would lift the crane")]
)
def test_forces_of_a_table(machine: Machine, good: Log, factor: float, cause: str) -> None:
    (found,) = check(machine, with_forces(machine, good, factor)).decisive
    assert cause in found.cause


def test_sign_of_one_force_of_a_table(machine: Machine, good: Log) -> None:
    log = with_forces(machine, good)
    (found,) = check(machine, each(log, ("force",), column(OUTER, np.negative))).decisive
    assert found.where == "outer boom" and "sign of its force" in found.cause


def test_a_heavier_crane_than_the_machine_file_says_is_not_taken_for_a_mix_up(
    machine: Machine, good: Log
) -> None:
    lighter = {name: (low / 3.0, high / 3.0) for name, (low, high) in machine.plausible.items()}
    (found,) = check(machine.model_copy(update={"plausible": lighter}), good).decisive
    assert "3 times what is plausible" in found.cause
    anything = machine.model_copy(update={"plausible": {}})
    assert not check(anything, good).suspicions


def coarse(step: float) -> Callable[[Log], Log]:
    """Pressures in steps [Pa]."""
    return lambda log: each(log, PRESSURES, lambda p: np.round(p / step) * step)


@pytest.mark.parametrize("step", [0.1e6, 0.25e6, 0.5e6])
def test_coarse_transducers_are_called_coarse(machine: Machine, good: Log, step: float) -> None:
    found = check(machine, coarse(step)(good))
    assert found.verdict is RecordingVerdict.DOUBTFUL and not found.unchecked
    (suspicion,) = found.suspicions
    assert suspicion.cause.startswith("coarse") and f"{step / 1e6:g} MPa" in suspicion.evidence


def test_a_quiet_chamber_has_no_coarse_transducer(machine: Machine, good: Log) -> None:
    """12 bits over 25 MPa, as all others, of which it uses some hundred steps."""

    def quiet(p: np.ndarray) -> np.ndarray:
        return p.mean() + 0.6e6 * (p - p.mean()) / np.ptp(p)

    log = coarse(25e6 / 2**12)(each(good, ("pressure_b",), column(TELESCOPE, quiet)))
    assert not [found for found in check(machine, log).suspicions if "coarse" in found.cause]


@pytest.mark.parametrize("j", [INNER, OUTER, TELESCOPE])
def test_a_coarse_transducer_may_be_stuck_as_well(machine: Machine, good: Log, j: int) -> None:
    log = each(coarse(0.1e6)(good), ("pressure_a",), column(j, stuck))
    assert any(
        JOINTS[j] in suspicion.where and "stuck" in suspicion.cause
        for suspicion in check(machine, log).decisive
    )


def lost(log: Log, begin: float, end: float, names: tuple[str, ...]) -> Log:
    """Nothing of some signals from `begin` to `end` [s]."""

    def outside(signal: Signal) -> Signal:
        return signal.take(np.flatnonzero((signal.time < begin) | (signal.time > end)))

    return replace(log, **{n: outside(s) for n in names if (s := getattr(log, n))})


@pytest.mark.parametrize("names", [("position",), CHAMBERS])
def test_a_gap_is_doubtful_and_has_a_place(
    machine: Machine, good: Log, names: tuple[str, ...]
) -> None:
    found = check(machine, lost(good, 7.001, 9.5, names))
    assert found.verdict is RecordingVerdict.DOUBTFUL
    (gap,) = (suspicion for suspicion in found.suspicions if "missing" in suspicion.cause)
    assert gap.where == getattr(good, names[0]).origin
    assert gap.evidence.startswith("nothing for 2.5") and gap.evidence.endswith("from 7 s on")


def test_recordings_without_a_common_time_are_wrong(machine: Machine, good: Log) -> None:
    apart = lost(lost(good, 10.0, np.inf, CHAMBERS), 0.0, 10.0, ("position",))
    assert any(
        "never recorded together" in suspicion.cause for suspicion in check(machine, apart).decisive
    )
    late = lost(good, 0.0, 8.0, CHAMBERS)
    assert any("only a part" in suspicion.cause for suspicion in check(machine, late).suspicions)


def test_too_few_samples_are_wrong(machine: Machine, good: Log) -> None:
    assert check(machine, lost(good, 0.05, np.inf, CHAMBERS)).verdict is RecordingVerdict.WRONG


def test_an_effort_of_zeros_is_none(machine: Machine, good: Log) -> None:
    log = each(with_forces(machine, good), ("force",), column(OUTER, np.zeros_like))
    (found,) = check(machine, log).decisive
    assert found.where.startswith("outer boom") and "all readings are zero" in found.cause


def test_an_encoder_that_is_frozen_from_the_first_sample(machine: Machine, good: Log) -> None:
    frozen = each(good, ("position",), column(OUTER, lambda q: np.full_like(q, q[0])))
    (found,) = check(machine, frozen).decisive
    assert found.where == "outer boom" and "valve command" in found.evidence
    silent = check(machine, replace(frozen, command=None))
    assert silent.verdict is RecordingVerdict.DOUBTFUL
    assert any("stood still, or" in suspicion.cause for suspicion in silent.suspicions)


def test_time_that_went_back_is_wrong_from_a_share_on(machine: Machine, good: Log) -> None:
    for behind, verdict in ((10, RecordingVerdict.DOUBTFUL), (300, RecordingVerdict.WRONG)):
        back = SetBack(5, largest=10**7, interval=5 * 10**6, behind=behind, total=4000, logged=True)
        log = replace(good, position=replace(good.position, set_back=back))
        found = check(machine, log)
        assert found.verdict is verdict
        assert "goes back 5 times, by up to 0.01 s" in found.suspicions[0].evidence


def test_stamps_that_are_unusable_are_told(machine: Machine, good: Log) -> None:
    found = check(machine, replace(good, unstamped=("/joint_states",)))
    assert found.verdict is RecordingVerdict.DOUBTFUL and "no usable stamp" in found.unchecked[0]


def test_what_cannot_be_checked_is_said_and_not_refused(machine: Machine, good: Log) -> None:
    """No machine, sensors in counts, fewer joints, a crane that stands: other checks remain."""
    assert check(None, good).unchecked and not check(None, good).suspicions
    counts = replace(
        each(good, PRESSURES, lambda p: np.round(p / 6105.0)), uncalibrated=("pressure_a (P1)",)
    )
    found = check(machine, counts)
    assert not found.suspicions and "counts" in found.unchecked[0]
    standing = each(
        replace(good, command=None), ("position",), lambda q: np.broadcast_to(q[0], q.shape).copy()
    )
    found = check(machine, standing)
    assert not found.decisive and "motion needed" in found.unchecked[0]
    clipped_counts = each(counts, ("pressure_b",), column(OUTER, clipped))
    (suspicion,) = check(machine, clipped_counts).suspicions
    assert suspicion.where == f"{spoken(good.joints[OUTER])}, chamber B"


def test_a_single_boom_is_checked_for_what_it_has(machine: Machine, good: Log) -> None:
    signals = {
        name: replace(signal, value=signal.value[:, [OUTER]])
        for name in ALL
        if (signal := getattr(good, name)) is not None
    }
    alone = replace(good, joints=("outer_boom",), **signals)
    found = check(machine, alone)
    assert not found.suspicions and "the model lacks" in found.unchecked[0]
    (suspicion,) = check(machine, each(alone, ("position",), np.degrees)).decisive
    assert "degrees" in suspicion.cause
