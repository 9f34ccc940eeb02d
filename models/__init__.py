"""Systems to allocate for: each a function, registered by name, that returns a `Problem`."""

from models.classic_aimd import classic_aimd
from models.ev_charging import ev_charging
from models.random_convex import random_convex
from models.smart_cameras import smart_cameras
from models.tcp_flows import tcp_flows

__all__ = ["classic_aimd", "ev_charging", "random_convex", "smart_cameras", "tcp_flows"]
