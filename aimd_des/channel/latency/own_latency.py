"""Latencies of the user's own: how they are asked, laid out for compiled code, and checked."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.channel.latency.base import Latency
from aimd_des.channel.latency.compiled_quantile import address_of
from aimd_des.channel.latency.kernels import Distribution, LatencyTable, latency_table, quantile_row
from aimd_des.channel.parameters import rows_for
from aimd_des.channel.random_draws import Draws
from aimd_des.utils import returned_values
from aimd_des.utils.errors import InputError
from aimd_des.utils.rng import Key, Purpose
from aimd_des.utils.validation import FloatArray

# Two ways to write one formula differ by roundings, and a little more where they nearly cancel.
_TOLERANCE = 1e-9


def draw_latency(latency: Latency, draws: Draws, of: str = "agent") -> FloatArray:
    """Ask a model of latency that may be the user's own."""
    said = returned_values.said_by(latency, "draw")
    with returned_values.calling(said):
        drawn = latency.draw(draws)
    return returned_values.numbers(said, drawn, (draws.n_agents,), of, 0.0)


def quantile_table(quantile: Callable[..., float], n_agents: int, *parameters: npt.ArrayLike) -> LatencyTable:
    """Lay out a latency of the user's own for compiled code: what its method `table` returns.

    Parameters
    ----------
    quantile : callable
        ``quantile(u, *parameters) -> float``, decorated with ``numba.njit``: the latency, at least 0 and in
        units of time, for a uniform number on [0, 1) and the parameters of one agent. `exp` and `log` of
        `aimd_des.lowlevel` can be called in it. It is compiled into a loop over the agents, in which a
        division by zero gives inf or not a number, as in arrays.
    n_agents : int
        n, or the number of arcs of a network.
    *parameters : float or array_like, shape (n,)
        At most three.

    Returns
    -------
    LatencyTable
        What compiled code reads.

    Raises
    ------
    InputError
        If there are too many parameters, one has another shape, or the function cannot be compiled.
    """
    rows = rows_for(quantile, n_agents, parameters)
    address = address_of(quantile, len(rows))
    return latency_table(Distribution.OWN, n_agents, *rows, quantile=address)


def compiled_latency(latency: Latency, n_links: int, keys: Mapping[Purpose, Key]) -> LatencyTable | None:
    """Lay out a model for compiled code; None where only its `draw` says what it is."""
    # A class that is derived from one with a table, and draws in its own way, is asked itself.
    giver = next((of for of in type(latency).__mro__ if {"table", "draw"} & vars(of).keys()), object)
    if "table" not in vars(giver):
        return None
    model: Any = latency
    said = returned_values.said_by(latency, "table")
    allowed = "what quantile_table() returns"
    with returned_values.calling(said):
        table = model.table(n_links)
    table = returned_values.instance(said, table, LatencyTable, allowed)
    if table.distribution != Distribution.OWN:
        return table
    return _checked(latency, table, Draws(keys, 0, 0, 0.0, n_links)) if table.quantile else None


def _checked(latency: Latency, table: LatencyTable, draws: Draws) -> LatencyTable:
    """Hold the user's compiled function against what its class draws for one broadcast, and its ends."""
    said = returned_values.said_by(latency, "table")
    shape = (draws.n_agents,)
    for u in (0.0, 0.5, float(np.nextafter(1.0, 0.0))):  # the least and the largest uniform number
        out = np.full(shape, u)
        quantile_row(table, out)
        returned_values.numbers(f"{said} at u = {u:g}", out, shape, "agent", 0.0)
    out = draws.uniforms(Purpose.LATENCY)
    quantile_row(table, out)
    drawn = draw_latency(latency, draws)
    wrong = np.flatnonzero(~np.isclose(out, drawn, rtol=_TOLERANCE, atol=0.0))
    if len(wrong):
        agent = int(wrong[0])
        raise InputError.of(
            f"{said}[{agent}]",
            float(out[agent]),
            f"{float(drawn[agent])!r} as {returned_values.said_by(latency, 'draw')} has it",
            "make both of one formula, and of draws.uniforms(Purpose.LATENCY)",
        )
    return table
