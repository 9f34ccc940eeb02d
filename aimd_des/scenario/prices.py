"""Prices as data: private costs that the scenario's own model draws again and again."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from aimd_des.interventions import Prices
from aimd_des.problem.costs import Costs
from aimd_des.scenario.models import made_by, model_parameters
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in


def redraw_seed(seed: int, number: int) -> int:
    """Derive the seed of the redraw with a number, at least 1, from the scenario's."""
    return int(np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1, np.uint64)[0])


@built_in("intervention", "prices")
@dataclass(frozen=True)
class RedrawnPrices:
    """The private costs of all agents are drawn anew by the scenario's model at given intervals.

    Parameters
    ----------
    every : float
        The interval, greater than 0: the k-th costs hold from k * every on.
    parameter : str
        The parameter of the model that decides the draw, which gets a seed of its own for each k; its name
        has "seed" in it.

    Raises
    ------
    InputError
        If the interval is not positive, or the parameter is called as if it were no seed.
    """

    every: float
    parameter: str = "seed"

    def __post_init__(self) -> None:
        object.__setattr__(self, "every", validation.number("every", self.every, low=0.0, low_open=True))
        if "seed" not in self.parameter:
            raise InputError.of("parameter", self.parameter, "one that takes a seed, with 'seed' in its name")

    def by(self, model: str, parameters: Mapping[str, Any], seed: int) -> Prices:
        """Let a registered model draw them, with a seed of its own for each redraw."""
        complete = model_parameters(model, {**parameters, self.parameter: seed}, seed)

        @lru_cache(maxsize=1)  # checks ask for the first one again and again
        def draw(k: int) -> Costs:
            return made_by(model, {**complete, self.parameter: redraw_seed(seed, k)}).costs

        return Prices(self.every, draw)
