"""A real robot with six axes, identified by a machine file and a column map, with no line of code.

KUKA KR300 R2500, three recordings A, B, C of 10 s by J. Weigand (MIT). The figures to compare with
are those of an independent fit with Pinocchio, both sides through a low-pass of 10 Hz.
"""

from pathlib import Path

import numpy as np
import pytest

from crane_identification import ColumnMap, Estimator, FitResult, Log, Options, fit, validate
from crane_identification.data.bad_samples import usable
from crane_identification.data.table_log import read_table
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.estimation.prior import Measure, load_prior
from crane_identification.report.findings import findings
from crane_identification.signals.routes import ButterworthDifferentiator
from crane_identification.thresholds import load_thresholds
from crane_model import DataError, Model, load_model
from crane_model.configuration import load

HERE = Path(__file__).parents[2] / "machines"
USABLE = 1.8, 8.2  # s of each recording
OPTIONS = Options(average=False)
LEAST_SQUARES = Options(average=False, estimator=Estimator.LEAST_SQUARES)
AT_10_HZ = Options(
    average=False, motion=ButterworthDifferentiator(10.0), trim=(30, 30), decimation=10
)
INDEPENDENT = np.array([4.9, 3.2, 2.4, 19.8, 3.8, 8.3])  # % of the axes, fitted on A and B


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(HERE / "kuka_kr300_model.yaml")


@pytest.fixture(scope="module")
def logs(real_data: Path, model: Model) -> dict[str, Log]:
    columns = load(HERE / "kuka_kr300_columns.yaml", ColumnMap)
    tables = {name: real_data / "kuka_kr300" / f"kuka_{name}.parquet" for name in "ABC"}
    return {
        name: usable(read_table(path, columns, model.joints), *USABLE)
        for name, path in tables.items()
    }


def errors_on_c(result: FitResult, logs: dict[str, Log]) -> tuple[float, np.ndarray]:
    """Of all axes together, and of each, in percent of the torque at 10 Hz."""
    (validation,) = validate(result.model, [logs["C"]], AT_10_HZ)
    left = np.linalg.norm(validation.measured - validation.predicted)
    return 100.0 * left / np.linalg.norm(validation.measured), 100.0 * validation.relative_error


def test_two_recordings_foretell_the_third(model: Model, logs: dict[str, Log]) -> None:
    result = fit(model, [logs["A"], logs["B"]], OPTIONS)
    assert len(result.estimate.names) == 58
    together, axes = errors_on_c(result, logs)
    assert together < 3.1
    assert (axes < INDEPENDENT + 0.2).all()
    told = findings(result, list(logs.values()))
    assert not [warning for warning in told if "do not determine" in warning]


@pytest.fixture(scope="module")
def alone(model: Model, logs: dict[str, Log]) -> FitResult:
    return fit(model, [logs["A"]], LEAST_SQUARES)


def test_one_alone_does_not_determine_the_robot(alone: FitResult, logs: dict[str, Log]) -> None:
    together, axes = errors_on_c(alone, logs)
    assert together > 8.0
    assert axes[0] > 15.0
    assert (alone.estimate.relative_error < 0.05).all(), "though the fit looks good"
    (told,) = [
        finding for finding in findings(alone, list(logs.values())) if "do not determine" in finding
    ]
    assert "their motion spans 4 of 6 dimensions" in told
    assert "--prior" in told


def test_bodies_that_can_exist_make_up_for_most_of_it(model: Model, logs: dict[str, Log]) -> None:
    result = fit(model, [logs["A"]], OPTIONS)
    assert result.estimate.bounds
    assert errors_on_c(result, logs)[0] < 5.0


def test_bodies_that_can_exist_cost_nothing_elsewhere(model: Model, logs: dict[str, Log]) -> None:
    """Two recordings predict the third, in turn, by both estimators."""
    left = np.zeros(2)
    for name in logs:
        train = [log for name_of_log, log in logs.items() if name_of_log != name]
        for k, options in enumerate((OPTIONS, LEAST_SQUARES)):
            result = fit(model, train, options)
            (validation,) = validate(result.model, [logs[name]], AT_10_HZ)
            left[k] += np.linalg.norm(validation.measured - validation.predicted) / np.linalg.norm(
                validation.measured
            )
    assert left[0] < 1.05 * left[1]


@pytest.mark.parametrize("measure", Measure)
def test_a_prior_makes_up_for_it(logs: dict[str, Log], tmp_path: Path, measure: Measure) -> None:
    """Even one that is guessed."""
    model = load_model(HERE / "kuka_kr300_with_prior.yaml")
    path = tmp_path / "prior.yaml"
    path.write_text(f"{(HERE / 'kuka_kr300_prior.yaml').read_text()}\nmeasure: {measure}\n")
    prior = load_prior(path, model)
    result = fit(model, [logs["A"]], OPTIONS, prior=prior)
    assert errors_on_c(result, logs)[0] < 3.6
    (validation,) = validate(result.model, [logs["C"]], OPTIONS)  # at the cut-off of the fit itself
    assert np.linalg.norm(validation.measured - validation.predicted) < 0.035 * np.linalg.norm(
        validation.measured
    )
    assert not [
        finding for finding in findings(result, [logs["A"]]) if "do not determine" in finding
    ]


def test_the_counterbalance_is_not_told_from_weight(logs: dict[str, Log]) -> None:
    """Its column is nearly one of gravity's: the estimate says that it is not known."""
    model = load_model(HERE / "kuka_kr300_with_prior.yaml")
    rotors = [term for term in model.terms if term.type == "rotor_inertia"]
    for rotor in rotors:
        if rotor.only_joint in ("axis_1", "axis_2"):
            model = model.without_term(rotor)
    with pytest.raises(DataError, match=r"gas_spring.axis_2: these recordings show only combin"):
        fit(model, [logs["A"], logs["B"]], LEAST_SQUARES)


def lacking(model: Model, *types: str) -> Model:
    """The model without terms of these types."""
    for term in model.terms:
        if term.type in types:
            model = model.without_term(term)
    return model


def test_friction_left_out_of_the_model_is_named_on_every_axis(
    model: Model, logs: dict[str, Log]
) -> None:
    """Twelve effects at once, and no other in their place."""
    bare = lacking(model, "coulomb", "viscous")
    found = diagnose(bare, [logs["A"], logs["B"]], [logs["C"]], OPTIONS, load_thresholds())
    assert not found.fit.undetermined
    assert not found.fit.periods
    named = [finding.judged.shaped.candidate for finding in found.findings]
    assert {(candidate.type, candidate.joint) for candidate in named} == {
        (kind, axis) for kind in ("coulomb", "viscous") for axis in model.joints
    }
    assert not any(finding.judged.indistinct for finding in found.findings)
