"""Which copies of a signal never arrive."""

from aimd_des.channel.loss.base import Loss, LossProcess
from aimd_des.channel.loss.combined import Combined
from aimd_des.channel.loss.gilbert_elliott import GilbertElliott
from aimd_des.channel.loss.independent import Bernoulli, CommonMode
from aimd_des.channel.loss.trace import Trace

__all__ = ["Bernoulli", "Combined", "CommonMode", "GilbertElliott", "Loss", "LossProcess", "Trace"]
