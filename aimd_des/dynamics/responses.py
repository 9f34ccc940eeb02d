r"""How an agent answers a capacity signal: what lambda divides by, and what becomes of demand.

The paper's rule multiplies demand by beta with probability lambda = Gamma * grad_j f(average) / average.
Two parts of it can be other parts:

    divisor     the average over time; the average v of the demand that signals have found; or
                (1 + beta) / 2 times the average of the demand that the agent's own cuts have found
    cut         drawn         x -> beta x with probability lambda
                fractional    x -> (1 - (1 - beta) lambda) x, for certain
                full          lambda is added up from 0, and x -> beta x when the sum passes a whole number

Averages over time settle where f'(1 + c / 2x) agree, with c = (1 - beta) Gamma mu; with v as divisor they
settle where f' agree, since demand at signals has no drift: (1 - beta) lambda E[y] = c.  A cut that is not
drawn has no noise.  A full cut finds demand at its peak, of which the mean over time is (1 + beta) / 2.

The averages of demand found by signals are of the same kind as the average over time, counted in signals.
The formulas are compiled into kernels, and called as they stand by processes.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, get_args, runtime_checkable

import numpy as np

from aimd_des.dynamics.averaging import FORGETTING, POLYNOMIAL, WINDOW, AveragingParameters
from aimd_des.utils import validation
from aimd_des.utils.compiled_call import NUMBERS, caller
from aimd_des.utils.jit import formula
from aimd_des.utils.parts import built_in
from aimd_des.utils.portable_math import expm1
from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray, IntArray

#: What becomes of demand.
DRAWN, FRACTIONAL, FULL = 0, 1, 2

#: What lambda divides by; `OWN` where a function of the user's gives the probability.
AVERAGE, AT_SIGNALS, AT_CUTS, OWN = 0, 1, 2, 3

#: What a function of the user's can read, in the order in which it is handed over.
INPUTS = (
    "normalization",
    "slope",
    "average",
    "demand",
    "increase",
    "decrease",
    "age",
    "agent",
    "resource",
)

# Columns of an agent's memory: the sum of lambda; average and number of demands found; with a window, their
# sum, and from `_PARTS` on the sum at the boundaries of parts.
_LAMBDA, _MEAN, _COUNT, _SUM, _PARTS = 0, 1, 2, 3, 4

#: Where the numbers begin that a function of the user's keeps.
OWN_COLUMNS = 1

#: Of a function of the user's: how many agents answer, how many can at once, and addresses of inputs, memory
#: (of the first of them), probabilities and of the last one that is none.
OF_ANSWERS = f"void(int64, int64, {', '.join([NUMBERS] * 4)})"
call_own = caller(OF_ANSWERS)

#: Where a function of the user's shall put a probability.
ASKED = 1.0


@record
class ResponseParameters(NamedTuple):
    """A response, for formulas."""

    cut: int  # `DRAWN`, `FRACTIONAL` or `FULL`
    divisor: int  # `AVERAGE`, `AT_SIGNALS`, `AT_CUTS` or `OWN`
    columns: int  # how many numbers a function of the user's keeps for each agent and resource
    address: int  # of the compiled function of the user's; 0 where there is none
    order: IntArray  # which of `INPUTS` the function reads
    # Working memory: the values of these, one row each, (9, answers at once), and the probabilities that the
    # function gives for them, (answers at once,).
    inputs: FloatArray
    given: FloatArray
    wrong: FloatArray  # (1,): what the function has given last that was no probability; 0 if nothing was


def response_parameters(cut: int, divisor: int, columns: int = 0, order: object = ()) -> ResponseParameters:
    """Make the parameters of a response."""
    chosen = np.array(order, dtype=np.int64).reshape(-1)
    inputs = np.zeros((len(INPUTS), 1))
    return ResponseParameters(cut, divisor, columns, 0, chosen, inputs, np.zeros(1), np.zeros(1))


def memory_columns(response: ResponseParameters, averaging: AveragingParameters) -> int:
    """Count the numbers that are kept for each agent and resource."""
    if response.divisor == OWN:
        return OWN_COLUMNS + response.columns
    if response.divisor != AVERAGE:
        return _PARTS + averaging.parts if averaging.kind == WINDOW else _SUM
    return _MEAN if response.cut == FULL else 0


@formula
def response_probability(normalization: float, gradient: float, average: float) -> float:
    """Return lambda of eq. (prob_x), not cut off at 1.

    Parameters
    ----------
    normalization : float
        Gamma.
    gradient : float
        Derivative of the private cost at the averages.
    average : float
        The average, or what else lambda divides by; at 0 the agent has nothing to give back and lambda is 0.

    Returns
    -------
    float
        At least 0.
    """
    return normalization * gradient / average if average > 0.0 else 0.0


@formula
def _newest_weight(averaging: AveragingParameters, count: float) -> float:
    """Return what the newest of several samples weighs in their average."""
    if averaging.kind == FORGETTING:
        return expm1(-averaging.rate) / expm1(-averaging.rate * count)
    return min(1.0, averaging.gain / count) if averaging.kind == POLYNOMIAL else 1.0 / count


@formula
def _note_demand(
    averaging: AveragingParameters, memory: FloatArray, resource: int, agent: int, demand: float
) -> None:
    """Fold a demand that has been found into the average of those."""
    j, i = resource, agent
    count = memory[j, i, _COUNT] + 1.0
    memory[j, i, _COUNT] = count
    if averaging.kind == WINDOW:
        # Parts of whole signals, of at least as many as a part of the window has ticks or units of time.
        part, total = max(1.0, -(-averaging.part // 1.0)), memory[j, i, _SUM] + demand
        memory[j, i, _SUM] = total
        latest = int(count / part)
        if latest * part == count:
            memory[j, i, _PARTS + latest % averaging.parts] = total
        first = latest - averaging.parts + 1
        if first < 1:
            memory[j, i, _MEAN] = total / count
        else:
            earlier = memory[j, i, _PARTS + first % averaging.parts]
            memory[j, i, _MEAN] = (total - earlier) / (count - first * part)
    else:
        mean = memory[j, i, _MEAN]
        memory[j, i, _MEAN] = mean + _newest_weight(averaging, count) * (demand - mean)


@formula
def ask_own(response: ResponseParameters, memory: FloatArray, count: int) -> None:
    """Let the user's function give probabilities for answers whose inputs are laid out.

    `memory` is that of the agents that answer, one after the other; those of them are asked whose place in
    `given` holds `ASKED`.
    """
    inputs, given, wrong = response.inputs.ctypes.data, response.given.ctypes.data, response.wrong.ctypes.data
    call_own(response.address, (count, response.inputs.shape[1], inputs, memory.ctypes.data, given, wrong))


@formula
def probability_of(
    response: ResponseParameters,
    averaging: AveragingParameters,
    memory: FloatArray,
    resource: int,
    agent: int,
    normalization: float,
    slope: float,
    average: float,
    demand: float,
    increase: float,
    decrease: float,
    age: float,
) -> float:
    """Return lambda of an answer, not cut off, and note the demand that the signal has found."""
    j, i = resource, agent
    if response.divisor == OWN:
        if not average > 0.0:
            return 0.0
        values = (normalization, slope, average, demand, increase, decrease, age, float(i), float(j))
        for p in range(response.order.shape[0]):
            response.inputs[p, 0] = values[response.order[p]]
        response.given[0] = ASKED
        ask_own(response, memory[j, i:], 1)
        return float(response.given[0])
    divisor = average
    if response.divisor == AT_SIGNALS:
        _note_demand(averaging, memory, j, i, demand)
        divisor = memory[j, i, _MEAN]
    elif response.divisor == AT_CUTS and memory[j, i, _COUNT] > 0.0:
        divisor = 0.5 * (1.0 + decrease) * memory[j, i, _MEAN]
    # A process reads numbers of NumPy from the memory, which warn where those of Python overflow silently.
    return response_probability(normalization, slope, float(divisor))


@formula
def cut_factor(
    response: ResponseParameters,
    averaging: AveragingParameters,
    memory: FloatArray,
    resource: int,
    agent: int,
    probability: float,
    uniform: float,
    demand: float,
    decrease: float,
) -> float:
    """Return what demand is multiplied by: 1 where the agent holds."""
    j, i = resource, agent
    if response.cut == DRAWN:
        return decrease if uniform < probability else 1.0
    if response.cut == FRACTIONAL:
        return max(0.0, 1.0 - (1.0 - decrease) * probability)
    total = memory[j, i, _LAMBDA] + min(1.0, probability)
    memory[j, i, _LAMBDA] = total if total < 1.0 else total - 1.0
    if total < 1.0:
        return 1.0
    if response.divisor == AT_CUTS:
        _note_demand(averaging, memory, j, i, demand)
    return decrease


@formula
def is_saturated(response: ResponseParameters, probability: float, decrease: float) -> bool:
    """Tell whether lambda is above what the cut can follow: 1, or 1 / (1 - beta) of a fractional one."""
    return ((1.0 - decrease) * probability if response.cut == FRACTIONAL else probability) > 1.0


@runtime_checkable
class Response(Protocol):
    """A choice of how signals are answered."""

    def parameters(self, tick_weight: float) -> ResponseParameters:
        """Return what the formulas need, for agents with this tick weight."""
        ...


@built_in("response", "randomised")
@dataclass(frozen=True)
class Randomised:
    r"""The paper's rule, equation (prob_x): demand is multiplied by beta with probability lambda.

    .. math::

        \lambda_i^j = \Gamma^j\,\frac{\partial_j f_i(\bar{x}_i)}{\bar{x}_i^j}
    """

    def parameters(self, tick_weight: float) -> ResponseParameters:
        """Return what the formulas need."""
        del tick_weight
        return response_parameters(DRAWN, AVERAGE)


@built_in("response", "event_normalised")
@dataclass(frozen=True)
class EventNormalised:
    """As the paper's rule, with the average demand found by signals in the place of the average over time.

    lambda = Gamma f'(average) / v, where v is the average of the demand that the agent had when it
    answered signals, the present one included.  It is averaged as demand is, counted in signals: over all
    of them, or over the latest ones of a window, in parts of whole signals. With forgetting each signal
    has the weight of one over the time constant. With gain a the newest of k has the weight min(1, a /
    k). While no lambda exceeds 1, averages settle at the optimum for what is used, without the paper's
    bias.
    """

    def parameters(self, tick_weight: float) -> ResponseParameters:
        """Return what the formulas need."""
        del tick_weight
        return response_parameters(DRAWN, AT_SIGNALS)


@built_in("response", "derandomised")
@dataclass(frozen=True)
class Derandomised:
    """No draw decides: each agent gives back at a signal what it would give back in the mean.

    Parameters
    ----------
    divisor : {"average", "events"}
        What lambda divides by: the average over time, as in the paper; or the average demand found by
        signals, as with `EventNormalised`.  With `full`, "events" is (1 + beta) / 2 times the average demand
        found by the agent's own cuts, and the average over time before the first of them.
    full : bool
        Whether lambda is added up from 0, and demand multiplied by beta when the sum passes a whole number;
        else demand is multiplied by 1 - (1 - beta) lambda at every signal.

    Raises
    ------
    InputError
        If a value is none of these.
    """

    divisor: Literal["average", "events"] = "average"
    full: bool = False

    def __post_init__(self) -> None:
        allowed = get_args(Literal["average", "events"])
        validation.choice("Derandomised.divisor", self.divisor, allowed)
        object.__setattr__(self, "full", validation.flag("Derandomised.full", self.full))

    def parameters(self, tick_weight: float) -> ResponseParameters:
        """Return what the formulas need."""
        del tick_weight
        events = AT_CUTS if self.full else AT_SIGNALS
        return response_parameters(
            FULL if self.full else FRACTIONAL, events if self.divisor == "events" else AVERAGE
        )
