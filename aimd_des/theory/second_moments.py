r"""How far averages of single runs scatter: second moments of the averages about their mean.

At a signal agent i's own cut is off its mean by Xi_i, independent of all others.  Let Z_i be by how much the
demands that signals find are off their mean, and tau the growth that makes up for cuts, of which the agent
has the part a_i.  Summed over many signals they balance,

    0 = Xi_i - kappa_i Z_i + a_i tau,    sum_i Z_i = 0,

and averages over time see Z_i - a_i tau / 2: noise of the strength Q = Cov / signals per unit of time, for
fixed response probabilities.  These follow the averages theta.  With W = theta / f', H the Hessian of the
costs and P the projection that keeps the totals, to first order in kappa,

    d theta / dt = -r (P W H theta - noise),

whose modes die away like exp(-s int r dt).  The covariance in modes i and j is that of the noise times

    int r(u)^2 exp(-(s_i + s_j) int_u^t r) du.

Source: stochastic approximation, for example V. S. Borkar, Stochastic Approximation, 2008; P and Q are
derived in docs/convergence.md.
"""

from typing import NamedTuple

import numpy as np

from aimd_des.dynamics.responses import AVERAGE, FULL
from aimd_des.theory.mean_dynamics import Memory, first_signals
from aimd_des.theory.prediction import Steady, lost_steps
from aimd_des.theory.setting import Setting
from aimd_des.utils.validation import FloatArray

# Frequencies of a window of length 1, and into how many steps they are cut.
_BAND, _FINE = 400.0, 8000
# Relative, between elements of a matrix and of its transpose.
_SYMMETRIC = 1e-9
# In time constants: what was averaged before no longer counts.
_FORGOTTEN = 500.0


class Modes(NamedTuple):
    """Independent deviations of the averages of a block of agents and resources."""

    exponent: FloatArray  # (b, q): s, of b blocks with q modes each
    shape: FloatArray  # (b, k, q): what a mode is in the k averages of a block
    noise: FloatArray  # (b, q, q): covariance of the noise in modes, times time
    # Since when there is noise, and how long agents take to find new shares.
    start: float
    settling: float

    def covariance(self, memory: Memory, time: float) -> FloatArray:
        """Compute the covariance of the averages at a time, (b, k, k)."""
        back = self.shape.conj().transpose(0, 2, 1)
        return np.asarray((self.shape @ self._of_modes(memory, time) @ back).real)

    def variance(self, memory: Memory, time: float) -> FloatArray:
        """Compute the variance alone, (b, k)."""
        half = self.shape @ self._of_modes(memory, time)
        return np.asarray((half * self.shape.conj()).sum(axis=2).real)

    def _of_modes(self, memory: Memory, time: float) -> FloatArray:
        """Compute the covariance of the modes, (b, q, q)."""
        pair = self.exponent[:, :, None], self.exponent.conj()[:, None, :]
        return np.asarray(self.noise * remaining(memory, *pair, self.start, self.settling, time))


def _power(ratio: float, exponent: FloatArray) -> FloatArray:
    """Compute (1 - ratio**exponent) / exponent, and its limit where the exponent is 0."""
    small = np.abs(exponent) < 1e-9
    safe = np.where(small, 1.0, exponent)
    return np.where(small, -np.log(ratio), (1.0 - ratio**safe) / safe)


