"""Networks over which broadcasts travel: graphs, and the channels that they are turned into."""

from aimd_des.channel.topology import *  # noqa: F403 - the package says what it hands out
from aimd_des.channel.topology import __all__  # noqa: F401
