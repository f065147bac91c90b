"""Injected loads of the whole crane, inertia of a drive, and booms that bend: in M and bias (6)."""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import LOADS, Draw, Form, Injected, Magnitude, Where
from crane_sim.parts.constants import Scratch, State
from crane_sim.parts.rigid_bodies import (
    Chain,
    Vector,
    add_cross,
    add_push,
    beyond,
    cross,
    dot,
    mass_and_bias,
    place,
    product,
    scaled,
    summed,
    tip_of,
    vector,
)

(
    BODY_AT_TIP, SLUNG, SLIDING_BODY, TILTED, SETTLING, YIELDING, HOSE, TAPERED_HOSE, SECOND_HOSE,
    ROD, OIL_COLUMN, GEARED, PENDULUM, IN_AIR, RUBBING_HOOK, GUSTS, SQUALLS, BREEZE,
    EVEN_SLEWING, HASTY_SLEWING, UNEVEN_SLEWING,
) = range(LOADS, LOADS + 21)  # fmt: skip
SLEWS = (EVEN_SLEWING, HASTY_SLEWING, UNEVEN_SLEWING)

TILT_REACH_M = 4.0  # of the tip, at which a base that yields is tilted as far as its angle says
LARGE_SWING_SPEED = 0.2  # rad/s of a swinging load, at which its ways of losing energy are alike
# Hz, share
GUST_SPECTRUM = ((0.11, 1.0), (0.23, 0.8), (0.41, 0.6), (0.67, 0.5), (1.03, 0.35), (1.57, 0.25))


@njit(cache=True, error_model="numpy")
def carry(injected: Injected, k: int, chain: Chain, state: State) -> None:
    """Fill inertia and bias that effect k adds at this instant."""
    law, value = injected.law[k], injected.value[k]
    mass, bias = injected.mass[k], injected.bias[k]
    mass[:] = 0.0
    bias[:] = 0.0
    q, v = state.q, state.v
    size = value[0]
    place(chain, q)
    if law == BODY_AT_TIP:
        lever, radius = value[1], value[2]
        _add_body(chain, v, size, lever, size * radius**2, mass, bias)
    elif law == SLUNG:  # by a short sling: it does not turn with the boom
        _add_body(chain, v, size, 0.0, 0.0, mass, bias)
    elif law == SLIDING_BODY:  # in the grapple, towards where the boom points down
        down = -product(chain.links[-1].rotation, vector(chain.outward))[2]
        lever, sliding = value[1], value[2]
        _add_body(chain, v, size, lever + sliding * down, size * 0.04, mass, bias)
    elif law == TILTED:
        _add_tilt(chain, size, bias)
    elif law == SETTLING:
        share, time = value[1], value[2]
        _add_tilt(chain, size * (1.0 - share * math.exp(-injected.clock[0] / time)), bias)
    elif law == YIELDING:  # the further the crane reaches
        x, y, _ = tip_of(chain)
        exponent = value[1]
        _add_tilt(chain, size * (math.hypot(x, y) / TILT_REACH_M) ** exponent, bias)
    elif law in (HOSE, TAPERED_HOSE, SECOND_HOSE):
        _add_hose(chain, q, v, law, value, mass, bias)
    elif law in (ROD, OIL_COLUMN, GEARED):
        _add_drive(injected, k, state, mass, bias)
    elif law in (PENDULUM, IN_AIR, RUBBING_HOOK):
        _add_swing(injected, k, chain, bias)
    elif law in SLEWS:
        _note_centrifugal(chain, q, v, mass, bias)
    elif law in (GUSTS, SQUALLS, BREEZE):
        push, seed = 0.0, value[1]
        for n, (frequency, share) in enumerate(GUST_SPECTRUM):
            phase = 2.0 * math.pi * ((n + 1.0) * seed % 1.0)
            push += share * math.sin(2.0 * math.pi * frequency * injected.clock[0] + phase)
        if law == SQUALLS:
            push = max(push, 0.0) ** 1.5
        elif law == BREEZE:  # it never turns round
            steady = value[2]
            push = steady * (1.0 + 0.3 * push) ** 2
        add_push(chain, tip_of(chain), scaled(-size * push, _outward(chain)), bias)
    else:
        raise ValueError("a law of a load has no branch in effects/loads.py: give it one")


