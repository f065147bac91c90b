"""Terms of other packages by their entry points, and what a term says of its own physics."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_model.test_architecture import FOLDERS
from unit.crane_model.test_own_terms import CODE

from crane_model import Model, load_machine
from crane_model.terms import REGISTRY, Setting, Term
from crane_model.terms.friction import Coulomb, ViscousAsymmetry
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.presliding import Stiction
from crane_model.terms.rigid_body import PlanarRigidBody
from crane_model.terms.term import load_installed


@pytest.fixture(autouse=True)
def as_it_was() -> Iterator[None]:
    registered = dict(REGISTRY)
    yield
    REGISTRY.clear()
    REGISTRY.update(registered)


def install(folder: Path, module: str, code: str, entry: str = "") -> None:
    """A distribution as pip leaves it: a module, its metadata, its entry points."""
    (folder / f"{module}.py").write_text(code, encoding="utf-8")
    metadata = folder / f"{module}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        f"[crane_model.terms]\n{module} = {entry or module}\n"
    )


def test_an_installed_term_is_in_the_registry_of_every_process(tmp_path: Path) -> None:
    install(tmp_path, "springs", CODE, "springs:Cubic")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    code = "from crane_model.terms import REGISTRY as r; print(r['cubic_spring'].__module__)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout.strip(), done.stderr) == ("springs", "")


def test_an_entry_point_may_name_a_module_of_several(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = CODE[CODE.index("class Cubic") :].replace("Cubic", "Fifth").replace("cubic", "fifth")
    install(tmp_path, "two_springs", CODE + second)
    monkeypatch.syspath_prepend(tmp_path)
    found = load_installed()
    assert [cls.__name__ for cls in found] == ["Cubic", "Fifth"]
    assert REGISTRY["fifth_spring"] is found[1]


@pytest.mark.parametrize(
    ("module", "code", "reason"),
    [
        ("gone", "import nowhere_to_be_found", "ModuleNotFoundError: No module named 'nowhere"),
        ("same", CODE.replace("cubic_spring", "viscous"), "a term of type 'viscous' already"),
        ("half", f"{CODE}\nraise RuntimeError('no')", "RuntimeError: no"),
    ],
)
def test_a_package_that_fails_is_left_out_and_named(
    module: str, code: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = dict(REGISTRY)
    install(tmp_path, module, code)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.warns(UserWarning, match=f"^{module}: entry point '{module}' of .*{reason}"):
        assert load_installed() == ()
    assert before == REGISTRY


def test_a_term_says_what_it_is() -> None:
    """Not one question of these needs its class."""
    bodies, coulomb = PlanarRigidBody(), Coulomb(joint="telescope")
    half = ViscousAsymmetry(joint="telescope")
    memory = Stiction(joint="telescope", travel=1e-3, dwell=1.0)
    terms = bodies, coulomb, half, memory, Payload()
    assert [one.has_base_parameters for one in terms] == [True, False, False, False, False]
    assert [one.only_joint for one in terms] == [None, *["telescope"] * 3, None]
    assert [one.asymmetry_of for one in terms] == [None, None, "viscous", None, None]
    assert [one.of_one_instant for one in terms] == [True, True, True, False, False]
    assert [one.has_inertia() for one in terms] == [True, False, False, False, False]
    assert [one.has_weight() for one in terms] == [True, False, False, False, True]
    assert [one.is_friction() for one in terms] == [False, True, True, True, False]
    units = {joint: "m" if joint == "telescope" else "rad" for joint in PLANAR_JOINTS}
    setting = Setting(units, load_machine())
    assert Model("m", setting, (coulomb, bodies)).base_parameters == slice(1, 9)
    assert Model("m", setting, (coulomb, half)).base_parameters is None


def test_nobody_asks_for_the_class_of_a_term() -> None:
    """Whoever needs to know what a term is asks the term, so that one of another package counts."""
    classes = {cls for term in REGISTRY.values() for cls in term.__mro__ if issubclass(cls, Term)}
    names = "|".join(sorted(cls.__name__ for cls in classes))
    asked = re.compile(rf"(isinstance|issubclass)\([^()]+, ({names})\b|\bcase ({names})\(")
    compared = re.compile(r"\b(family|type) (==|!=|in|not in) ([\"']|\([\"'])")
    home = FOLDERS["crane_model"] / "terms" / "term.py"  # where a family has its meaning
    found = [
        f"{path.name}: {line.strip()}"
        for folder in FOLDERS.values()
        for path in folder.rglob("*.py")
        if path != home
        for line in path.read_text(encoding="utf-8").splitlines()
        if asked.search(line) or compared.search(line)
    ]
    assert not found
