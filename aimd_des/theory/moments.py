r"""What agents hold in the mean where the crossing itself is the signal: exact moments.

With response probabilities that stay as they are, demand at one signal decides demand at the next,

    y(k+1) = M y(k),   M = diag(B) + a (1 - B)',   a = alpha / sum(alpha),

with B_i = beta_i if agent i responds and 1 else: the total is at the same level every time.  M does not
depend on y, so the moments E y and E y y' are the solutions of linear equations, and so is the mean over
time of a line from B_i y_i on that rises for T = sum_u (1 - B_u) y_u / sum(alpha).
"""

import numpy as np

from aimd_des.utils.validation import FloatArray

__all__ = ["exact_averages"]


def exact_averages(increase: FloatArray, keep: FloatArray, hit: FloatArray, found: FloatArray) -> FloatArray:
    """Compute the averages over time of one resource, for any number of agents.

    Notes
    -----
    The covariance C of what signals find obeys C = E M C E M' + J diag(w) J' with J = 1 - a 1' and w_i = Var
    B_i E y_i^2.  As the total does not vary, C 1 = 0, and with b = E B it has the form

        (1 - b_i b_k) C_ik = z_i a_k + a_i z_k - a_i a_k sum(z) + w_i [i = k],

    whose z is linear in w by C 1 = 0, and w linear in itself by E y_i^2 = (E y_i)^2 + C_ii.
    """
    part, kappa = increase / increase.sum(), keep * hit
    variance, stay = keep**2 * hit * (1.0 - hit), 1.0 - kappa
    gain = 1.0 / (1.0 - np.outer(stay, stay))
    own, spread = np.diag(gain), gain @ part
    balance = np.diag(spread) + part[:, None] * gain - (part * spread)[:, None]
    shift = -np.linalg.solve(balance, np.diag(own))  # z is this times w
    returned = own[:, None] * (2.0 * part[:, None] * shift - (part**2)[:, None] * shift.sum(axis=0))
    returned += np.diag(own)  # C_ii is this times w
    kicks = np.linalg.solve(np.eye(len(part)) - variance[:, None] * returned, variance * found**2)
    z = shift @ kicks
    crossed = np.outer(z, part)
    covariance = gain * (crossed + crossed.T - np.outer(part, part) * z.sum() + np.diag(kicks))
    moments = covariance + np.outer(found, found)
    growth = increase.sum()
    gap = (kappa * found).sum() / growth  # E T
    gap_square = (kappa @ moments @ kappa + kicks.sum()) / growth**2
    gap_held = (stay * (moments @ kappa) - kicks) / growth  # E T B_i y_i
    return np.asarray((gap_held + 0.5 * increase * gap_square) / gap)
