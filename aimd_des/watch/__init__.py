"""A run watched while it goes on: what is looked at, and how a terminal or a log shows it."""

from aimd_des.watch.monitor import Look, Looker, last_look
from aimd_des.watch.terminal import LiveView, PlainView, View

__all__ = ["LiveView", "Look", "Looker", "PlainView", "View", "last_look"]
