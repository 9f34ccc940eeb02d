r"""Results from the literature on AIMD that runs are held against.

Between two capacity events every share grows, x_i(k+1) = beta_i x_i(k) + alpha_i T(k), with 1 in the
place of beta_i where an agent does not respond (the paper, section III).

Sources: M. Corless, C. King, R. Shorten and F. Wirth, AIMD Dynamics and Distributed Resource Allocation,
SIAM, 2016; D.-M. Chiu and R. Jain, Computer Networks and ISDN Systems 17, 1989, for synchronised agents;
E. Altman, K. Avrachenkov and C. Barakat, A stochastic model of TCP/IP with stationary random losses,
SIGCOMM 2000, for losses at random times; M. Mathis, J. Semke, J. Mahdavi and T. Ott, The macroscopic behavior
of the TCP congestion avoidance algorithm, Computer Communication Review 27, 1997, for the square-root law.
"""

from typing import Literal

import numpy as np
import numpy.typing as npt

from aimd_des.theory.arguments import arguments
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

# Terms of the sum in the square-root law are at most this where it ends.
_NEGLIGIBLE = 1e-17


def _per_agent(**given: npt.ArrayLike) -> list[FloatArray]:
    """Check and spread out what may differ from agent to agent, (n,) or (n, m)."""
    clean = arguments(**given)
    spread = [np.array(values) for values in np.broadcast_arrays(*clean)]
    if spread[0].ndim == 0:
        raise InputError.of(next(iter(given)), float(clean[0]), "an array with one value for each agent")
    return spread


def event_mean(
    capacity: npt.ArrayLike,
    increase: npt.ArrayLike,
    decrease: npt.ArrayLike,
    probability: npt.ArrayLike = 1.0,
) -> FloatArray:
    r"""Mean share at capacity events.

    .. math::

        C\,\frac{a_i}{\sum_k a_k}, \quad a_i = \frac{\alpha_i}{\lambda_i (1 - \beta_i)}

    Parameters
    ----------
    capacity : array_like, shape () or (m,)
        C, in units of the resource: what all hold together at an event.
    increase, decrease : array_like, shape (n,) or (n, m)
        alpha_i and beta_i; one of the three must be an array.
    probability : array_like, shape (), (n,) or (n, m)
        lambda_i, fixed.  1, synchronised agents: the mean is the fixed point that shares tend to.

    Returns
    -------
    ndarray, shape (n,) or (n, m)
        In units of the resource, just before the decrease.

    Notes
    -----
    In x_i(k+1) = B_i x_i(k) + alpha_i T(k), B_i is beta_i with probability lambda_i and else 1. So
    lambda_i (1 - beta_i) E x_i = alpha_i E T. That is exact for any law of T, for responses that are
    drawn anew at each event, with no latency.  Synchronised agents come nearer to their fixed point by
    the factor of the largest beta_i, at least, from event to event.  Time averages are smaller by about
    alpha_i E T / 2.
    """
    alpha, beta, chance = _per_agent(increase=increase, decrease=decrease, probability=probability)
    (total,) = arguments(capacity=capacity)
    ratio = alpha / (chance * (1.0 - beta))
    return np.asarray(total * ratio / ratio.sum(axis=0))


def event_interval(
    capacity: npt.ArrayLike,
    increase: npt.ArrayLike,
    decrease: npt.ArrayLike,
    probability: npt.ArrayLike = 1.0,
) -> FloatArray:
    r"""Mean time between capacity events.

    .. math::

        \frac{C}{\sum_i a_i}, \quad a_i = \frac{\alpha_i}{\lambda_i (1 - \beta_i)}

    Parameters
    ----------
    capacity : array_like, shape () or (m,)
        C, in units of the resource.
    increase, decrease : array_like, shape (n,) or (n, m)
        alpha_i and beta_i; one of the three must be an array.
    probability : array_like, shape (), (n,) or (n, m)
        lambda_i, fixed.  1, synchronised agents: the period, (1 - beta) C / (n alpha) if all are alike.

    Returns
    -------
    ndarray, shape () or (m,)
        In units of time.

    Notes
    -----
    E T of `event_mean`, from sum_i E x_i = C; as exact as that.
    """
    alpha, beta, chance = _per_agent(increase=increase, decrease=decrease, probability=probability)
    (total,) = arguments(capacity=capacity)
    return np.asarray(total / (alpha / (chance * (1.0 - beta))).sum(axis=0))


