"""What parts of one's own hand back is refused by the name of their class and method, or taken in."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    InputError,
    Result,
    Simulation,
    averaging,
    loss,
    topology,
)
from aimd_des.channel import Copies
from aimd_des.dynamics.averaging import AveragingParameters, Cumulative
from aimd_des.dynamics.loss_compensation import CompensationParameters
from aimd_des.responses import Randomised
from tests.conftest import assert_same_run, quadratic_problem, quietly

N = 4


class Losing:
    """A user's model of loss that says what it is told to."""

    def __init__(self, said: Any) -> None:
        self.said = said

    def start(self, n_agents: int) -> "Losing":
        return self

    def draw(self, draws: Any) -> Any:
        return self.said(draws) if callable(self.said) else self.said


class Late:
    """A user's model of latency that says what it is told to."""

    def __init__(self, said: Any) -> None:
        self.said = said

    def check(self, n_agents: int) -> None:
        """Any number."""

    def draw(self, draws: Any) -> Any:
        return self.said


class Wire:
    """A user's channel that says what it is told to, of the time of the signal, too."""

    def __init__(self, said: Any) -> None:
        self.said = said

    def open(self, n_agents: int, keys: Any) -> Any:
        return self

    def transmit(self, broadcast: Any, departure: float) -> Any:
        return self.said(broadcast.time) if callable(self.said) else self.said


class Answers:
    """A user's part with one method that hands back what it is told to."""

    def __init__(self, method: str, said: Any, **more: Any) -> None:
        setattr(self, method, lambda *_: said)
        for name, value in more.items():
            setattr(self, name, value)


def run(**parts: Any) -> Result:
    problem = quadratic_problem([1.0, 2.0, 3.0, 1.5], capacity=2.0, increase=0.05, normalization=0.05)
    options = {"dynamics": "continuous", "control_unit": Crossing(1.0), "seed": 1, **parts}
    return quietly(Simulation(problem, **options).run, 60.0)


def channel(latency: Any = 0.5, loss: Any = 0.0) -> dict[str, Any]:
    return {"channel": BroadcastChannel(latency, loss)}


def network(latency: Any = None, loss: Any = None) -> dict[str, Any]:
    parts = {"latency": latency, "loss": loss}
    made: dict[str, Any] = {
        name: lambda row, part=part: part for name, part in parts.items() if part is not None
    }
    return {"channel": topology.tree(topology.star(N), **made)}


def wire(said: Any, **parts: Any) -> dict[str, Any]:
    return {"channel": Wire(said), **parts}


ONES = np.ones(N)
SCALAR: Any = 100.0
NOT_NUMBERS = np.array([1.0, np.nan, 1.0, 1.0])
REFUSED: list[tuple[dict[str, Any], str]] = [
    (
        channel(loss=Losing(None)),
        "Losing.draw() = None: must be an array of booleans, or of 0 and 1, one for",
    ),
    (channel(loss=Losing("lost")), "Losing.draw() = 'lost': must be an array of booleans"),
    (channel(loss=Losing([0, 1, 2, 0])), "Losing.draw() = [0, 1, 2, 0]: must be an array of booleans, or of"),
    (channel(loss=Losing(NOT_NUMBERS)), "Losing.draw() = array([ 1., nan,  1.,  1.]): must be an array of"),
    (channel(loss=Losing([0.5] * N)), "Losing.draw() = [0.5, 0.5, 0.5, 0.5]: must be"),
    (channel(loss=Losing([True] * 3)), "shape of Losing.draw() = (3,): must be (4,), one for each agent"),
    (channel(loss=Losing(True)), "shape of Losing.draw() = (): must be (4,), one for each agent"),
    (channel(loss=loss.Combined(0.1, Losing(None))), "Losing.draw() = None: must be an array of booleans"),
    (channel(loss=Answers("start", 5)), "Answers.start() = 5: must be an object with draw()"),
    (channel(Late(2.0)), "shape of Late.draw() = (): must be (4,), one for each agent"),
    (channel(Late([1.0] * 3)), "shape of Late.draw() = (3,): must be (4,), one for each agent"),
    (channel(Late(-ONES)), "Late.draw()[0] = -1.0: must be a finite number at least 0"),
    (channel(Late(NOT_NUMBERS)), "Late.draw()[1] = nan: must be a finite number at least 0"),
    (channel(Late(None)), "Late.draw() = None: must be an array of numbers, one for each agent"),
    (channel(Late(["1.0"] * N)), "Late.draw() = ['1.0', '1.0', '1.0', '1.0']: must be an array of numbers"),
    (network(latency=Late(-ONES)), "Late.draw()[0] = -1.0: must be a finite number at least 0"),
    (network(latency=Late(2.0)), "shape of Late.draw() = (): must be (4,), one for each arc"),
    (network(loss=Losing([2, 0, 0, 0])), "Losing.draw() = [2, 0, 0, 0]: must be"),
    (wire(None), "Wire.transmit() = None: must be Copies"),
    (wire(100.0 * ONES), "Wire.transmit() = array([100., 100., 100., 100.]): must be Copies"),
    (wire(Copies(SCALAR)), "shape of Wire.transmit().arrival = (): must be (4,), one for each agent"),
    (wire(Copies(100.0 * ONES, ONES[:3])), "shape of Wire.transmit().second = (3,): must be (4,)"),
    (wire(Copies(100.0 * NOT_NUMBERS)), "Wire.transmit().arrival[1] = nan: must be"),
    (wire(lambda time: Copies(np.full(N, time - 1.0))), "Wire.transmit().arrival[0] = "),
    ({"channel": Answers("open", None)}, "Answers.open() = None: must be an object with transmit()"),
    ({"control_unit": Answers("process", None)}, "Answers.process() = None: must be a generator"),
    ({"processes": [lambda system: None]}, "<lambda>() = None: must be a generator"),
    (
        {"interventions": [Answers("process", [1.0], check=lambda problem: None)]},
        "Answers.process() = [1.0]: must be a generator",
    ),
    (
        {"special": {2: lambda i, system: None}},
        "<lambda>() = None: must be an object with receive() and process()",
    ),
    ({"special": {2: lambda i, system: AgentProcess}}, "<lambda>() = <class"),
    (
        {"agents": lambda i, system: Answers("process", None, receive=print)},
        "Answers.process() = None: must be a generator",
    ),
    ({"averaging": Answers("parameters", None)}, "Answers.parameters() = None: must be AveragingParameters"),
    (
        {"averaging": Answers("parameters", AveragingParameters(7, 0.0, 0.0, 0.0, 0))},
        "Answers.parameters().kind = 7: must be",
    ),
    (
        {"averaging": Answers("parameters", AveragingParameters(0, np.nan, 0.0, 0.0, 0))},
        "Answers.parameters().rate = nan: must be",
    ),
    ({"response": Answers("parameters", None)}, "Answers.parameters() = None: must be ResponseParameters"),
    (
        {"response": Answers("parameters", Randomised().parameters(1.0)._replace(cut=3))},
        "Answers.parameters().cut = 3: must be",
    ),
    (
        {"compensation": Answers("parameters", 1.0, bits=0)},
        "Answers.parameters() = 1.0: must be CompensationParameters",
    ),
    (
        {"compensation": Answers("parameters", CompensationParameters(1, np.zeros(3), 0), bits=0)},
        "shape of Answers.parameters().loss = (3,): must be (4,)",
    ),
    (
        {"compensation": Answers("parameters", CompensationParameters(1, ONES, 0), bits=0)},
        "Answers.parameters().loss[0] = 1.0: must be",
    ),
    (
        {"compensation": Answers("parameters", CompensationParameters(1, np.zeros(N), 0), bits=-1)},
        "Answers.bits = -1: must be an integer of at least 0",
    ),
]