@njit(cache=True, error_model="numpy")
def _outward(chain: Chain) -> Vector:
    """Horizontal unit vector from the axis of the base to the tip."""
    x, y, _ = tip_of(chain)
    radius = math.hypot(x, y)
    if radius < 1e-6:
        return 1.0, 0.0, 0.0
    return x / radius, y / radius, 0.0


@njit(cache=True, error_model="numpy")
def _add_body(
    chain: Chain, v: np.ndarray, m: float, reach: float, inertia: float,
    mass: np.ndarray, bias: np.ndarray,
) -> None:  # fmt: skip
    """Add a body of mass m, `reach` beyond the tip, with equal inertia about all axes."""
    links = chain.links
    at = summed(tip_of(chain), scaled(reach, product(links[-1].rotation, vector(chain.outward))))
    omega, alpha, velocity = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    acceleration = scaled(-1.0, vector(chain.gravity))
    for i in range(1, len(links)):  # of the last link, and its point that passes the origin
        rate, turn, slide = v[links[i].leader], vector(links[i].turn), vector(links[i].slide)
        alpha = add_cross(alpha, scaled(rate, omega), turn)
        acceleration = add_cross(acceleration, scaled(rate, omega), slide)
        acceleration = add_cross(acceleration, scaled(rate, velocity), turn)
        omega = summed(omega, scaled(rate, turn))
        velocity = summed(velocity, scaled(rate, slide))
    speed = add_cross(velocity, omega, at)
    needed = add_cross(add_cross(acceleration, alpha, at), omega, speed)
    add_push(chain, at, scaled(m, needed), bias)
    for i in range(1, len(links)):
        link, turn = links[i], vector(links[i].turn)
        gradient = add_cross(vector(link.slide), turn, at)
        bias[link.leader] += inertia * dot(turn, alpha)
        for k in range(1, len(links)):
            mover, spun = links[k], vector(links[k].turn)
            shared = m * dot(gradient, add_cross(vector(mover.slide), spun, at))
            mass[link.leader, mover.leader] += shared + inertia * dot(turn, spun)


@njit(cache=True, error_model="numpy")
def _add_tilt(chain: Chain, angle: float, bias: np.ndarray) -> None:
    """Gravity of all bodies turned by `angle` in the plane of the booms, less that upright."""
    pull = -chain.gravity[2]
    outward, upward = scaled(pull * math.sin(angle), _outward(chain)), pull * (math.cos(angle) - 1)
    field = (outward[0], outward[1], upward)
    for i in range(1, len(chain.links)):
        link = chain.links[i]
        mass, moment = beyond(chain, i)
        bias[link.leader] += dot(vector(link.turn), cross(moment, field))
        bias[link.leader] += mass * dot(vector(link.slide), field)


@njit(cache=True, error_model="numpy")
def _add_drive(
    injected: Injected, k: int, state: State, mass: np.ndarray, bias: np.ndarray
) -> None:
    """Inertia M(q) of what one drive moves; by (3) it asks for dM/dq q'^2/2 too."""
    law, value, i = injected.law[k], injected.value[k], injected.joint[k]
    size, v = value[0], state.v[i]
    lever, slope = state.actuators[i].lever, state.actuators[i].slope
    if law == GEARED:  # a lever of its own, which does not change
        mass[i, i] = size * injected.lever[k] ** 2
        return
    share, change = 1.0, 0.0  # of the mass, over the range
    if law == OIL_COLUMN:
        growth = value[1]
        change = growth / injected.half[k]
        share += change * (state.q[i] - injected.middle[k])
    mass[i, i] = size * share * lever * lever
    bias[i] = size * (share * lever * slope + 0.5 * change * lever * lever) * v * v