def synchronised_utilisation(increase: npt.ArrayLike, decrease: npt.ArrayLike) -> FloatArray:
    r"""Share of the capacity that synchronised agents use.

    .. math::

        \frac{1 + \beta}{2} \quad \mathrm{if\ all\ are\ alike}

    Parameters
    ----------
    increase, decrease : array_like, shape (n,) or (n, m)
        alpha_i and beta_i; one of the two must be an array.

    Returns
    -------
    ndarray, shape () or (m,)
        A pure number.

    Notes
    -----
    Every share is a saw between beta_i x_i and the x_i of `event_mean`, so its mean is (1 + beta_i) x_i / 2.
    Exact for continuous agents that all respond to every signal at once, when transients have died out.
    """
    alpha, beta = _per_agent(increase=increase, decrease=decrease)
    share = alpha / (1.0 - beta)
    return np.asarray((0.5 * (1.0 + beta) * share).sum(axis=0) / share.sum(axis=0))


def poisson_moment(
    increase: npt.ArrayLike, decrease: npt.ArrayLike, rate: npt.ArrayLike, order: int = 1
) -> FloatArray:
    r"""Moment of one agent's demand that decreases at the times of a Poisson process.

    .. math::

        E x = \frac{\alpha}{r (1 - \beta)}, \quad E x^2 = \frac{2 \alpha^2}{r^2 (1 - \beta)(1 - \beta^2)}

    Parameters
    ----------
    increase, decrease : array_like
        alpha and beta.
    rate : array_like
        r > 0: decreases per unit of time (signals times the response probability).
    order : int
        k >= 1: which moment.

    Returns
    -------
    ndarray
        E x^k, in units of the resource to that power.

    Notes
    -----
    In the long run x^k does not drift: k alpha E x^(k-1) = r (1 - beta^k) E x^k.  Exact, and the mean at
    decreases is the same as that over time.  Among many agents, each of which answers few of the
    signals, decreases of one come nearly so; neglected is that signals come at nearly even distances.
    """
    degree = validation.integer("order", order, low=1)
    alpha, beta, often = arguments(increase=increase, decrease=decrease, rate=rate)
    moment = np.ones(())
    for power in range(1, degree + 1):
        moment = moment * power * alpha / (often * (1.0 - beta**power))
    return np.asarray(moment)


def square_root_law(
    increase: npt.ArrayLike,
    decrease: npt.ArrayLike,
    packet_loss: npt.ArrayLike,
    losses: Literal["periodic", "poisson", "per_packet"] = "periodic",
) -> FloatArray:
    r"""Mean rate of a flow that loses one packet in 1 / p.

    .. math::

        c\,\sqrt{\frac{\alpha}{p}}

    Parameters
    ----------
    increase, decrease : array_like
        alpha, in packets per unit of time squared (1 / RTT^2 for TCP Reno), and beta (1/2 for Reno).
    packet_loss : array_like
        p, decreases per packet sent, 0 < p <= 1.
    losses : {"periodic", "poisson", "per_packet"}
        When they come: at even distances, at the times of a Poisson process that does not care
        for the rate, or to each packet with the same probability.

    Returns
    -------
    ndarray
        Packets per unit of time.

    Notes
    -----
    With decreases at rate r = p * mean, the mean is (alpha / r) (beta / (1 - beta) + (1 + v) / 2). Here v
    is the squared coefficient of variation of the times between them (Altman et al., independent times).
    So c^2 = (1 + beta) / (2 (1 - beta)) for even ones, 3/2 for Reno (Mathis et al.), and 1 / (1 - beta)
    for Poisson ones.  A loss per packet hits fast flows more often; the moments of that process obey p (1
    - beta^k) E x^(k+1) = k alpha E x^(k-1), and their solution is

    .. math::

        c = \sqrt{\frac{2}{\pi}}\,(1 + \beta + \beta^3 + \beta^6 + \beta^{10} + ...),

    1.310 for Reno, as T. Ott, J. Kemperman and M. Mathis found in 1996 (The stationary behavior of ideal
    TCP congestion avoidance).  Neglects timeouts, slow start and the size of a packet: p must be small.
    """
    alpha, beta, lost = arguments(increase=increase, decrease=decrease, packet_loss=packet_loss)
    if losses == "periodic":
        factor = np.sqrt((1.0 + beta) / (2.0 * (1.0 - beta)))
    elif losses == "poisson":
        factor = np.sqrt(1.0 / (1.0 - beta))
    elif losses == "per_packet":
        factor = _per_packet_factor(beta)
    else:
        raise InputError.of("losses", losses, "'periodic', 'poisson' or 'per_packet'")
    return np.asarray(factor * np.sqrt(alpha / lost))


def _per_packet_factor(beta: FloatArray) -> FloatArray:
    """Evaluate the constant of the square-root law for losses that hit packets."""
    total, term, ratio = np.ones(beta.shape), beta.copy(), beta.copy()
    while (term > _NEGLIGIBLE).any():
        total = total + term
        ratio = ratio * beta
        term = term * ratio
    return np.asarray(np.sqrt(2.0 / np.pi) * total)
