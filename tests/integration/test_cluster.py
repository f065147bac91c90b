"""`identify --cluster` on a real scheduler with two workers gives what one machine gives."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from distributed import LocalCluster

from crane_identification import ColumnMap, Estimator, Options, fit, identify, read_bag
from crane_identification.scale.cluster import fit_on_cluster
from crane_model import ConfigurationError, DataError, load_model
from crane_model.machine_files import machine_file
from crane_sim import make_bag

MODEL = machine_file("model.yaml")
OPTIONS = Options(estimator=Estimator.LEAST_SQUARES)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("bags")
    files = ("excitation_20s.yaml", "validation_20s.yaml")
    for seed, name in enumerate(files):
        trajectory = str(machine_file(name))
        out = str(folder / str(seed))
        assert not make_bag.main(
            ["--trajectory", trajectory, "--periods", "2", "--seed", str(seed), "--out", out]
        )
    return [folder / str(seed) for seed in range(len(files))]


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


def test_same_estimate_as_on_one_machine(bags: list[Path], address: str, measured) -> None:
    model = load_model(MODEL)
    shares: dict[str, list[float]] = {}
    found = fit_on_cluster(
        model, bags, address, OPTIONS, lambda phase, done: shares.setdefault(phase, []).append(done)
    )
    expected = fit(model, [read_bag(bag, model.joints) for bag in bags], OPTIONS)
    difference = np.abs(found.model.theta / expected.estimate.values - 1.0).max()
    measured(
        "fit on two Dask workers against one machine",
        "the same to 1e-9",
        "{difference:.0e}",
        difference=difference,
    )
    assert difference < 1e-9
    assert found.information.rows.sum() == expected.estimate.samples
    assert found.model.std_devs is not None
    ratio = found.model.std_devs / expected.estimate.std_devs
    assert (ratio > 0.4).all()
    assert (ratio < 2.5).all()
    assert all(parts[-1] == 1.0 for parts in shares.values())


def test_command(bags: list[Path], address: str, tmp_path: Path) -> None:
    common = ["--model", str(MODEL), "--train", str(bags[0]), "--validate", str(bags[1])]
    least_squares = [*common, "--estimator", "least_squares"]
    assert not identify.main([*least_squares, "--out", str(tmp_path / "local")])
    cluster = ["--cluster", address, "--out", str(tmp_path / "cluster")]
    assert not identify.main([*least_squares, *cluster])
    local, far = (load_model(tmp_path / name / "model.yaml") for name in ("local", "cluster"))
    np.testing.assert_allclose(far.theta, local.theta, rtol=1e-9)
    read = {
        name: json.loads((tmp_path / name / "summary.json").read_text())
        for name in ("local", "cluster")
    }
    for joint, error in read["local"]["heldout_relative_error"].items():
        assert read["cluster"]["heldout_relative_error"][joint] == pytest.approx(error, rel=1e-6)


def test_what_is_wrong_is_named(bags: list[Path], address: str, tmp_path: Path) -> None:
    model = load_model(MODEL)
    with pytest.raises(DataError, match="no such bag"):
        fit_on_cluster(model, [*bags, tmp_path / "nowhere"], address, OPTIONS)
    effort = {"topic": "/efforts", "field": "effort", "unit": "N m"}
    joints = {
        joint: {"position": effort | {"unit": unit}, "force": effort | {"unit": force}}
        for joint, unit, force in (
            ("inner_boom", "rad", "N m"), ("outer_boom", "rad", "N m"), ("telescope", "m", "N")
        )
    }  # fmt: skip
    columns = ColumnMap.model_validate({"joints": joints})
    with pytest.raises(DataError, match="no message of topic /efforts; the bag holds /cylinder"):
        fit_on_cluster(model, bags, address, OPTIONS, columns=columns)
    with (
        LocalCluster(
            n_workers=0, processes=True, host="127.0.0.1", dashboard_address=None
        ) as empty,
        pytest.raises(ConfigurationError, match="no workers"),
    ):
        fit_on_cluster(model, bags, empty.scheduler_address, OPTIONS)
