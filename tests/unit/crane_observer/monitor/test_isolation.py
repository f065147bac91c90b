"""An encoder that may lie is always told as a danger, also where little is known of it as yet."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_observer.monitor.at_work import ONSET, Heard, changed

from crane_model import Model
from crane_observer import Part, SensorFinding, SensorWatch, Wrong
from crane_observer.monitor.finding import SUPPLY, RivalEncoder
from crane_observer.monitor.isolation import CLEARLY, DOUBTED, EXPLAINS, Suspect, encoder_behind
from crane_observer.monitor.monitor import SensorComparison
from crane_observer.monitor.tolerance import Tolerance
from crane_observer.node.observer_node import findings_message

ENCODER = Suspect(Part.ENCODER, "boom", Wrong.DRIFT, 0.0, 3.0, 2.0, 0.1, "m/s", 0.01)
SWAPPED = Suspect(Part.PRESSURES, "boom", Wrong.SWAPPED, 0.0, 3.0, 1.0, 0.0, "", 0.0)


@pytest.mark.parametrize(
    ("swapped", "encoder", "rival"),
    [
        (2.0, 1.9, True),  # what is plainer is named, though an encoder explains more
        (2.0, 0.99 * CLEARLY * 2.0, True),
        (2.0, 1.01 * CLEARLY * 2.0, False),
        (0.0, 0.99 * CLEARLY * EXPLAINS, True),  # noise tells nothing apart
        (0.0, 1.01 * CLEARLY * EXPLAINS, False),
    ],
)
def test_an_encoder_is_excluded_only_where_it_is_clearly_worse(
    swapped: float, encoder: float, rival: bool
) -> None:
    suspects = [SWAPPED._replace(misfit=swapped), ENCODER._replace(misfit=encoder)]
    assert (encoder_behind(suspects) is not None) is rival


def test_an_encoder_whose_fault_may_be_none_is_no_rival() -> None:
    suspects = [SWAPPED, ENCODER._replace(deviation=2.0)]
    assert encoder_behind(suspects) is None


def test_a_rival_is_told_with_its_joint() -> None:
    named = SensorFinding(
        Part.SUPPLY, SUPPLY, Wrong.OFFSET, "Pa", 1e5, 0.9e5, 1.1e5, 3.0, 4.0,
    )  # fmt: skip
    assert not named.dangerous
    assert list(findings_message([named], 0).joint) == [""]
    doubted = named._replace(rival=RivalEncoder("boom", Wrong.DRIFT))
    assert doubted.dangerous
    assert list(findings_message([doubted], 0).joint) == ["boom"]
    assert doubted.what_to_do.startswith("stop: the boom encoder (drift) would explain it too")
    assert "if it is right, depressurise" in doubted.what_to_do


@pytest.mark.parametrize(
    ("error", "left", "counts"),
    [
        (1.01 * DOUBTED, (Part.PRESSURE_A, "inner_boom"), True),
        (0.99 * DOUBTED, (Part.PRESSURE_A, "inner_boom"), False),  # chamber B is left
        (0.99 * DOUBTED, (Part.VALVE, "inner_boom"), True),
        (0.99 * DOUBTED, (Part.VALVE, "outer_boom"), False),
    ],
)
def test_a_rival_counts_once_it_would_be_off_by_much_or_is_compared_no_more(
    model: Model, error: float, left: tuple[Part, str], counts: bool
) -> None:
    monitor = SensorWatch(model).monitor
    assert isinstance(monitor, SensorComparison)
    encoder = ENCODER._replace(joint="inner_boom", misfit=1.0, error=error)
    monitor._leave(*left)
    rival = monitor._rival([SWAPPED._replace(joint="inner_boom", misfit=1.0), encoder])
    assert rival == (RivalEncoder("inner_boom", Wrong.DRIFT) if counts else None)


@pytest.mark.parametrize("lateness", [0.0, 0.004])
@pytest.mark.parametrize("onset", np.arange(10.0, 19.0, 1.3))
def test_an_encoder_that_drifts_is_a_danger_whatever_is_named(
    model: Model, healthy: Heard, onset: float, lateness: float
) -> None:
    """On a computer that is busy, too, where commands are late by a random time."""
    shift = (healthy.time - onset).clip(0.0)
    q = healthy.q + np.outer(0.05 * shift, (1.0, 0.0, 0.0))
    rows = np.arange(len(q)) - np.random.default_rng(3).integers(0, 2, len(q)) * (lateness > 0.0)
    lying = replace(healthy, q=q, command=healthy.command[rows.clip(0)])
    findings = lying.to(model, None).monitor.findings
    assert findings, "nothing was found"
    assert findings[0].dangerous
    message = findings_message(findings[:1], 0)
    assert list(message.joint) == ["inner_boom"]


@pytest.mark.parametrize("scale", [0.95, 1.03, 1.06])
def test_an_encoder_is_a_danger_while_but_one_chamber_is_known(
    model: Model, healthy: Heard, tolerance: Tolerance, scale: float
) -> None:
    """Nothing tells it from the transducer of that chamber then, nor sees how its error grows."""
    emptied = 2e5 + 1e4 * np.random.default_rng(5).standard_normal(len(healthy.time))
    blind = changed("p_a", lambda x, t: emptied[: len(x)])(healthy, 0)
    lying = changed("q", lambda x, t: x[0] + scale * (x - x[0]))(blind, 0)
    first = lying.to(model, tolerance).monitor.findings[0]
    assert first.found < ONSET + 1.0
    assert first.dangerous