@njit(cache=True, error_model="numpy")
def _out_of_reel(law: int, value: np.ndarray, out: float) -> tuple[float, float, float, float]:
    """Mass, first and second moment about the reel, and kg/m at it, of `out` metres of hose."""
    density, shape = value[0], value[1]
    if law == TAPERED_HOSE:  # heavier the further it is out: its couplings
        density *= out**shape
    else:
        shape = 0.0
    first, second = out**2 / (2.0 + shape), out**3 / (3.0 + shape)
    mass, moment, square = density * out / (1.0 + shape), density * first, density * second
    begin = value[1]
    if law == SECOND_HOSE and out > begin:  # it follows after some displacement
        mass += density * (out - begin)
        moment += density * (out**2 - begin**2) / 2.0
        square += density * (out**3 - begin**3) / 3.0
        density *= 2.0
    return mass, moment, square, density


@njit(cache=True, error_model="numpy")
def _add_hose(
    chain: Chain, q: np.ndarray, v: np.ndarray, law: int, value: np.ndarray,
    mass: np.ndarray, bias: np.ndarray,
) -> None:  # fmt: skip
    """Hose of q metres out of a reel, along every joint that slides, with weight and inertia.

    By Lagrange (3), with s of the hose out along u, which turns about the reel: T = (I(s) |u'|^2 +
    m(s) s'^2)/2, V = S(s) g u_z, with mass m, first moment S and second moment I of what is out.
    The way of the reel itself is left out.
    """
    pull, links = -chain.gravity[2], chain.links
    omega, alpha = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(1, len(links)):
        link, j = links[k], links[k].leader
        if link.slides:
            u, out = vector(link.slide), max(q[j], 0.0)
            carried, moment, square, density = _out_of_reel(law, value, out)
            swing = cross(omega, u)
            turning = add_cross(cross(alpha, u), omega, swing)  # u'' without acceleration of joints
            for i in range(1, k):
                gradient, a = cross(vector(links[i].turn), u), links[i].leader
                bias[a] += moment * pull * gradient[2] + density * out * out * v[j] * dot(
                    gradient, swing
                )
                bias[a] += square * dot(gradient, turning)
                for n in range(1, k):
                    turned = cross(vector(links[n].turn), u)
                    mass[a, links[n].leader] += square * dot(gradient, turned)
            mass[j, j] += carried
            bias[j] += 0.5 * density * (v[j] ** 2 - out * out * dot(swing, swing))
            bias[j] += density * pull * out * u[2]
        alpha = add_cross(alpha, scaled(v[j], omega), vector(link.turn))
        omega = summed(omega, scaled(v[j], vector(link.turn)))


@njit(cache=True, error_model="numpy")
def _note_centrifugal(
    chain: Chain, q: np.ndarray, v: np.ndarray, mass: np.ndarray, bias: np.ndarray
) -> None:
    """Note the centrifugal forces of slewing on the booms; every machine has them."""
    rate, gravity = np.zeros_like(v), np.empty_like(v)
    mass_and_bias(chain, q, rate, mass, gravity)
    rate[0] = v[0]
    mass_and_bias(chain, q, rate, mass, bias)
    for i in range(len(v)):
        bias[i] -= gravity[i]
    mass[:] = 0.0


@njit(cache=True, error_model="numpy")
def _add_swing(injected: Injected, k: int, chain: Chain, bias: np.ndarray) -> None:
    """Force of the load's motion relative to the tip, as it was in the last step.

    memory: angle and rate of the pendulum, acceleration outward and upward relative to the tip.
    """
    size, memory = injected.value[k, 0], injected.memory[k]
    outward, upward = scaled(size * memory[2], _outward(chain)), size * memory[3]
    add_push(chain, tip_of(chain), (outward[0], outward[1], upward), bias)


