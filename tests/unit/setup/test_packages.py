"""Licence, names and pins: what every package and requirement file states."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
MANIFESTS = sorted([*ROOT.glob("crane_*/package.xml"), *ROOT.glob("src/*/package.xml")])
REQUIREMENTS = [
    ROOT / f"requirements{part}.txt"
    for part in (
        *("", "-ros", "-dev", "-test", "-docs", "-tables", "-pictures", "-view", "-benchmark"),
        "-apt",
    )
]  # the last one by itself, the others together

COMMANDS = ("", "-ros", "-tables", "-pictures", "-view")  # what a user's commands may need


def pins(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


def test_all_packages_are_found() -> None:
    assert [path.parent.name for path in MANIFESTS] == [
        "crane_driver",
        "crane_identification",
        "crane_interfaces",
        "crane_trajectory",
        "crane_bags",
        "crane_benchmark",
        "crane_machines",
        "crane_model",
        "crane_nodes",
        "crane_observer",
        "crane_sim",
        "crane_viewer",
    ]


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda p: p.parent.name)
def test_manifest_names_folder_and_licence(path: Path) -> None:
    manifest = ElementTree.parse(path)
    assert manifest.findtext("name") == path.parent.name
    assert manifest.findtext("license") == "Apache-2.0"
    setup = path.with_name("setup.py")
    if setup.exists():
        assert 'license="Apache-2.0"' in setup.read_text()
        assert f'PACKAGE = "{path.parent.name}"' in setup.read_text()


def test_all_packages_have_one_version() -> None:
    versions = {ElementTree.parse(path).findtext("version") for path in MANIFESTS}
    assert len(versions) == 1
    version = versions.pop()
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    newest = re.search(r"^## (\S+?),", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest and newest[1] == version


def test_licence_text_is_at_the_top() -> None:
    assert (
        "Apache License\n                           Version 2.0" in (ROOT / "LICENSE").read_text()
    )


@pytest.mark.parametrize("path", REQUIREMENTS, ids=lambda p: p.name)
def test_every_requirement_is_pinned_and_names_no_index(path: Path) -> None:
    for line in pins(path):
        assert re.fullmatch(r"[a-z0-9.-]+==[\w.]+( ; .+)?", line), line


def test_requirement_files_agree() -> None:
    versions: dict[str, dict[Path, set[str]]] = {}
    for path in REQUIREMENTS[:-1]:
        for line in pins(path):
            name, version = line.partition(";")[0].strip().split("==")  # for whatever Python
            versions.setdefault(name, {}).setdefault(path, set()).add(version)
    for name, of_files in versions.items():
        assert len({frozenset(found) for found in of_files.values()}) == 1, f"{name}: {of_files}"


def test_every_direct_requirement_is_compiled() -> None:
    compiled = {line.split("==")[0] for path in REQUIREMENTS for line in pins(path)}
    for path in (ROOT / "scripts" / "requirements").glob("*.in"):
        for line in path.read_text().splitlines():
            if name := re.match(r"\w[\w.-]*", line):
                assert name[0].lower().replace(".", "-") in compiled, f"{path.name}: {line}"


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda p: p.parent.name)
def test_what_a_package_declares_comes_without_that_of_the_tests(path: Path) -> None:
    """A command that only tests have run imports what is there by chance."""
    own = {one.parent.name for one in MANIFESTS}
    files = (ROOT / f"requirements{part}.txt" for part in COMMANDS)
    installed = {line.split("==")[0] for file in files for line in pins(file)}
    setup = path.with_name("setup.py")
    source = setup.read_text() if setup.exists() else "install_requires=[],"
    listed = re.search(r"install_requires=\[(.*?)\]", source, re.DOTALL)
    assert listed
    names = {one.lower().replace(".", "-") for one in re.findall(r'"([\w.-]+)', listed[1])}
    assert names - own <= installed


def test_continuous_integration_runs_the_command_of_the_readme() -> None:
    assert "\nmake test\n" in (ROOT / ".ci" / "run").read_text()
    assert "make test" in (ROOT / "README.md").read_text()
