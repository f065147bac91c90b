"""Each machine that ships has a page, which includes what the code knows of it."""

import re

from from_code import machines
from manual import text

from crane_machines import shipped


def test_each_has_a_page_in_the_manual() -> None:
    index = text("docs/machines/index.md")
    for name in shipped():
        assert re.search(rf"^{name}$", index, re.MULTILINE), name
        page = text(f"docs/machines/{name}.md")
        assert f"../reference/generated/machine_{name}.txt" in page


def test_it_includes_the_picture_the_check_and_what_is_true() -> None:
    made = dict(machines.pages_of("single_axis"))
    assert set(made) == {"machine_single_axis.svg", "machine_single_axis.txt"}
    page = made["machine_single_axis.txt"]
    assert "machine_single_axis.svg" in page and "Nothing is inconsistent." in page
    assert "Of 10 inertial parameters of 1 body, 3 combinations show in the forces" in page
    assert re.search(r"^\| `f_v\.boom` \| viscous .* \| 800 \| N m s/rad \|$", page, re.MULTILINE)
    assert "make demo MACHINE=single_axis\n" in page
    picture = made["machine_single_axis.svg"]
    assert "<svg" in picture and picture == machines.drawn(machines.load_machine("single_axis"))
