r"""What agents hold in the mean where the crossing itself is the signal: exact moments.

With response probabilities that stay as they are, demand at one signal decides demand at the next,

    y(k+1) = M y(k),   M = diag(B) + a (1 - B)',   a = alpha / sum(alpha),

with B_i = beta_i if agent i responds and 1 else: the total is at the same level every time.  M does not
depend on y, so the moments E y and E y y' are the solutions of linear equations, and so is the mean over
time of a line from B_i y_i on that rises for T = sum_u (1 - B_u) y_u / sum(alpha).
"""

from typing import NamedTuple

import numpy as np

from aimd_des.utils.validation import FloatArray


class Moments(NamedTuple):
    """Second moments of one resource at the signals that act."""

    covariance: FloatArray  # (n, n): of the demands that signals find; the total does not vary
    kicks: FloatArray  # (n,): var B_i E y_i^2, and what comes to it


def moments_at_signals(
    increase: FloatArray, keep: FloatArray, hit: FloatArray, found: FloatArray, more: FloatArray | float = 0.0
) -> Moments:
    """Compute the second moments, for any number of agents; `more` is variance of other causes, (n,).

    Notes
    -----
    The covariance C of what signals find obeys C = E M C E M' + J diag(w) J' with J = 1 - a 1' and w_i = Var
    B_i E y_i^2, besides `more`.  As the total does not vary, C 1 = 0, and with b = E B it has the form

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
    kicks = np.linalg.solve(np.eye(len(part)) - variance[:, None] * returned, variance * found**2 + more)
    z = shift @ kicks
    crossed = np.outer(z, part)
    covariance = gain * (crossed + crossed.T - np.outer(part, part) * z.sum() + np.diag(kicks))
    return Moments(covariance, kicks)


def averages_between(
    increase: FloatArray, keep: FloatArray, hit: FloatArray, found: FloatArray, moments: Moments
) -> FloatArray:
    """Compute the averages over time of continuous agents, (n,)."""
    kappa, growth = keep * hit, increase.sum()
    square = moments.covariance + np.outer(found, found)
    gap = (kappa * found).sum() / growth  # E T
    gap_square = (kappa @ square @ kappa + moments.kicks.sum()) / growth**2
    gap_held = ((1.0 - kappa) * (square @ kappa) - moments.kicks) / growth  # E T B_i y_i
    return np.asarray((gap_held + 0.5 * increase * gap_square) / gap)


def averages_on_the_clock(
    increase: FloatArray,
    keep: FloatArray,
    hit: FloatArray,
    found: FloatArray,
    square: FloatArray,
    share: FloatArray | float,
    loss: FloatArray,
) -> FloatArray:
    """Compute the averages over steps, (n,) or (n, m), from E y_i^2: the square of a demand does not drift.

    Notes
    -----
    With e the share of steps with a signal, over the steps without one, and those whose signal is lost,

        (1 - e) (2 alpha E[x | none] + alpha^2) + e p (2 alpha E y + alpha^2) = e (1 - E B^2) E y^2,

    exactly, for any lag.
    """
    taken = share * hit * keep * (2.0 - keep) * square
    missed = share * loss * (2.0 * found + increase)
    return np.asarray(share * found + 0.5 * (taken / increase - missed - (1.0 - share) * increase))
