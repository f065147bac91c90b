"""Imports are read from the source: components, floors, arrows up, circles; and drawn whole."""

import re

import pytest
from from_code.imports import Imports, floors, is_up
from from_code.imports_picture import overview, panel

SOURCE = {
    "crane_model": {"arm": "", "terms/friction": "from crane_model.arm import Arm"},
    "crane_bags": {
        "reader": "from crane_bags import layout\nfrom crane_model.terms.friction import Friction",
        "layout": "import crane_model.arm\nimport numpy",
        "up": "from crane_sim.bus.unit import Unit",
    },
    "crane_sim": {
        "bus/unit": "from crane_sim.plant.plant import Plant",
        "bus/other": "from crane_sim.bus.unit import Unit",
        "plant/plant": "def late():\n    from crane_sim.bus.other import Other",
    },
}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Imports:
    root = tmp_path_factory.mktemp("clone")
    for package, modules in SOURCE.items():
        for module, text in modules.items():
            path = root / "src" / package / package / f"{module}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, "utf-8")
            (path.parent / "__init__.py").touch()
        (root / "src" / package / "setup.py").touch()
    return Imports.of(root)


def test_rooms_are_folders_and_modules_at_the_root(found: Imports) -> None:
    assert found.packages == ["crane_model", "crane_bags", "crane_sim"]
    assert found.components == {
        "crane_model.arm": set(),
        "crane_model.terms": {"crane_model.arm"},
        "crane_bags.reader": {"crane_bags.layout", "crane_model.terms"},
        "crane_bags.layout": {"crane_model.arm"},
        "crane_bags.up": {"crane_sim.bus"},
        "crane_sim.bus": {"crane_sim.plant"},
        "crane_sim.plant": {"crane_sim.bus"},
    }


def test_floors_rise_with_imports_and_a_circle_shares_one(found: Imports) -> None:
    assert floors(found.within("crane_bags")) == {
        "crane_bags.layout": 0, "crane_bags.up": 0, "crane_bags.reader": 1,
    }  # fmt: skip
    assert set(floors(found.within("crane_sim")).values()) == {0}


def test_numbers_tell_arrows_up_and_circles(found: Imports) -> None:
    rows = {row.shown[0]: row.values for row in found.rows()}
    bags, sim = rows["`crane_bags`"], rows["`crane_sim`"]
    assert (bags["leaving"], bags["up"], bags["arrows"], bags["floors"]) == (3, 1, 1, 2)
    assert (sim["in_cycles"], sim["up"], sim["modules"]) == (2, 0, 3)
    assert rows["all"]["components"] == 7
    assert is_up("crane_bags.up", "crane_sim.bus") and not is_up("crane_bags.up", "crane_bags.x")


def test_the_picture_has_every_room_and_every_arrow(found: Imports) -> None:
    drawn = panel("crane_bags", found.within("crane_bags"))
    assert re.findall(r"<text[^>]*>(\w+)<", drawn) == ["reader", "layout", "up"]
    assert len(re.findall(r'class="arrow"', drawn)) == 1
    above = overview(found)
    assert re.findall(r'class="count"[^>]*>(\d+)<', above) == ["2", "1"]
    assert 'class="up"' in above and 'class="arrow"' in above


def test_boxes_do_not_overlap(found: Imports) -> None:
    many = {f"crane_model.component_number_{i}": set[str]() for i in range(40)}
    boxes = [
        tuple(map(float, box))
        for box in re.findall(r'<rect x="([\d.-]+)" y="([\d.]+)" width="([\d.]+)"',
                              panel("crane_model", many))
    ]  # fmt: skip
    assert len(boxes) == 40
    for i, (x, y, width) in enumerate(boxes):
        assert x >= 0.0 and x + width <= 400.0
        for other_x, other_y, _ in boxes[i + 1 :]:
            assert y != other_y or x + width < other_x