@njit(cache=True, error_model="numpy")
def swing(
    injected: Injected, k: int, chain: Chain, q: np.ndarray, change: np.ndarray, step: float
) -> None:
    """A plane pendulum under the tip after a step that changed the velocities by `change` (j,).

    Angles of any size; what the tip's acceleration has from velocities alone is left out, as it is
    far below g.
    """
    law, value, memory = injected.law[k], injected.value[k], injected.memory[k]
    length, damping = value[1], value[2]
    place(chain, q)
    gained = (0.0, 0.0, 0.0)  # velocity of the tip
    for i in range(1, len(chain.links)):
        link = chain.links[i]
        gradient = add_cross(vector(link.slide), vector(link.turn), tip_of(chain))
        gained = summed(gained, scaled(change[link.leader], gradient))
    pull = -chain.gravity[2]
    outward, upward = dot(gained, _outward(chain)) / step, gained[2] / step + pull
    angle, rate = memory[0], memory[1]
    turning = -(outward * math.cos(angle) + upward * math.sin(angle)) / length
    omega = math.sqrt(pull / length)
    if law == IN_AIR:  # its drag grows with the square of its speed
        turning -= 2.0 * damping * omega * rate * abs(rate) / LARGE_SWING_SPEED
    elif law == RUBBING_HOOK:
        turning -= (
            2.0 * damping * omega * LARGE_SWING_SPEED * math.tanh(rate / (0.2 * LARGE_SWING_SPEED))
        )
    else:
        turning -= 2.0 * damping * omega * rate
    rate += step * turning
    memory[0], memory[1] = angle + step * rate, rate
    memory[2] = length * (turning * math.cos(angle) - rate * rate * math.sin(angle))
    memory[3] = length * (turning * math.sin(angle) + rate * rate * math.cos(angle))


_LOAD = Magnitude("mass", "kg", 8.0, 400.0)
_TILT = Magnitude("angle", "rad", 0.02, 0.35)
_HOSE = Magnitude("density", "kg/m", 2.0, 60.0)
_DRIVE = Magnitude("mass", "kg", 100.0, 20000.0)
_SWINGING = Magnitude("mass", "kg", 10.0, 80.0)
_SLING = (Draw("length", "m", 0.4, 2.0), Draw("damping", "1", 0.01, 0.05))
_SLEW = Magnitude("speed", "rad/s", 0.2, 0.38)
_SWINGS = Draw("frequency", "rad/s", 0.5, 0.9)
_WIND, _WHEN = Magnitude("force", "N", 20.0, 2000.0), Draw("phase", "1", 0.0, 1.0)

LOAD_FORMS = (
    Form("payload", "body", BODY_AT_TIP, _LOAD,
         (Draw("reach", "m", 0.0, 0.3), Draw("gyration", "m", 0.1, 0.3)), Where.WHOLE),
    Form("payload", "slung", SLUNG, _LOAD, (), Where.WHOLE),
    Form("payload", "sliding", SLIDING_BODY, _LOAD,
         (Draw("reach", "m", 0.0, 0.2), Draw("slides", "m", 0.02, 0.1)), Where.WHOLE),
    Form("base_tilt", "exact", TILTED, _TILT, (), Where.WHOLE, signed=True),
    Form("base_tilt", "settling", SETTLING, _TILT,
         (Draw("share", "1", 0.05, 0.2), Draw("within", "s", 10.0, 40.0)), Where.WHOLE,
         signed=True),
    Form("base_tilt", "yielding", YIELDING, _TILT, (Draw("exponent", "1", 0.1, 0.4),),
         Where.WHOLE, signed=True),
    Form("hose_mass", "reel", HOSE, _HOSE, (), Where.TELESCOPIC),
    Form("hose_mass", "tapered", TAPERED_HOSE, _HOSE, (Draw("exponent", "1", 0.2, 0.8),),
         Where.TELESCOPIC),
    Form("hose_mass", "second", SECOND_HOSE, _HOSE, (Draw("after", "m", 0.1, 0.5),),
         Where.TELESCOPIC),
    Form("actuator_inertia", "rod", ROD, _DRIVE),
    Form("actuator_inertia", "oil_column", OIL_COLUMN, _DRIVE, (Draw("slope", "1", -0.4, 0.4),)),
    Form("actuator_inertia", "geared", GEARED, _DRIVE),
    Form("swinging_load", "pendulum", PENDULUM, _SWINGING, _SLING, Where.WHOLE),
    Form("swinging_load", "in_air", IN_AIR, _SWINGING, _SLING, Where.WHOLE),
    Form("swinging_load", "rubbing_hook", RUBBING_HOOK, _SWINGING, _SLING, Where.WHOLE),
    Form("slew_coupling", "slewing", EVEN_SLEWING, _SLEW, (_SWINGS,), Where.SLEWING),
    Form("slew_coupling", "hasty", HASTY_SLEWING, _SLEW,
         (_SWINGS, Draw("third", "1", 0.1, 0.3)), Where.SLEWING),
    Form("slew_coupling", "uneven", UNEVEN_SLEWING, _SLEW,
         (_SWINGS, Draw("second", "1", 0.1, 0.4)), Where.SLEWING),
    Form("wind", "gusts", GUSTS, _WIND, (_WHEN,), Where.WHOLE, outside=True),
    Form("wind", "squalls", SQUALLS, _WIND, (_WHEN,), Where.WHOLE, outside=True),
    Form("wind", "breeze", BREEZE, _WIND, (_WHEN, Draw("mean", "1", 0.5, 1.0)), Where.WHOLE,
         outside=True),
)  # fmt: skip


