"""Which copies of a signal never arrive: the models that `BroadcastChannel` takes."""

from aimd_des.channel.loss import *  # noqa: F403 - the package says what it hands out
from aimd_des.channel.loss import __all__  # noqa: F401
