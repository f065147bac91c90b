"""Every limit of the check of recordings, and where it comes from.

Shares of unexplained force were set on recordings of the simulated crane: as they should be,
they leave 0.3 to 2 %, with an effect of 4 % of the drive force up to 5 %. Of the mix-ups that are
looked for, the mildest left 12 %, and undoing it 2 %.
"""

import math

# positions
OUTSIDE = 0.05  # of the range of Table 2: encoder zeros are set by hand, and limits are soft
ALMOST_ALL = (0.1, 99.9)  # percentiles of a signal between which single bad samples do not count
VISIBLE = 0.05  # of the range of Table 2; less is no motion in any unit
TURN = 2.0 * math.pi  # rad
MOST_TURNS = 3  # that an encoder may be off
UNITS_OF_ANGLE = {"degrees": math.pi / 180.0, "mrad": 1e-3, "turns": TURN}  # to rad
UNITS_OF_LENGTH = {"mm": 1e-3, "cm": 1e-2}  # to m
TOO_FAST = 1.5  # times the speed of Table 2, which a cylinder passes when a load pulls it
SPEED_OVER = 0.2  # s, over which a speed is measured: an encoder's steps are invisible in it
COARSE = 100  # encoder counts of a whole motion, below which velocity is made of steps

# sampling
SLOWEST = 40.0  # Hz: a crane swings on its oil at 2 to 3 Hz; its acceleration needs ten samples
LEAST_RATE = 15.0  # Hz, that suffices for slow motion
HELD = 0.5  # share of the samples in motion that repeat the one before, as nobody's encoder does
# Encoder counts that must pass between two samples for that to mean something
REPEATED_COUNTS = 2.0

# pressures
FEEBLE = 0.02  # of the supply pressure; cylinders that move a boom have more in them
FULL = (0.2, 1.2)  # of the supply pressure, between which the highest of a cylinder lies
LEAST_OVERPRESSURE_SHARE = 0.05  # of the time beyond the relief valve's pressure; peaks are shorter
VACUUM = -1.2e5  # Pa gauge; no pressure is lower than -1.013e5
UNITS_OF_PRESSURE = {"kPa": 1e3, "bar": 1e5, "MPa": 1e6, "psi": 6894.757293168}  # to Pa
SUPPLY = (0.5, 1.3)  # times the supply pressure of the machine file, where it is logged
NEAR_ATMOSPHERE = 25_000.0  # Pa, as far as the two estimates of an offset err
FAST = 0.25  # of a cylinder's highest speed; above, its flow goes through the valve's edges
FEWEST_STROKES = 4  # directions of cylinders that must agree on an offset

# transducers
PLATEAU = 0.25  # s at one reading while the joint moves
RARELY = 10.0  # times as long as nineteen in twenty such plateaus of the same transducer
ENDLESS = 0.5  # of the motion in one plateau: stuck, where a clipped signal would come back
FROZEN = 0.02  # share of the motion at one reading above which the joint's force is not known
COARSE_STEPS = 256.0  # steps of a transducer in its range, below which it is coarse: 8 bits
FEWEST_STEPS = 30.0  # in its range, below which nothing can be expected of a transducer
# 87 clean transducers with steps of 0.1 to 0.3 MPa reach at most 6.1 of these standard deviations.
EXPECTED_STEPS = 2.0  # by which the other sensors expect a reading to change while it is stuck
EXPECTED_SIGMAS = 8.0  # the same, in standard deviations of what they expect
LEAST_TRAINED = 20  # samples a coefficient, from which such an expectation can be learnt
ASKED = 0.3  # of the full command, beyond the dead band of valves
ASKED_FOR = 1.0  # s
ASKED_WAY = 0.01  # rad or m (or per s) of reference or velocity, which an encoder shows
SHORTEST_STOP = 0.05  # s, in which a brake, a valve or a drive stops a joint
MOST = (10, 90)  # percentiles of a signal between which its change counts

# clocks
FEWEST_MESSAGES = 20  # on a topic, to judge its clock
OFFSET = 0.05  # s between two topics; ROS and a recorder need some milliseconds
DRIFT = 1e-3  # s/s; quartz clocks drift by 1e-4 at most
LEAST_DRIFT = 0.05  # s over a whole recording
TOGETHER = 0.9  # of the time of the positions, at least, that forces or pressures should cover

# forces
WORKING_RATE = 50.0  # Hz
BANDWIDTH = 4.0  # Hz: a boom's motion, with its swinging on the oil
MOVING = 0.03  # of the speed of Table 2; below, friction is anything between its branches
FORCE_SETTLING_S = 0.1  # s from standstill, as the fit keeps
LEAST_MOTION = 5.0  # s of motion of each joint, which four periods of 0.2 Hz and a fit need
POOR = 0.06  # of the force unexplained, from which on another wiring is tried
BETTER = 2.5  # times less unexplained with each mistake that is undone, if that was it
UNEXPLAINED = 0.35  # of the force, which no machine of the kind leaves

# forces of any machine
ARM_BANDWIDTH = 10.0  # Hz
SIMPLER = 1.5  # times as much may be left by a turned sign as by a factor for each joint
SAME_LEFT = 1.1  # times as much may be left by the likelier mistake
IMPERFECT = 0.015  # of the force unexplained, from which on units are compared
LEAST_RATIO = 1.3  # of two factors that are units, and not what sensors or gears vary by
SLOW = 0.05  # of a joint's highest speed; below, friction is anything between its branches
NEGATIVE_SIGMAS = 3.0  # standard deviations by which friction and inertia are negative

# delay of pressures behind positions
LONGEST_DELAY = 1.5  # s
DELAY_STEP = 0.05  # s
SHORTEST_DELAY = 0.03  # s: filters and friction that lags shift by 0.02 s
LARGEST_DRIFT = 0.02  # s/s
LEAST_UNEXPLAINED = 0.01  # of the force, below which no delay matters
POWER_LEFT = 0.5  # of what is unexplained, if that was the delay
ALONE = 0.25  # the same of a single joint; 2 % of wrong geometry leaves 0.4
AGREEING = 0.3  # of the delay, as far as joints on one clock differ
ROWS = 1500  # that a delay is sought on

# masses
KNOWN_MASS_SIGMA = 0.15  # relative standard deviation, from which on a mass is known
# An effect that the model lacks biases masses that a recording hardly shows.
# Times less of the force unexplained by implausible masses, or they are not asked
IMPLAUSIBLE_GAIN = 1.3
# Relative, by which masses that one factor made wrong differ; with a load, by 0.2
SAME_FACTOR_TOLERANCE = 0.12
CORRELATED = 25.0  # rows that tell as much as one: half a second of a smooth signal

# flow
UNMOVED = 0.1  # of the piston's flow unexplained by its command, which leaves 1 to 7 %
