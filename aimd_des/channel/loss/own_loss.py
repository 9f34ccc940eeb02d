"""Losses of the user's own: how they are started and asked, laid out for compiled code, and checked."""

from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.channel.loss.base import Loss, LossProcess
from aimd_des.channel.loss.compiled_loss import address_of
from aimd_des.channel.loss.kernels import Cause, LossTable, TabledLoss, loss_table
from aimd_des.channel.parameters import MOST_PARAMETERS, rows_for
from aimd_des.channel.random_draws import Draws
from aimd_des.utils import returned_values, rng, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import BoolArray

_MOST_MEMORY = 100

# Broadcasts at which a compiled function is held against what its class draws, and the time between them.
_SAMPLES, _APART = 16, 0.75


def lost_table(lost: Any, n_agents: int, *parameters: npt.ArrayLike, memory: int = 0) -> LossTable:
    """Lay out a loss of the user's own for compiled code: what its method `table` returns.

    Parameters
    ----------
    lost : callable
        ``lost(u, time, *parameters) -> bool``, decorated with ``numba.njit``: whether the copy of one
        agent is lost. It takes a uniform number on [0, 1), the time at which the broadcast leaves and the
        parameters of the agent. If numbers are kept, ``memory`` is the last argument. The function is
        called for every broadcast, in the order of time. It is compiled into a loop over the agents, in
        which a division by zero gives inf or not a number, as in arrays.
    n_agents : int
        n, or the number of arcs of a network.
    *parameters : float or array_like, shape (n,)
        At most three.
    memory : int
        How many numbers the function keeps for each agent, 0 to 100: it gets an array of them, which begins
        with zeros and which it may write.

    Returns
    -------
    LossTable
        What compiled code reads.

    Raises
    ------
    InputError
        If there are too many parameters, one has another shape, or the function cannot be compiled or does
        not return a bool.
    """
    rows = rows_for(lost, n_agents, parameters)
    columns = validation.integer("memory", memory, low=0, high=_MOST_MEMORY)
    first, second, third = [*rows, 0.0, 0.0, 0.0][:MOST_PARAMETERS]
    address = address_of(lost, len(rows), columns)
    return loss_table(Cause.OWN, n_agents, first, second, third=third, address=address, columns=columns)


def draw_loss(loss: LossProcess, draws: Draws, of: str = "agent") -> BoolArray:
    """Ask a model of loss that may be the user's own."""
    said = returned_values.said_by(loss, "draw")
    with returned_values.calling(said):
        lost = loss.draw(draws)
    return returned_values.flags(said, lost, (draws.n_agents,), of)


def start_loss(loss: Loss, n_links: int) -> LossProcess:
    """Begin a run with a model of loss that may be the user's own."""
    process = _started(loss, n_links)
    # A class that is derived from one with a table, and starts in its own way, is asked itself.
    giver = next((of for of in type(loss).__mro__ if {"table", "start"} & vars(of).keys()), object)
    if "table" not in vars(giver):
        return process
    table = _table(loss, n_links)
    if not table.address.all():  # numba is told to compile nothing
        return process
    _check(loss, n_links)
    return TabledLoss(table)


def _started(loss: Loss, n_links: int) -> LossProcess:
    said = returned_values.said_by(loss, "start")
    with returned_values.calling(said):
        process = loss.start(n_links)
    returned_values.having(said, process, ["draw"])
    return process


def _table(loss: Any, n_links: int) -> LossTable:
    said = returned_values.said_by(loss, "table")
    with returned_values.calling(said):
        table = loss.table(n_links)
    return returned_values.instance(said, table, LossTable, "what lost_table() returns")


def _check(loss: Loss, n_links: int) -> None:
    """Hold the user's compiled function against what its class draws, each from the beginning of a run."""
    said, drawing = returned_values.said_by(loss, "table"), _started(loss, n_links)
    if hasattr(drawing, "attach"):
        raise InputError(f"{said} is for losses that do not read the run; what start() gives has attach()")
    tabled, keys = TabledLoss(_table(loss, n_links)), {purpose: rng.key(0, purpose) for purpose in Purpose}
    for number in range(_SAMPLES):
        draws = Draws(keys, 0, number, _APART * number, n_links)
        one, other = tabled.draw(draws), draw_loss(drawing, draws)
        wrong = np.flatnonzero(one != other)
        if len(wrong):
            agent = int(wrong[0])
            raise InputError.of(
                f"{said}[{agent}] at time {draws.time:g}",
                bool(one[agent]),
                f"{bool(other[agent])} as the draw() of what start() gives has it",
                "make both of one formula, and of draws.uniforms(Purpose.LOSS) and draws.time",
            )
