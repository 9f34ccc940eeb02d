"""How long the copies of a signal are on their way: the models that `BroadcastChannel` takes."""

from aimd_des.channel.latency import *  # noqa: F403 - the package says what it hands out
from aimd_des.channel.latency import __all__  # noqa: F401
