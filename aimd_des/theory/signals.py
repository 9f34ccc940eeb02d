r"""Signals and what they buy: how often the bit is sent, and how well the capacity is used.

All follow from one balance: in the long run an agent gives back what it adds.  With mu the
derivative of the costs that the agents have in common at their averages, an agent that is reached by
a signal gives back (1 - beta) * lambda_i * x_i = (1 - beta) * Gamma * mu in the mean, for any share:

    alpha = rho * (1 - beta) * Gamma * mu     with rho the signals per unit of time.

Sources: the paper, eqs. (AI), (MD) and (prob_x); M. Corless, C. King, R. Shorten and F. Wirth, AIMD
Dynamics and Distributed Resource Allocation, SIAM, 2016, for the model; the rest is derived here.
"""

import numpy as np
import numpy.typing as npt

from aimd_des.theory.arguments import arguments
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


def signal_rate(
    increase: npt.ArrayLike,
    decrease: npt.ArrayLike,
    normalization: npt.ArrayLike,
    multiplier: npt.ArrayLike,
    loss: npt.ArrayLike = 0.0,
) -> FloatArray:
    r"""Signals per unit of time among continuous agents.

    .. math::

        \rho = \frac{\alpha}{(1 - \beta)\,\Gamma \mu\,(1 - p)}

    Parameters
    ----------
    increase, decrease, normalization : array_like
        alpha, beta and Gamma, the same for all agents.
    multiplier : array_like
        mu, the derivative that all agents have in common at the averages in force: that of the optimum
        for the capacity actually used, not for all of it.
    loss : array_like
        Probability p that a signal is lost on an agent, the same for all: each is worth 1 - p of one.

    Returns
    -------
    ndarray
        rho, per unit of time.

    Notes
    -----
    Assumes that signals find an agent with its time average.  They come when the total is at its highest,
    so they find it with about alpha / (2 rho) more. So rho is too high by about (1 - beta) lambda / 2,
    with lambda the mean response probability; `predict` corrects this.  Assumes too that no lambda is cut
    off at 1, and that no hold-off or period forces signals apart: rho * hold_off < 1.
    """
    alpha, beta, gamma, mu, p = arguments(
        increase=increase, decrease=decrease, normalization=normalization, multiplier=multiplier, loss=loss
    )
    return np.asarray(alpha / ((1.0 - beta) * gamma * mu * (1.0 - p)))


def signal_share(rate: npt.ArrayLike, loss: npt.ArrayLike = 0.0) -> FloatArray:
    r"""Share of steps with a signal on the discrete clock, at most 1.

    .. math::

        e = \frac{\rho}{(1 + \rho)(1 - p)}

    Parameters
    ----------
    rate : array_like
        rho of `signal_rate` without loss: signals per step of growth.
    loss : array_like
        Probability p that a signal is lost on an agent, the same for all.

    Returns
    -------
    ndarray
        e, a pure number.  1 from the critical loss on.

    Notes
    -----
    An agent does not grow in the step in which it takes a signal: 1 - e (1 - p) steps of growth stand
    against e (1 - p) signals, and their ratio is rho.  Neglects what `signal_rate` neglects.
    """
    rho, p = arguments(rate=rate, loss=loss)
    return np.minimum(rho / ((1.0 + rho) * (1.0 - p)), 1.0)


