"""Where the numbers of a model stand in its row of the filters' room.

All that the kernels know of a model is one flat row, and a kernel is passed that row alone: an array costs seven
machine words a call, and within one row the compiler knows which numbers are apart and puts them in vector registers.
It knows so of matrices that are written row by row in a loop if what is read meanwhile stands before them, hence the
order. The row after the models' is the mixture's; it holds the plot too.
"""

from __future__ import annotations

MU, CBAR, LOG_L, MIX = 0, 1, 2, 3  # probability after and before the plot, log-likelihood, weight in a mixture
SQUARE = 4  # normalised innovation squared
NOISE = 5  # (9): process noise of position, velocity, third block; each times the unit matrix
AT, NU = 14, 17  # (3): predicted measurement, innovation
PLOT, VARIANCE, KNOWN = 20, 23, 26  # (3): in the mixture's row; KNOWN is 1 where the component was measured
H, R, S = 29, 38, 47  # (9): Jacobian by position, noise covariance, innovation covariance
LOWER, PIVOT = 56, 59  # (3): inverse of the unit triangular factor of S (10, 20, 21), reciprocals of the diagonal one
CROSS, WHITE, GAIN = 62, 89, 116  # (27): H P, the same times LOWER, gain; nine states of one component after another
AWAY, SEEN = 143, 152  # (9): room for mixing
JACOBIAN = 161  # (36): columns of velocity and third block, each with six rows; the rest of a Jacobian is known

# Densities (90), nine states and from `_P` on their covariance row by row; PADDED in the states of another model.
P, DENSITY = 9, 90
FILTERED, PREDICTED, PADDED = 197, 287, 377
FILTERED_P, PREDICTED_P, PADDED_P = FILTERED + P, PREDICTED + P, PADDED + P

PRODUCT = 467  # (81): room for whoever needs it
WIDTH = 548
