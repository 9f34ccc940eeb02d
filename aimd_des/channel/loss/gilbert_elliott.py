"""Losses in bursts: a link that is good or bad, in continuous time.

A link is a Markov chain with two states.  In the bad one every copy is lost, in the good one none.
It turns bad at rate a and good at rate b.  With the mean loss p and the mean duration B of a burst,

    b = 1 / B,    a = b * p / (1 - p),    a + b = 1 / (B * (1 - p)),
    Pr(bad at t + h | state at t) = p + (1{bad at t} - p) * exp(-(a + b) * h),

so that the state is known exactly at the instants of broadcasts, and nowhere else is it needed.
E. N. Gilbert, "Capacity of a burst-noise channel", Bell System Technical Journal 39, 1960;
E. O. Elliott, "Estimates of error rates for codes on burst-noise channels", ibid. 42, 1963.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aimd_des.channel.loss.kernels import Cause, TabledLoss, loss_table
from aimd_des.channel.parameters import LONGEST, fit, scalar_or_row, take
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray


@built_in("loss", "gilbert_elliott")
@brief
@dataclass(frozen=True, eq=False)
class GilbertElliott:
    """Losses in bursts, on each agent's link for itself.

    A link is one for all resources: while it is bad, every signal is lost on it.  At the start of a
    run it is bad with the probability of mean loss.

    Parameters
    ----------
    mean_loss : float or array_like, shape (n,)
        Share of the time in which a link is bad, at least 0 and less than 1.
    mean_burst : float or array_like, shape (n,)
        Mean duration of a bad period, greater than 0, in units of time.
    """

    mean_loss: float | FloatArray
    mean_burst: float | FloatArray
    _each: ClassVar = ("mean_loss", "mean_burst")

    def __post_init__(self) -> None:
        always = "for links that lose everything use Bernoulli(1.0)"
        take(self, "mean_loss", low=0.0, high=1.0, high_open=True, remedy=always)
        take(self, "mean_burst", low=1.0 / LONGEST, high=LONGEST)
        fit(self, self._each)

    @property
    def mean(self) -> float | FloatArray:
        """Share of copies that are lost in the long run: the mean loss."""
        return scalar_or_row(self.mean_loss)

    @property
    def mean_gap(self) -> float | FloatArray:
        """Mean duration of a good period, in units of time; inf where nothing is lost."""
        loss = np.where(np.equal(self.mean_loss, 0.0), np.nan, self.mean_loss)
        gap = self.mean_burst * ((1.0 - loss) / loss)
        return scalar_or_row(np.where(np.isnan(loss), np.inf, gap))

    @property
    def rate(self) -> float | FloatArray:
        """A + b, the rate at which the past is forgotten, per unit of time."""
        return scalar_or_row(1.0 / (self.mean_burst * (1.0 - np.asarray(self.mean_loss))))

    def start(self, n_agents: int) -> TabledLoss:
        """Begin a run, with links as they are in the long run."""
        fit(self, self._each, n_agents)
        return TabledLoss(loss_table(Cause.BURSTS, n_agents, self.mean_loss, self.rate))
