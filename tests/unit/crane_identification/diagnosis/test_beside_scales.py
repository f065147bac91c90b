"""Effects beside scales of the forces of several joints, on columns made up for the purpose."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import ROWS, normal, searched
from unit.crane_identification.diagnosis.test_several import asked, named

from crane_identification.diagnosis import signatures
from crane_identification.diagnosis.search import ForceSignature
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.thresholds import load_thresholds

THRESHOLDS = load_thresholds()
A, B, C = np.linalg.qr(normal(1, ROWS, 3))[0].T * np.sqrt(ROWS)
FORCE = 100.0  # that is scaled, where what is missing is some
SCALES = {
    ("linkage_scale", "a"): FORCE * A,
    ("linkage_scale", "b"): FORCE * B,
    ("pressure_gain", "c"): FORCE * (A + B) / np.sqrt(2.0),  # of three joints' scales, two are free
}
STIFFNESS = {("hose_stiffness", "d"): C}


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_an_effect_is_found_beside_scales_of_two_joints(size: float) -> None:
    """Which scale is the second one is not told, which must not hide what is there besides."""
    found = named(asked({**SCALES, **STIFFNESS}, 10.0 * A + 2.0 * B + size * C))
    assert ("hose stiffness (d)" in found) == (size > 0.0)
    assert len(found) == (3 if size else 2)


@pytest.mark.parametrize(("correlation", "taken"), [(0.9, True), (0.5, False)])
def test_a_law_of_a_better_signature_has_to_hold(
    monkeypatch: pytest.MonkeyPatch, correlation: float, taken: bool
) -> None:
    """It explains at least half of what the effect does in whose place it comes."""
    like = correlation * A + np.sqrt(1.0 - correlation**2) * B
    made = searched({"hose_stiffness": A, "position_friction": like}, 2.0 * A)
    better = SimpleNamespace(types=("position_friction",), said="")
    monkeypatch.setattr(signatures, "_rival", lambda *_: cast(ForceSignature, better))
    selection = ForwardSelection(made)
    subset, strange = signatures.of_better_signature(selection.search, selection.sets(1)[0])
    (number,) = subset.numbers
    kind = selection.search.projection.candidates[number].candidate.type
    assert kind == ("position_friction" if taken else "hose_stiffness")
    assert not strange


def test_a_scale_that_is_not_sure_hides_no_effect() -> None:
    """It explains most of what is left, but predicts nothing: it is no finding, and no obstacle."""
    unsteady = np.repeat([2.0, -1.0], ROWS // 2) * B
    found = named(asked({**SCALES, **STIFFNESS}, 10.0 * A + unsteady + 0.4 * C))
    assert "hose stiffness (d)" in found
    assert len(found) == 2