def utilisation(
    n_agents: npt.ArrayLike,
    decrease: npt.ArrayLike,
    normalization: npt.ArrayLike,
    multiplier: npt.ArrayLike,
    capacity: npt.ArrayLike,
) -> FloatArray:
    r"""Share of the capacity that is used without latency.

    .. math::

        1 - \frac{n (1 - \beta)\,\Gamma \mu}{2 C}

    Parameters
    ----------
    n_agents : array_like
        n.
    decrease, normalization : array_like
        beta and Gamma, the same for all agents.
    multiplier : array_like
        mu, the derivative that all agents have in common at the averages in force.
    capacity : array_like
        C, in units of the resource (times the threshold, if that is not 1: the share is of that then).

    Returns
    -------
    ndarray
        A pure number; below 0 where the formula does not hold any more.

    Notes
    -----
    Total demand is a sawtooth between C and what one signal leaves of it; the formula is its mean, and
    alpha drops out.  For continuous agents, control by exact crossings, no latency, and sawtooths of equal
    height.  The heights are random: with variance V of what a signal takes, V / (2 D C) is lost besides, D
    being the mean of it; that is of the order 1 / n.  On the discrete clock, and where the control unit only
    samples, overshoot adds to it: see `clock_offset`.
    """
    n, beta, gamma, mu, total = arguments(
        n_agents=n_agents,
        decrease=decrease,
        normalization=normalization,
        multiplier=multiplier,
        capacity=capacity,
    )
    return np.asarray(1.0 - n * (1.0 - beta) * gamma * mu / (2.0 * total))


def price_in_bits(n_agents: npt.ArrayLike, increase: npt.ArrayLike, capacity: npt.ArrayLike) -> FloatArray:
    r"""Product of the signalling rate and of the idle share of the capacity.

    .. math::

        (1 - \mathrm{utilisation})\,\rho = \frac{n \alpha}{2 C}

    Parameters
    ----------
    n_agents : array_like
        n.
    increase : array_like
        alpha, the mean of the agents' where they differ.
    capacity : array_like
        C, in units of the resource.

    Returns
    -------
    ndarray
        Bits per unit of time, times the share of the capacity that lies idle: to halve the idle share takes
        twice the signals, for any costs.

    Notes
    -----
    The sawtooth of `utilisation` falls by D = n alpha / rho at each signal and lacks D / 2 in the mean.
    Costs and probabilities have dropped out: for continuous agents that is exact except for the random
    heights of the sawtooth, which raise the price by their squared coefficient of variation.
    """
    n, alpha, total = arguments(n_agents=n_agents, increase=increase, capacity=capacity)
    return np.asarray(n * alpha / (2.0 * total))


def peak_lift(
    n_agents: npt.ArrayLike,
    increase: npt.ArrayLike,
    latency: npt.ArrayLike,
    period: npt.ArrayLike = 0.0,
) -> FloatArray:
    r"""How far total demand rises above its threshold before a signal acts.

    .. math::

        n \alpha\,(d + \mathrm{period})

    Parameters
    ----------
    n_agents : array_like
        n.
    increase : array_like
        alpha, the mean of the agents' where they differ.
    latency : array_like
        d, common to all agents, in units of time.
    period : array_like
        Time between two samples of a control unit that samples; 0 for one that senses the crossing.

    Returns
    -------
    ndarray
        In units of the resource: every peak for exact crossings, the highest one for samples.

    Notes
    -----
    All agents go on growing for d after the crossing.  Exact for continuous agents whenever one signal
    brings demand back below the threshold. Where a small cut makes a second one necessary, that peak is
    higher by the growth over the hold-off, less the first cut.  On the discrete clock the latency counts
    in whole steps, rounded up, and the period is 1.  Of latencies that differ see `mixture_lift`.
    """
    n, alpha, delay, look = arguments(n_agents=n_agents, increase=increase, latency=latency, period=period)
    return np.asarray(n * alpha * (delay + look))