@pytest.mark.parametrize(("parts", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_a_part_may_not_hand_back(parts: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        run(**parts)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("said", [np.int64, np.float64, np.uint8, list, pd.Series])
def test_losses_may_be_booleans_or_numbers(said: Any) -> None:
    """Integers are no indices: with these, agents 0 and 1 would be lost for ever."""

    def lost(draws: Any) -> Any:
        return (np.arange(N) + draws.number) % 2 == 0

    def other(draws: Any) -> Any:
        flags = lost(draws)
        return flags.astype(said) if issubclass(said, np.generic) else said(flags)

    booleans, numbers = (run(**channel(loss=Losing(function))) for function in (lost, other))
    assert_same_run(booleans, numbers)
    assert abs(np.diff(booleans.account.lost[0])).max() <= 1
    combined = [run(**channel(loss=loss.Combined(0.1, Losing(function)))) for function in (lost, other)]
    assert_same_run(*combined)


def test_times_may_be_integers_and_never() -> None:
    whole = run(**channel(Late([1, 2, 3, 4])))
    assert_same_run(whole, run(**channel(Late(np.array([1.0, 2.0, 3.0, 4.0])))))
    never = run(**channel(Late([1.0, np.inf, 3.0, 4.0])))
    assert never.account.lost.tolist() == [[0, len(never.signals), 0, 0]]
    times: Any = [1, 2, 3, 4]
    wired = run(**wire(lambda time: Copies([time + late for late in times])))  # type: ignore[arg-type]
    assert wired.digest == whole.digest


def test_a_channel_cannot_answer_before_a_signal_leaves() -> None:
    """After the look, and before the departure."""
    early = wire(lambda time: Copies(np.full(N, time + 0.25)), control_unit=Crossing(1.0, sensing_delay=0.5))
    with pytest.raises(
        InputError, match=r"^Wire\.transmit\(\)\.arrival\[0\] = .*: must be a finite number at least"
    ):
        run(**early)
    twice = wire(
        lambda time: Copies(np.full(N, time + 0.5), np.full(N, time + 0.25)),
        control_unit=Crossing(1.0, sensing_delay=0.5),
    )
    with pytest.raises(InputError, match=r"^Wire\.transmit\(\)\.second\[0\] = "):
        run(**twice)
    run(**wire(lambda time: Copies(np.full(N, time + 0.5)), control_unit=Crossing(1.0, sensing_delay=0.5)))


def test_a_channel_may_use_its_array_again() -> None:
    """A signal that has not left yet is not changed by the one after it."""

    class Reusing(Wire):
        def __init__(self) -> None:
            self.arrival = np.zeros(N)

        def transmit(self, broadcast: Any, departure: float) -> Any:
            self.arrival[:] = departure + 0.5
            return Copies(self.arrival)

    unit = Crossing(0.25, sensing_delay=3.0)
    reused = run(channel=Reusing(), control_unit=unit)
    assert_same_run(reused, run(control_unit=unit, **channel(0.5)))


def test_an_average_of_ones_own_may_be_the_ordinary_one() -> None:
    own = Answers("parameters", Cumulative().parameters(0.0))
    assert_same_run(run(averaging=own), run(averaging=averaging.Cumulative()))