# A boom that bends: part of what a joint moves rides on two springs behind the joint.
#
# Either mode carries a share of all that the joint moves, bent by e in the coordinate of the joint:
# with M, h of (6) at q + e, q' + e', its own balance M_i (q'' + e'') + h_i = -k e - d e' gives e'',
# and what it asks of every other joint, M_j (q'' + e'') + h_j, is the inertia and the weight of
# bodies where they really are. k and d are constant, so that the frequency follows the pose.

TWO_MODES, ONE_MODE, PROGRESSIVE_BEND = range(LOADS + 50, LOADS + 53)

BENDING_MODES = ((1.0, 1.0), (2.7, 0.25))  # frequency and share, of those of the first
INERTIA_SLOT = (
    4  # in the memory: after two deflections and their rates, that of the joint at the start
)
SAG_PASSES = 50  # in which a boom sags to where its springs hold it


@njit(cache=True, error_model="numpy", forceinline=True)
def carry_bent(
    injected: Injected, k: int, chain: Chain, q: np.ndarray, v: np.ndarray, free: Scratch
) -> None:
    """Fill inertia and bias of what rides on the springs, less those of the same parts unbent.

    `free` has M and h of (6) without effects. e'' is eliminated, so that no step is too long for
    the light rest that does not bend; what it follows from is kept for `bend`.
    """
    value, memory, i = injected.value[k], injected.memory[k], injected.joint[k]
    mass, bias = injected.mass[k], injected.bias[k]
    if memory[INERTIA_SLOT] == 0.0:
        _sag(injected, k, chain, q)
    count, size = _count(injected.law[k]), value[0]
    riding = 0.0
    for mode in range(count):
        riding += size * BENDING_MODES[mode][1]
    for a in range(len(q)):
        bias[a] = -riding * free.bias[a]
        for b in range(len(q)):
            mass[a, b] = -riding * free.mass[a, b]
    bent_mass, bent_bias = injected.bent_mass, injected.bent_bias
    for mode in range(count):
        share = size * BENDING_MODES[mode][1]
        _bent(injected, k, mode, chain, q, v, bent_mass, bent_bias)
        push = bent_bias[i] + _spring(injected, k, mode)
        for a in range(len(q)):
            lever = bent_mass[a, i] / bent_mass[i, i]
            injected.slowing[k, mode, a] = lever
            bias[a] += share * (bent_bias[a] - lever * push)
            for b in range(len(q)):
                mass[a, b] += share * (bent_mass[a, b] - lever * bent_mass[i, b])
        injected.slowing[k, mode, -1] = push / bent_mass[i, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def bend(injected: Injected, k: int, change: np.ndarray, step: float) -> None:
    """Modes after a step that changed the velocities by `change` (j,); symplectic."""
    memory = injected.memory[k]
    for mode in range(_count(injected.law[k])):
        slowing = injected.slowing[k, mode, -1]
        for a in range(len(change)):
            slowing += injected.slowing[k, mode, a] * change[a] / step
        memory[2 + mode] -= step * slowing
        memory[mode] += step * memory[2 + mode]


@njit(cache=True, error_model="numpy", forceinline=True)
def _bent(
    injected: Injected, k: int, mode: int, chain: Chain, q: np.ndarray, v: np.ndarray,
    mass: np.ndarray, bias: np.ndarray,
) -> None:  # fmt: skip
    """M and h of (6) where the mode has bent the crane."""
    memory, i = injected.memory[k], injected.joint[k]
    straight_q, straight_v = q[i], v[i]
    q[i] += memory[mode]
    v[i] += memory[2 + mode]
    mass_and_bias(chain, q, v, mass, bias)
    q[i], v[i] = straight_q, straight_v


@njit(cache=True, error_model="numpy", forceinline=True)
def _spring(injected: Injected, k: int, mode: int) -> float:
    """k e + d e' of a mode that carried all of the inertia [N m, N]."""
    memory = injected.memory[k]
    omega = 2.0 * math.pi * injected.value[k, 1] * BENDING_MODES[mode][0]
    damper = 2.0 * injected.value[k, 2] * omega
    deflection = memory[mode]
    if injected.law[k] == PROGRESSIVE_BEND:
        deflection *= 1.0 + (deflection / injected.value[k, 3]) ** 2
    return memory[INERTIA_SLOT] * (omega * omega * deflection + damper * memory[2 + mode])


@njit(cache=True, error_model="numpy")
def _count(law: int) -> int:
    if law == TWO_MODES:
        return 2
    if law in (ONE_MODE, PROGRESSIVE_BEND):
        return 1
    raise ValueError("a law of a bend has no branch in effects/loads.py: give it one")


@njit(cache=True, error_model="numpy")
def _sag(injected: Injected, k: int, chain: Chain, q: np.ndarray) -> None:
    """The inertia that sets the springs, and where they hold the crane at rest."""
    memory, i = injected.memory[k], injected.joint[k]
    still, mass, bias = np.zeros(len(q)), np.empty((len(q), len(q))), np.empty(len(q))
    mass_and_bias(chain, q, still, mass, bias)
    memory[INERTIA_SLOT] = mass[i, i]
    for mode in range(_count(injected.law[k])):
        omega = 2.0 * math.pi * injected.value[k, 1] * BENDING_MODES[mode][0]
        for _ in range(SAG_PASSES):
            _bent(injected, k, mode, chain, q, still, mass, bias)
            slope = omega**2 * memory[INERTIA_SLOT]
            if injected.law[k] == PROGRESSIVE_BEND:
                slope *= 1.0 + 3.0 * (memory[mode] / injected.value[k, 3]) ** 2
            memory[mode] -= (bias[i] + _spring(injected, k, mode)) / slope


_SHARE = Magnitude("share", "1", 0.1, 0.7)
_QUICK, _DAMPING = Draw("frequency", "Hz", 5.0, 12.0), Draw("damping", "1", 0.03, 0.15)

BENDING_FORMS = (
    Form("boom_flexibility", "two_modes", TWO_MODES, _SHARE,
         (Draw("frequency", "Hz", 0.7, 12.0, ratio=True), _DAMPING)),
    Form("boom_flexibility", "one_mode", ONE_MODE, _SHARE, (_QUICK, _DAMPING)),
    Form("boom_flexibility", "progressive", PROGRESSIVE_BEND, _SHARE,
         (_QUICK, _DAMPING, Draw("softness", "{coordinate}", 3e-3, 2e-2))),
)  # fmt: skip