def mixture_lift(increase: npt.ArrayLike, latency: npt.ArrayLike, rate: float, hold_off: float) -> float:
    r"""How far total demand rises above its threshold where agents hear at different times.

    .. math::

        \max_{t \ge 0} \sum_{i} \alpha_i \left(t - \frac{\max(t - d_i, 0)}{\rho r}\right)

    Parameters
    ----------
    increase : array_like, shape (n,)
        alpha_i; a number stands for all agents.
    latency : array_like, shape (n,)
        d_i >= 0, the same for all copies that an agent hears, in units of time.
    rate : float
        rho, the signals per unit of time that are needed at the capacity (`needed_rate`).
    hold_off : float
        r > 0, of a control unit that senses crossings; rho r must be below 1.

    Returns
    -------
    float
        In units of the resource.

    Raises
    ------
    InputError
        If an argument is outside its range, or signals do not suffice.

    Notes
    -----
    In balance agent i gives back alpha_i / rho at each signal that it hears.  While demand is above the
    threshold there are 1 / r of them per unit of time. The total rises at the rate sum_i alpha_i (1 -
    [d_i < t] / (rho r)), until the share rho r of the growth belongs to agents that hear. If all
    latencies are d, it is n alpha d; a mixture is milder than its mean.  For continuous agents and a
    crossing with nothing on its way, in the mean.  Neglects what is still on its way from crossings
    before, which lowers the peak. Neglects too that agents that hear first are emptied while the others
    wait; that raises the peak unless the longest latency is short beside r / ((1 - beta) lambda).

    Examples
    --------
    >>> mixture_lift(0.5, [2.0, 2.0], rate=0.5, hold_off=1.0), mixture_lift(0.5, [0.0, 4.0], 0.5, 1.0)
    (2.0, 0.0)
    """
    alpha, delay = arguments(increase=increase, latency=latency)
    needed = validation.number("rate", rate, low=0.0, low_open=True)
    pause = validation.number("hold_off", hold_off, low=0.0, low_open=True)
    if needed * pause >= 1.0:
        raise InputError.of("hold_off", hold_off, f"below 1 / rate = {1.0 / needed:g}: signals must suffice")
    # The sum is concave in t and bends at latencies only.
    bends = np.append(0.0, np.unique(delay))
    heard = np.maximum(bends[:, None] - delay.ravel(), 0.0) / (needed * pause)
    return float((alpha.ravel() * (bends[:, None] - heard)).sum(axis=1).max())


def clock_offset(share: npt.ArrayLike, lag: int = 0) -> FloatArray:
    r"""Mean of total demand above its threshold on the discrete clock, in steps of growth of all agents.

    Parameters
    ----------
    share : array_like
        e, the share of steps with a signal, 0 < e <= 1.
    lag : int
        Steps after which a signal acts: 0, 1 as the paper's algorithms are printed, or more.

    Returns
    -------
    ndarray
        F, negative where the capacity is not used up: utilisation is threshold + F * n alpha / C.

    Notes
    -----
    Total demand rises by 1 (in units of n alpha) in steps without and falls by d = (1 - e) / e in steps
    with a signal.  Because its square does not drift either, it is d / 2 lower in the mean over all steps
    than over those in which a signal acts.  For d >= 1 the step that crosses the threshold ends evenly
    spread over (0, 1] above it; v = that + lag is reached before the first cut. As cuts act `lag` steps
    late there are N = lag + ceil(v / d) of them, at v, v - d, ..., and so

    .. math::

        F = \frac{E[N v - d N (N - 1) / 2]}{E[N]} - \frac{d}{2}

    with v uniform on (lag, lag + 1].  For d < 1 rise and fall change places: F(d) = -d F(1 / d).
    Without lag F = (1 - d) / 2; with lag 1 and e <= 1/3 it is F = 3/2 - d.  Neglects that cuts are random
    (`predict` adds that); the even spread is exact without lag, and good to a few tenths with a long one.

    Examples
    --------
    >>> clock_offset([0.25, 0.5], lag=1).tolist()
    [-1.5, 0.0]
    """
    steps = validation.integer("lag", lag, low=0)
    (shares,) = arguments(share=share)
    drop = (1.0 - shares) / shares
    return np.array([_offset(float(value), steps) for value in drop.ravel()]).reshape(drop.shape)


def _offset(drop: float, lag: int) -> float:
    """Evaluate F at d = `drop`."""
    if drop == 0.0:
        return 0.5 * (lag + 1)  # the limit
    if drop < 1.0:
        return -drop * _offset(1.0 / drop, lag)
    later = np.arange(1, lag + 2)  # ceil(v / d) where d >= 1
    low, high = (np.clip(edge * drop, lag, lag + 1) for edge in (later - 1, later))
    width, cuts = high - low, lag + later
    sums = 0.5 * cuts * (high**2 - low**2) - 0.5 * drop * cuts * (cuts - 1) * width
    return float(sums.sum() / (cuts * width).sum() - 0.5 * drop)
