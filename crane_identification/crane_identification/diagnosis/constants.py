"""Constants of the decision; its thresholds are in `discrepancy.yaml`.

Each has its unit [-: none], its meaning, and how it was set. Steps, grids, bounds and accuracies of
a search, which change no answer, stand where they are used.
"""

# Shares [-]. What counts as most, little or slight is said once.

MOST_SHARE = 0.5  # from which on a share is most of something
LITTLE_SHARE = 0.1
"""Below it, a part is little: of an effect in a recording, where it does not act then; of the norm
of friction in used rows, where ten times as much would have to be elsewhere; of a column that the
predicted force does not have; of friction at rest. Chosen."""
SLIGHT_SHARE = 0.05
"""Below it, a difference is slight: of two masses, as no load is a point; of friction that falls
with the speed; of a coefficient from one; of an error before and after; of energy. Chosen."""
VISIBLE_SHARE = 0.02
"""Share of a column's norm that the other columns must leave for an effect to be testable, or for a
parameter of the model to be determined. Chosen."""
HELD_SHARE = 0.2
"""Share of a direction's norm that the other folds must hold to determine its coefficient: the
noise that the fold is predicted with because of it is then five times that of a row at most."""
QUIET_SHARE = 0.01  # of the largest energy of a row: below it, an occasion has ended; chosen
FAMILY_LEAD_SHARE = 0.003
"""Share of what its own family of curves explains that another family explains more at least. By
test_shapes: losses beyond a speed, and friction that falls with it."""
FORCE_CORRELATION = 0.999
"""A column whose part beyond the base is correlated like this with the residual is the measured
force itself: it explains everything, noise included, and says nothing. Chosen."""
IDENTICAL_CORRELATION = 1.0 - 1e-6  # of an effect that is another one by another name; rounding
DETECTABLE_SHARE = 0.9  # of the effects, that show at the strength that is called detectable
PARTLY_SEEN_SHARE = 0.25  # of the energy of an effect, below which it may stay unseen; chosen
OPEN_TURNING = 0.15
"""Share of what the filter sees that is close to reversals: these are shorter than its response."""
FORM_ERROR = 0.75
"""Relative error of a parameter, over the model error beyond noise relative to the visible part of
its effect. A smooth force of another form hides in the other parameters: the error is larger than
what is left. Two of these cover in 95 % of 384 regressions with forms of four families, and in 96 %
of 384 others."""
FORMULA_SHARE = 0.03  # of the energy beyond noise, that a further term explains; by test_formula
PLAUSIBLE_SHARE = 0.02  # rms of a term that is not determined, over that of the force; chosen
LENGTH_ERROR = 0.02  # standard deviation of lengths that were not surveyed, relative; experience

# Standard deviations and ratios [-].

SURE_SIGMAS = 4.0  # within which masses, coefficients and identified values are the same
POWER_RATIO = 4.0
"""By how much a load that nothing in training speaks for reduces the power of what is left of the
joint that is worst off, at least; and how much more than in training is then left, at most."""
DIFFERING_RATIO = 2.0  # times the median of the recordings, from which one differs; chosen

# Counts [-].

FEWEST_RECORDINGS = 4  # as folds; with fewer, blocks of time take their place
TIME_BLOCKS = 6
FEWEST_ACTING = 3  # recordings in which an effect acts; with fewer, blocks of time take their place
FEWEST_OCCASIONS = 2  # on which it acts there, as into an end and out: what happens once is no law
FEWEST_JOINTS = 3  # that lack one kind of effect at once
LARGEST_SET = 6  # effects that are sought together
FEWEST_ROWS = 60  # of the joint that moves most; no score exceeds the number of rows
CHANNEL_ROWS = 8  # of a channel, below which it says nothing
ROWS_PER_UNKNOWN = 1.5  # of the base; a channel with fewer says nothing about what it lacks
ROWS_PER_PARAMETER = 3  # of the model, which leaves nothing to look into of fewer

# Quantities with units.

SHORT_LEAD = 0.015  # s, in which filtered noise hardly changes
LEAST_TIME = 8.0  # s of motion in either direction, for a balance of the flow
LEAST_RUN = 1.0  # s; of what is shorter, the filter sees nothing but its ends
LEAST_DROP = 3e5
"""Pressure [Pa] from chambers to tank and supply. Below it, errors of transducers are as large as
the drop, and a chamber may be about to be empty and draw oil past the valve."""
SAME_COMMAND = 1e-3  # [-1..1] by which dead bands and play that are the same may differ
SAME_ASYMMETRY = 5e-3  # of the gains
SAME_LEAKAGE = 1e-14  # m3/(s Pa)
SAME_OIL = 0.1  # of the bulk modulus, which a little air or warmth changes as much
