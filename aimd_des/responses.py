"""How agents answer a capacity signal: what `response=` takes."""

from aimd_des.dynamics.custom_response import CustomResponse
from aimd_des.dynamics.responses import Derandomised, EventNormalised, Randomised, Response

__all__ = ["CustomResponse", "Derandomised", "EventNormalised", "Randomised", "Response"]
