"""Which copies of a signal never arrive: the models that `BroadcastChannel` takes."""

from aimd_des.channel.loss import Bernoulli, Combined, CommonMode, GilbertElliott, Loss, LossProcess, Trace

__all__ = ["Bernoulli", "Combined", "CommonMode", "GilbertElliott", "Loss", "LossProcess", "Trace"]