def remaining(
    memory: Memory, s: FloatArray, t: FloatArray, start: float, settling: float, time: float
) -> FloatArray:
    """Integrate what is left at `time` of noise of strength 1 since `start`, in modes with exponents s and t.

    Notes
    -----
    A cut at u changes demand until about u + `settling`, and counts as if it came then.  Of the last cuts
    only a part has been averaged: that is as if there were none for the last 3 / 2 `settling`.
    """
    both, begin, end = s + t, start + settling, time - 0.5 * settling
    if end <= begin:
        return np.zeros(both.shape)
    if memory.time_constant is not None:
        tau = memory.time_constant + settling
        ratio = float(np.exp((begin - end) / tau) * np.expm1(-begin / tau) / np.expm1(-end / tau))
        old = (1.0 - ratio**both) / both
        if end > _FORGOTTEN * tau:
            return np.asarray(old / tau)
        return np.asarray((old + _power(ratio, both - 1.0) / np.expm1(end / tau)) / tau)
    if memory.window is not None and time > memory.window:
        return np.stack([_window(*pair) for pair in zip(s[:, :, 0], t[:, 0], strict=True)]) / memory.window
    power = memory.gain * both - 1.0
    return np.asarray(memory.gain**2 / time * (end / time) ** power * _power(begin / end, power))


def _window(s: FloatArray, t: FloatArray) -> FloatArray:
    """Integrate the noise that a window of length 1 keeps, with its feedback 1 - s on demand: (q, q)."""
    step = _BAND / _FINE
    omega = (np.arange(_FINE) + 0.5) * step
    seen = -np.expm1(-1j * omega) / (1j * omega)
    first, second = (seen / (1.0 - (1.0 - e[:, None]) * seen) for e in (s, t.conj()))
    # Both signs of omega; beyond the band all modes see 2 / omega^2 in the mean.
    inside = (first @ second.conj().T).real * step / np.pi
    return np.asarray(inside + 2.0 / (np.pi * _BAND))


def modes_of(setting: Setting, steady: Steady, columns: slice, together: bool) -> Modes:
    """Find the modes of all agents together, or of each by itself, for some resources."""
    linear, noise = _linear(setting, steady, columns), _noise(setting, steady, together)
    settling = 1.0 / float((steady.keep * steady.hit * steady.signals)[:, columns].mean())
    start = float(first_signals(setting, steady)[columns].max())
    if not together:
        return Modes(*_one_by_one(linear, noise[:, columns]), start, settling)
    return Modes(*_all_together(linear, noise[columns]), start, settling)


class _Linear(NamedTuple):
    """The mean dynamics near where averages settle, for some resources: columns of (n, m), (n, m, m)."""

    follows: FloatArray  # by how much averages follow what signals find
    answer: FloatArray  # what that makes of a derivative that changes: follows E y / f'
    plain: FloatArray  # at what rate averages are left behind where derivatives stay as they are
    found: FloatArray
    gradient: FloatArray
    hessian: FloatArray


def _linear(setting: Setting, steady: Steady, columns: slice) -> _Linear:
    """Linearise the mean dynamics.

    Notes
    -----
    For the paper's divisor y = c theta / f', and averages over time are m(y). Deviations of theta die
    away at the rates of 1 - m' y / theta + m' y / f' H, in place of 1 - 1 + theta / f' H to first order.
    Where lambda has the demand that signals find below it, that settles by itself, and m' y / f' H is
    left.
    """
    problem, average, found = setting.problem, steady.average[:, columns], steady.found[:, columns]
    gradient = problem.costs.gradient(steady.average)[:, columns]
    hessian = problem.costs.hessian(steady.average)[:, columns, columns]
    follows = np.ones_like(average) if setting.following is None else setting.following.mean[:, columns]
    follows = follows - float(_own_cut(setting, steady)[:, columns].mean())
    plain = np.zeros_like(average)
    if setting.response.divisor == AVERAGE:
        plain = 1.0 - follows * found / (found if setting.response.cut == FULL else average)
    return _Linear(follows, follows * found / gradient, plain, found, gradient, hessian)


