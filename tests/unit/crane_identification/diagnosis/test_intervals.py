"""Intervals of named parameters, on axes whose effects are not quite of the catalogue's form.

Each axis has an effect of a known size, and a force besides that depends on position and velocity
by a form of its own, up to a fifth of the effect.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from unit.crane_identification.diagnosis.test_axis import FULL, model
from unit.crane_identification.synthetic import axis_log

from crane_identification import Log, Options, Signal
from crane_identification.diagnosis import words
from crane_identification.diagnosis.constants import FORM_ERROR
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.diagnosis.findings import Verdict
from crane_identification.thresholds import load_thresholds

CASES = 12
SIGMAS = 2.0
KINDS = ("hose_stiffness", "coulomb", "viscous_quadratic")
SHARES = (0.0, 0.05, 0.1, 0.2)  # rms of the other form over that of the effect


def recordings(folder: Path, case: int, size: float) -> list[Log]:
    kind, share = KINDS[case % len(KINDS)], SHARES[case % len(SHARES)]
    rng = np.random.default_rng(1000 + case)
    waves, phase = rng.normal(size=(2, 6)) * [[6.0], [8.0]], rng.uniform(0.0, 2.0 * np.pi, 6)
    weights, out, scale = rng.normal(size=6), [], 0.0
    for seed in range(5):
        plain = axis_log(100 * case + seed, model(folder, *FULL), periods=2)
        assert plain.force is not None
        q = plain.position.value[:, 0]
        v = np.gradient(q, plain.position.time)
        effect = {
            "hose_stiffness": size * q,
            "coulomb": 8.0 * np.sign(v),
            "viscous_quadratic": size * v * np.abs(v),
        }[kind]
        other = np.sin(np.multiply.outer(q, waves[0]) + np.multiply.outer(v, waves[1]) + phase)
        other = other @ weights
        scale = scale or share * float(effect.std() / np.sqrt((other**2).mean()))
        added = scale * other + (0.0 if kind == "coulomb" else effect)  # which the axis has
        force = Signal(plain.force.time, plain.force.value + added[:, np.newaxis], "f")
        out.append(replace(plain, force=force))
    return out


def test_intervals_of_named_parameters_hold_the_true_values(tmp_path: Path) -> None:
    inside = []
    for case in range(CASES):
        kind = KINDS[case % len(KINDS)]
        size = 8.0 if kind == "coulomb" else float(np.random.default_rng(case).uniform(8.0, 60.0))
        made = recordings(tmp_path, case, size)
        lacking = model(tmp_path, *(one for one in FULL if one != kind))
        found = diagnose(lacking, made[:-1], made[-1:], Options(), load_thresholds())
        for one in found.findings:
            if one.candidate.type == kind and not one.candidate.drawn:
                value = one.parameters[0]
                inside.append(abs(value.value - size) <= SIGMAS * value.std_dev)
    assert len(inside) >= 0.7 * CASES
    assert np.mean(inside) >= 0.9


def smooth_form(rng: np.random.Generator, family: str, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A force (n,) that depends on position and velocity, both of rms one."""
    if family == "waves":
        weights, shift = rng.normal(size=(2, 6, 2)), rng.uniform(0.0, 2.0 * np.pi, 6)
        waves = np.sin(np.stack([q, v], axis=1) @ weights[0].T + shift)
        return waves @ weights[1, :, 0]
    if family == "polynomial":
        powers = [(i, j) for i in range(4) for j in range(4) if i + j]
        return np.sum([rng.normal() / (1 + i + j) * q**i * v**j for i, j in powers], axis=0)
    if family == "local":
        places = rng.normal(size=(4, 3))
        hills = [a * np.exp(-((q - b) ** 2 + (v - c) ** 2) / 0.8) for a, b, c in places]
        return np.sum(hills, axis=0)
    fading = np.exp(-np.abs(v) / rng.uniform(0.2, 1.5))
    return np.sign(v) * (rng.normal() * fading + 0.5 * rng.normal() * q)


def test_the_error_of_a_form_is_as_large_as_regressions_show() -> None:
    """Forms that were not used to choose it, beside acceleration, velocity, and friction."""
    rng, inside = np.random.default_rng(13), []
    for case in range(400):
        time = np.linspace(0.0, 240.0, 600)
        rates = 2.0 * np.pi * rng.integers(4, 100, 6) / 240.0
        sines = np.exp(1j * np.multiply.outer(time, rates)) * rng.normal(size=6) / rates
        q, v, a = (
            one / one.std() for one in ((sines * (1j * rates) ** k).sum(1).real for k in range(3))
        )
        effect = (q, v * np.abs(v))[case % 2]
        effect = effect / effect.std()
        other = smooth_form(rng, ("waves", "polynomial", "local", "friction")[case % 4], q, v)
        noise = (0.02, 0.1)[case // 4 % 2]
        force = effect + SHARES[case // 8 % 4] * other / np.sqrt((other**2).mean())
        force = force + noise * rng.standard_normal(len(time))
        model = np.stack([a, v, np.ones_like(v), np.sign(v)], axis=1)
        columns = np.column_stack([model, effect])
        values, (energy,), *_ = np.linalg.lstsq(columns, force)
        known = np.linalg.qr(model)[0]
        seen = np.linalg.norm(effect - known @ (known.T @ effect)) / np.sqrt(len(time))
        beyond = np.sqrt(max(energy / len(time) - noise**2, 0.0))
        std_dev = np.hypot(noise / seen / np.sqrt(len(time)), FORM_ERROR * beyond / seen)
        inside.append(abs(values[-1] - 1.0) <= SIGMAS * std_dev)
    assert 0.9 <= np.mean(inside) <= 0.98


def test_a_residual_of_the_form_of_the_named_effect_is_not_another_effect(tmp_path: Path) -> None:
    """The axis rubs by Coulomb's law, and is named by Stribeck's: the rest is a curve of it."""
    made = recordings(tmp_path, 4, 8.0)
    lacking = model(tmp_path, *(one for one in FULL if one != "coulomb"))
    found = diagnose(lacking, made[:-1], made[-1:], Options(), load_thresholds())
    assert found.verdict is Verdict.NAMED
    (entry,) = found.results().findings
    assert entry.effect == "stribeck" and entry.deviation
    assert "the form of Stribeck friction (axis) differs" in found.reason
    text = "\n".join(words.lines(found.results().plain()))
    assert "its form lacks a curve over the velocity" in text
