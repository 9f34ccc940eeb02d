r"""What lost signals do: which optimum is reached, what agents can do about it, and what is survived.

The balance of an agent on which a signal is lost with probability p_i:

    continuous      alpha                  = rho * (1 - p_i) * (1 - beta) * Gamma * grad f_i
    discrete clock  alpha * (1 - e + e p_i) = e  * (1 - p_i) * (1 - beta) * Gamma * grad f_i

since on the clock a lost signal also costs the agent its hold: it grows in that step.  So it is a weight
times the derivative that agents agree on, and the averages are the optimum of weighted costs.
"""

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.demand import Dynamics
from aimd_des.dynamics.loss_compensation import compensation_factor
from aimd_des.theory.arguments import arguments, check_dynamics
from aimd_des.utils.errors import InputError
from aimd_des.utils.old_keywords import keywords
from aimd_des.utils.validation import FloatArray


def loss_weights(
    loss: npt.ArrayLike, signal_share: npt.ArrayLike = 0.0, believed: npt.ArrayLike = 0.0
) -> FloatArray:
    r"""Weights of the costs to which independent loss amounts.

    .. math::

        w_i = \frac{1 - p_i}{1 - e + e p_i}

    Parameters
    ----------
    loss : array_like
        p_i, the probability that a signal is lost on agent i.
    signal_share : array_like
        e, the share of steps with a signal, on the discrete clock; 0 for continuous agents, where the
        weights are 1 - p_i.
    believed : array_like
        q_i, what agents with `KnownLoss` or `EstimatedLoss` take their loss for; 0 for agents that do not
        compensate for loss.

    Returns
    -------
    ndarray
        Weights for `reweighted_optimum`; only their ratios matter.  For m resources give loss the shape
        (n, 1) and the share (m,).

    Notes
    -----
    Assumes that losses are independent of everything else, and no lambda above 1.  If all p_i are the
    same, so are the weights, and the shares stay as they are.  Neglects, as `signal_rate` does, that
    signals find an agent with a little more than its average.

    With a belief the weights are multiplied by the factor of the response probability. It is 1 / (1 -
    q_i) for continuous agents and s / (s - q_i) on the clock. There s = 1 - e + e p_i is the share of
    steps in which an agent grows, as an agent counts it.
    """
    p, e = arguments(loss=loss, signal_share=signal_share)
    weights = (1.0 - p) / (1.0 - e + e * p)
    (q,) = arguments(loss=believed)
    if q.any():
        heard, q = np.broadcast_arrays(e * (1.0 - p), q)
        pairs = zip(q.ravel().tolist(), heard.ravel().tolist(), strict=True)
        factor = [compensation_factor(own, share, 1.0, float(share > 0.0)) for own, share in pairs]
        weights = weights * np.reshape(factor, q.shape)
    return np.asarray(weights)


def compensated_probability(
    probability: npt.ArrayLike, loss: npt.ArrayLike, signal_share: npt.ArrayLike = 0.0
) -> FloatArray:
    r"""Response probability with which an agent compensates for the signals it loses.

    .. math::

        \lambda\,\frac{1 - e + e p_i}{(1 - e)(1 - p_i)}

    Parameters
    ----------
    probability : array_like
        lambda of the paper's equation (prob_x), 0 < lambda <= 1.
    loss : array_like
        p_i, as the agent knows it.
    signal_share : array_like
        e, the share of steps with a signal, on the discrete clock; 0 for continuous agents, where it
        is lambda / (1 - p_i).

    Returns
    -------
    ndarray
        The optimum is restored while this stays below 1, so it is not cut off here.

    Notes
    -----
    Undoes `loss_weights`, normalized so that an agent without loss changes nothing.  An agent that does
    not know e can put 1 - e (1 - p_i) = 1 - (the share of its own steps in which a signal came). The
    factor 1 / (1 - e) is the same for all; without it signals only are more frequent. On the clock lambda
    / (1 - p_i) alone leaves the weights 1 / (1 - e + e p_i).
    """
    chance, p, e = arguments(probability=probability, loss=loss, signal_share=signal_share)
    return np.asarray(chance * (1.0 - e + e * p) / ((1.0 - e) * (1.0 - p)))


@keywords("refractory")
def critical_loss(
    rate: npt.ArrayLike, dynamics: Dynamics = "continuous", *, hold_off: npt.ArrayLike = 0.0
) -> FloatArray:
    r"""Loss up to which the capacity is held, for continuous agents and on the clock.

    .. math::

        1 - \rho r \quad \mathrm{or} \quad \frac{1}{1 + \rho}

    Parameters
    ----------
    rate : array_like
        rho of `signal_rate` without loss, with mu at the optimum for all of the capacity.
    dynamics : {"continuous", "discrete"}
        Which agents.
    hold_off : array_like
        r, the least time between two signals: the hold-off, or the period of a control unit that
        samples.  Not used on the clock, where it is a step.

    Returns
    -------
    ndarray
        Probability of loss, the same for all agents; 0 where signals do not suffice even without.

    Notes
    -----
    Loss p makes rho / (1 - p) signals necessary, and there can be 1 / r; on the clock e cannot exceed 1.
    There more than the capacity is used at the limit, by (lag + 1) / 2 steps of growth, with a larger mu: a
    little more loss is survived than the formula says.  What is survived is a mean: near the limit the
    excess above capacity wanders widely, as a queue near saturation does.
    """
    check_dynamics(dynamics)
    rho, least = arguments(rate=rate, hold_off=hold_off)
    if dynamics == "discrete":
        return np.asarray(1.0 / (1.0 + rho))
    return np.maximum(1.0 - rho * least, 0.0)


@keywords("refractory")
def runaway_multiplier(
    increase: npt.ArrayLike,
    decrease: npt.ArrayLike,
    normalization: npt.ArrayLike,
    loss: npt.ArrayLike,
    dynamics: Dynamics = "continuous",
    *,
    hold_off: npt.ArrayLike = 0.0,
) -> FloatArray:
    r"""Find the derivative at which demand comes to rest beyond the critical loss.

    .. math::

        \mu = \frac{\alpha r}{(1 - p)(1 - \beta)\,\Gamma}

    Parameters
    ----------
    increase, decrease, normalization : array_like
        alpha, beta and Gamma, the same for all agents.
    loss : array_like
        Probability p that a signal is lost on an agent; > 0 on the clock.
    dynamics : {"continuous", "discrete"}
        Which agents.
    hold_off : array_like
        r > 0, the least time between two signals, for continuous agents.

    Returns
    -------
    ndarray
        mu, for `allocation_at`; on the clock p takes the place of r.

    Notes
    -----
    The control unit signals as often as it can, and the balance of growth and cuts is reached where the
    derivatives have grown to mu.  On the clock an agent grows only in the steps whose signal it loses.
    Holds while Gamma mu / x_i, the response probability there, is below 1; averages move towards it as
    slowly as all long-term averages do.
    """
    check_dynamics(dynamics)
    alpha, beta, gamma, p, least = arguments(
        increase=increase,
        decrease=decrease,
        normalization=normalization,
        loss=loss,
        hold_off=hold_off,
    )
    grown = p if dynamics == "discrete" else least
    if (grown <= 0.0).any():
        name = "loss" if dynamics == "discrete" else "hold_off"
        raise InputError.of(name, 0.0, "greater than 0", "otherwise demand cannot run away")
    return np.asarray(alpha * grown / ((1.0 - p) * (1.0 - beta) * gamma))
