"""Small faults of valves and pistons, made by the simulated crane, told from the encoder's."""

import pytest
from unit.crane_observer.monitor.at_work import Heard

from crane_benchmark.observing.machines import stock
from crane_model import Model
from crane_observer import Part, Wrong
from crane_observer.monitor.tolerance import Tolerance

SECONDS, SEED, ONSET = 20.0, 3, 6.0


@pytest.mark.parametrize(
    ("fault", "joint", "kind"),
    [
        ("outer_boom.valve.leaking=7e-14", "outer_boom", Wrong.LEAKING),
        ("outer_boom.valve.leaking=1e-13", "outer_boom", Wrong.LEAKING),
        ("telescope.valve.leaking=1e-13", "telescope", Wrong.LEAKING),
        ("outer_boom.valve.slow=0.04", "outer_boom", Wrong.SLOW),
    ],
)
def test_a_small_leak_or_lag_is_no_encoder(
    model: Model, tolerance: Tolerance, fault: str, joint: str, kind: Wrong
) -> None:
    observed = stock()
    made, _ = observed.at_work(SECONDS, SEED, failing=[f"{fault}@{ONSET}"])
    columns = [observed.machine.index(joint) for joint in model.joints]
    shown = made.pressures
    heard = Heard(
        made.time, made.position[:, columns], shown.chamber_a, shown.chamber_b, shown.supply,
        made.command[:, columns],
    )  # fmt: skip
    watched = heard.to(model, tolerance)
    assert watched.monitor.findings, "nothing was found"
    first = watched.monitor.findings[0]
    assert (first.part, first.joint, first.kind) == (Part.VALVE, joint, kind)
