"""The broadcast channel: what happens to the copies of a signal on their way to the agents."""

from aimd_des.channel.broadcast import (
    Broadcast,
    BroadcastChannel,
    Channel,
    CompiledLink,
    Copies,
    DrawnLink,
    Link,
)
from aimd_des.channel.random_draws import Draws

__all__ = [
    "Broadcast",
    "BroadcastChannel",
    "Channel",
    "CompiledLink",
    "Copies",
    "DrawnLink",
    "Draws",
    "Link",
]
