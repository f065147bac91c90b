"""Every injected law has its branch in compiled code; a number without one is refused."""

import pytest
from unit.crane_sim.injected_machine import rig

from crane_model import Machine
from crane_sim import SimulatedCrane
from crane_sim.effects.flow import leak, meter, softness
from crane_sim.effects.form import (
    END,
    FLOW,
    FRICTION,
    LEAKS,
    LOADS,
    MEMORY,
    PUSHES,
    SOFTNESS,
    Form,
    InjectedForm,
    Magnitude,
)
from crane_sim.effects.kernel import FORMS

LAWS = [form for forms in FORMS.values() for form in forms if isinstance(form.law, int)]
RANGES = (FRICTION, PUSHES, MEMORY, LOADS, FLOW, LEAKS, SOFTNESS)


def work(machine: Machine, simulated: SimulatedCrane, form: Form) -> None:
    """A step of all that acts on forces and flow."""
    joints = form.where.joints(machine)
    joint = "outer_boom" if "outer_boom" in joints else (*joints, None)[0]
    values = (form.magnitude.start, *(draw.lowest for draw in form.draws))
    made = rig(simulated, machine, InjectedForm(form, joint, values))
    made.act()
    made.settle()
    for i in range(4):
        meter(made.injected, made.constants, made.state, i)
        leak(made.injected, made.constants, made.state, i)
        softness(made.injected, made.constants, i, 5e6)


@pytest.mark.parametrize("form", LAWS, ids=lambda form: f"{form.effect}-{form.name}")
def test_every_form_has_its_branch(machine: Machine, simulated: SimulatedCrane, form: Form) -> None:
    work(machine, simulated, form)


@pytest.mark.parametrize("begin", RANGES)
def test_a_law_without_a_branch_is_no_other_law(
    machine: Machine, simulated: SimulatedCrane, begin: int
) -> None:
    """Its neighbour in the list of the range would be taken for it."""
    last = max(form.law for form in LAWS if begin <= form.law < begin + 100)
    for number in {last + 1, begin + 99}:
        form = Form("new", "law", number, Magnitude("size", "N", 1.0, 2.0))
        with pytest.raises(ValueError, match="has no branch in effects/"):
            work(machine, simulated, form)


@pytest.mark.parametrize("number", [-1, END])
def test_a_number_in_no_range_is_refused(
    machine: Machine, simulated: SimulatedCrane, number: int
) -> None:
    form = Form("new", "law", number, Magnitude("size", "N", 1.0, 2.0))
    with pytest.raises(ValueError, match=f"'law' of 'new' has the number {number}, which must"):
        work(machine, simulated, form)
