"""What a run has come to before its measures begin, so that they can leave it out."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from aimd_des.dynamics.averaging import CUMULATIVE, age_at
from aimd_des.engine.system import System
from aimd_des.results.run_data import Account, Rest
from aimd_des.utils.validation import FloatArray, IntArray


class _Before(NamedTuple):
    """Where a run stood when its measures began."""

    time: float
    moment: FloatArray  # (n,) or (1,): where the agents were in their own time
    numbers: IntArray  # (m,): signals
    copies: IntArray  # (5, m, n): delivered, lost, duplicated, responses, saturated
    # (m, n): for how long agents had averaged, in their own time, and their averages times that.
    age: FloatArray
    accumulated: FloatArray


class LeftOut:
    """The beginning of a run that its measures leave out; nothing unless it is asked for."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.before: _Before | None = None
        system.parts["left_out"] = self

    def begin(self) -> None:
        """Let the measures begin now."""
        system = self.system
        _, average = system.allocations()
        age = self._age()
        moment, numbers = system.moments().copy(), system.transmitter.numbers.copy()
        self.before = _Before(system.env.now, moment, numbers, self._copies(), age, average * age)

    def rest(self) -> Rest | None:
        """Return what has happened since then, at the end of a run; None where nothing is left out."""
        if self.before is None:
            return None
        before, system = self.before, self.system
        delivered, lost, duplicated, responses, saturated = self._copies() - before.copies
        signals = system.transmitter.numbers - before.numbers
        in_flight = signals[:, None] - delivered - lost
        account = Account(delivered, lost, in_flight, duplicated, responses, saturated)
        return Rest(before.time, signals, account, self._average(before).T)

    def _average(self, before: _Before) -> FloatArray:
        """Average demand since then: what the averages of the paper would be, had they begun then."""
        _, average = self.system.allocations()
        # Other averages forget by themselves what was before.
        if self.system.parameters.averaging.kind != CUMULATIVE:
            return average
        age = self._age()
        length = age - before.age
        # An agent that began anew in the meantime has an average of its own; one that was away has none.
        own = (self.system.state.origin > before.moment) | (length <= 0.0)
        since = (average * age - before.accumulated) / np.where(own, 1.0, length)
        return np.where(own, average, since)

    def _age(self) -> FloatArray:
        system, state = self.system, self.system.state
        now = np.minimum(system.moments(), state.pause)
        return np.asarray(age_at(now, state.origin, system.tick_weight))  # type: ignore[arg-type]

    def _copies(self) -> IntArray:
        account, state = self.system.transmitter, self.system.state
        columns = (account.delivered, account.lost, account.duplicated, state.responses, state.saturated)
        return np.array(columns)

    def state(self) -> dict[str, Any]:
        """Return what is left out."""
        return {"before": None if self.before is None else tuple(self.before)}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self.before = None if state["before"] is None else _Before(*state["before"])
