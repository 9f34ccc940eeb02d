"""How agents answer a capacity signal: what `response=` takes."""

from aimd_des.dynamics.responses import Derandomised, EventNormalised, Randomised, Response

__all__ = ["Derandomised", "EventNormalised", "Randomised", "Response"]
