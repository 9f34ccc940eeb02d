"""The broadcast channel: what happens to the copies of a signal on their way to the agents."""

from aimd_des.channel.broadcast import Broadcast, BroadcastChannel, Channel

__all__ = ["Broadcast", "BroadcastChannel", "Channel"]
