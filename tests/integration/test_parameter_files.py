"""Parameter files that are ready to copy hold what nodes declare, and change nothing."""

import re

import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from from_code.nodes import NODES, unconfigured
from from_code.parameter_files import ROOT, place, rendered

AGGREGATOR = ROOT / "src/crane_nodes/config/diagnostic_aggregator.yaml"


def values(name: str, domain: int, *arguments: str) -> tuple[str, dict[str, object]]:
    """The parameter file of a node, and what its parameters are."""
    with unconfigured(name, *arguments, domain=domain) as node:
        text = rendered(name, node)
        found = {one: p.value for one, p in node.get_parameters_by_prefix("").items()}
    return text, {one: v if isinstance(v, str) else repr(v) for one, v in found.items()}


@pytest.mark.parametrize("name", NODES)
def test_the_file_of_a_node_is_what_it_declares_and_sets_its_defaults(
    name: str, ros_domain: int
) -> None:
    text, defaults = values(name, ros_domain)
    file = place(name)
    assert file.read_text("utf-8") == text, "make figures writes it anew"
    installed = get_package_share_directory(file.parents[1].name)
    assert (ROOT / installed / "config" / file.name).read_text("utf-8") == text
    _, given = values(name, ros_domain, "--ros-args", "--params-file", str(file))
    assert given == defaults
    (content,) = yaml.safe_load(text).values()
    assert content["ros__parameters"].keys() <= defaults.keys()


@pytest.mark.parametrize("name", NODES)
def test_what_is_commented_out_is_yaml_too(name: str) -> None:
    text = re.sub(r"^(    )# (?=[\w.]+: \S+$)", r"\1", place(name).read_text("utf-8"), flags=re.M)
    (content,) = yaml.safe_load(text).values()
    assert content["ros__parameters"]


def test_every_node_belongs_to_one_group_of_the_aggregator() -> None:
    content = yaml.safe_load(AGGREGATOR.read_text())["analyzers"]["ros__parameters"]
    groups = [one["contains"] for key, one in content.items() if key != "path"]
    for name in (*NODES, "recorder"):
        if name == "jog":
            continue  # it says nothing of itself: the driver tells what it commands
        for full in (name, f"left/{name}"):
            holding = [one for one in groups if any(part in f"{full}: state" for part in one)]
            assert len(holding) == 1, full
