"""A report of a real fit to recordings of a synthetic crane."""

import pytest
from unit.crane_identification.report.synthetic_crane import TRUE_VALUES, crane_model, record_crane

from crane_identification import FitResult, Log, Options, fit
from crane_identification.preparation.prepare import prepare
from crane_identification.report.content import IdentificationReport, Provenance
from crane_identification.report.findings import findings
from crane_identification.validation.force_validation import compare


@pytest.fixture(scope="session")
def training() -> tuple[Log, ...]:
    return tuple(record_crane(f"train_{seed}", seed) for seed in range(2))


@pytest.fixture(scope="session")
def fitted(training: tuple[Log, ...]) -> FitResult:
    return fit(crane_model(), training)


@pytest.fixture(scope="session")
def report(training: tuple[Log, ...], fitted: FitResult) -> IdentificationReport:
    held_out = [record_crane(f"validate_{seed}", seed, period=10.0) for seed in (10, 11)]
    data = tuple(p for log in held_out for p in prepare(fitted.model, log, Options()))
    validations = tuple(compare(fitted.model, p, fitted.decimation) for p in data)
    return IdentificationReport(
        fit=fitted,
        options=Options(),
        training=training,
        validations=validations,
        warnings=findings(fitted, [*training, *held_out], validations),
        provenance=Provenance.of("2012-06-01", ["identify", "--out", "a b"], "crane.yaml"),
        true_values=TRUE_VALUES,
    )
