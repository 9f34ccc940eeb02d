"""A run watched while it goes on: what is looked at, and how a terminal or a log shows it."""

from aimd_des.watch.keys import NoKeys, keyboard
from aimd_des.watch.monitor import Monitor, Snapshot, last_snapshot
from aimd_des.watch.terminal import LiveView, PlainView, View

__all__ = ["LiveView", "Monitor", "NoKeys", "PlainView", "Snapshot", "View", "keyboard", "last_snapshot"]
