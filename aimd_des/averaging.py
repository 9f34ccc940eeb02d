"""How agents average their demand: what `averaging=` takes."""

from aimd_des.dynamics.averaging import Averaging, Cumulative, Forgetting, Polynomial, Window

__all__ = ["Averaging", "Cumulative", "Forgetting", "Polynomial", "Window"]