def _one_by_one(linear: _Linear, noise: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find exponents, shapes and noise of each agent's own modes, as in `Modes`."""
    root, one = np.sqrt(linear.answer), np.eye(noise.shape[1])
    own = root[:, :, None] * linear.hessian * root[:, None, :] + linear.plain[:, :, None] * one
    exponent, vectors = np.linalg.eigh(own)
    back = vectors.transpose(0, 2, 1) / root[:, None, :]
    spread = back @ (noise[:, :, None] * one) @ back.transpose(0, 2, 1)
    return exponent, root[:, :, None] * vectors, spread


def _all_together(linear: _Linear, noise: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find exponents, shapes and noise of the modes that leave each total as it is, as in `Modes`."""
    n, m = linear.found.shape
    # In multiples of these what the balance gives to keep a total is at right angles to what leaves it.
    weights = linear.follows * np.sqrt(linear.found / linear.gradient.mean(axis=0))
    full, strength = np.zeros((2, n, m, n, m))
    own = (linear.answer / weights)[:, :, None] * linear.hessian * weights[:, None, :]
    full[np.arange(n), :, np.arange(n), :] = own + linear.plain[:, :, None] * np.eye(m)
    for j in range(m):
        strength[:, j, :, j] = noise[j]
    full, strength = full.reshape(n * m, n * m), strength.reshape(n * m, n * m)
    totals = np.sqrt(linear.found).reshape(-1, 1) * np.tile(np.eye(m), (n, 1))
    rest = np.linalg.qr(np.column_stack([totals, np.eye(n * m)]))[0][:, m:]
    within = rest.T @ full @ rest
    if np.allclose(full, full.T, rtol=_SYMMETRIC, atol=0.0):
        exponent, vectors = np.linalg.eigh(within)
        back = vectors.T
    else:
        exponent, vectors = np.linalg.eig(within)
        back = np.linalg.inv(vectors)
    back = back @ (rest / weights.reshape(-1, 1)).T
    shape, spread = weights.reshape(-1, 1) * (rest @ vectors), back @ strength @ back.conj().T
    return exponent[None], shape[None], spread[None]


def _own_cut(setting: Setting, steady: Steady) -> FloatArray:
    """Compute how much less averages follow what signals find, because of agents' own cuts, (n, m).

    Notes
    -----
    The interval after an agent's own cut is longer by d y_i / sum(alpha), and the agent begins it with
    less. So the mean over time contains Cov(T, B_i y_i) / E T = -a_i d (1 - q) E y_i^2 / E y_i. Here cuts
    of the part d are made with the probability q, and a_i is the part of the growth. Twice that is its
    derivative by E y_i.
    """
    growth = setting.problem.increase
    return np.asarray(2.0 * growth / growth.sum(axis=0) * steady.keep * (1.0 - steady.hit))


def _noise(setting: Setting, steady: Steady, together: bool) -> FloatArray:
    """Compute the strength of the noise: (m, n, n), or (n, m) where agents are taken one by one."""
    keep, hit, loss = steady.keep, steady.hit, setting.loss
    kappa = keep * hit
    if setting.response.cut == FULL:  # cuts come at regular numbers of the signals that are received
        hit = np.broadcast_to(1.0 - loss, kappa.shape)
        keep = kappa / hit
    kicks = keep**2 * hit * (1.0 - hit) * steady.square + lost_steps(setting, kappa, steady.found)
    growth = setting.problem.increase
    follows = np.ones_like(kappa) if setting.following is None else setting.following.noise
    if not together:
        return np.asarray(follows**2 * kicks / (kappa**2 * steady.signals))
    part, less = growth / growth.sum(axis=0), _own_cut(setting, steady)
    columns = []
    for j in range(growth.shape[1]):
        inverse, made_up = 1.0 / kappa[:, j], part[:, j] / kappa[:, j]
        extra = inverse / made_up.sum()  # -tau is this times Xi
        seen = (follows - less)[:, j, None]
        answer = seen * (np.diag(inverse) - np.outer(made_up, extra)) + 0.5 * np.outer(part[:, j], extra)
        columns.append((answer * kicks[:, j]) @ answer.T / steady.signals[j])
    return np.stack(columns)
