"""What an emulation is made of, mostly without sockets: rule, datagrams, frames, what is served."""

import ast
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    BroadcastChannel,
    Crossing,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Simulation,
    averaging,
    compensation,
    latency,
    loss,
)
from aimd_des.emulate.agent import EmulatedAgent, Holding, Rule
from aimd_des.emulate.averages import Average, Fading, OverAll, Rising
from aimd_des.emulate.framing import LONGEST_FRAME, WORDS, BrokenFrameError, Framer, read_words
from aimd_des.emulate.records import ROW_SIZE, Row, RowKind, packed, read_rows
from aimd_des.emulate.served import check_setting
from aimd_des.emulate.wire import (
    LONGEST_DATAGRAM,
    MeterDatagram,
    SignalDatagram,
    find_group,
    meter_datagram,
    parsed_address,
    read_meter,
    read_signal,
    signal_datagram,
)
from aimd_des.problem.costs import marginal_cost
from aimd_des.responses import Derandomised, EventNormalised, Response
from aimd_des.scenario import Scenario
from aimd_des.utils import rng
from aimd_des.utils.rng import Purpose

WING = Path(__file__).resolve().parents[1] / "aimd_des" / "emulate"
_N, _UNTIL = 6, 60.0


def problem() -> Problem:
    draws = np.random.default_rng(4)
    resources = [
        Resource("memory", 3.0, draws.uniform(0.02, 0.05, _N), draws.uniform(0.6, 0.8, _N), 0.4),
        Resource("disk", 2.0, 0.03, 0.7, 0.3),
    ]
    return Problem(resources, PolynomialCosts([1, 2], draws.uniform(0.3, 1.0, (_N, 2, 2))))


def replayed_by_hand(
    rule: Rule, average: Average, simulated: Mapping[str, Any], losses: float = 0.0
) -> tuple[float, float]:
    """Let emulated agents hear what simulated ones have heard; return how far cuts and averages are apart."""
    of = problem()
    channel = BroadcastChannel(latency.Exponential(0.5), loss.Bernoulli(0.1), duplication=0.2)
    recording = Recording(events=True)
    unit = Crossing(hold_off=1.0)
    simulation = Simulation(
        of,
        dynamics="continuous",
        control_unit=unit,
        channel=channel,
        seed=3,
        recording=recording,
        **simulated,
    )
    result = simulation.run(_UNTIL)
    rows = zip(of.increase, of.decrease, strict=True)
    agents = [
        EmulatedAgent(
            [
                Holding(*row)
                for row in zip(alpha.tolist(), beta.tolist(), of.normalization.tolist(), strict=True)
            ],
            marginal_cost(of.costs, i),
            average,
            rule,
        )
        for i, (alpha, beta) in enumerate(rows)
    ]
    assert result.log is not None
    time, entry, value = result.log.columns()
    key = rng.key(3, Purpose.RESPONSE)
    given_back, cuts, worst = 0.0, 0, 0.0
    for moment, (kind, j, i, number), said in zip(time.tolist(), entry.tolist(), value.tolist(), strict=True):
        if kind == 2:  # a copy arrives; its value tells a duplicate
            uniform = float(rng.uniforms(key, j, number, _N, int(said))[i])
            answer = agents[i].answer(j, moment, uniform)
            given_back = answer.before - answer.after
        elif kind in (3, 4):  # and is answered
            worst, cuts = max(worst, abs(given_back - said)), cuts + (kind == 3)
    assert cuts > 50
    averages = np.array([agent.averages(_UNTIL) for agent in agents])
    return worst, float(np.abs(averages - result.average_at_end).max())


# At the beginning, while averages are small, lambda is above 1: both cut it off.
pytestmark = pytest.mark.filterwarnings("ignore:.*had a probability above 1:RuntimeWarning")

_RULES: list[tuple[Rule, Response | None]] = [
    (Rule(), None),
    (Rule("drawn", "signals"), EventNormalised()),
    (Rule("fractional", "average"), Derandomised()),
    (Rule("fractional", "signals"), Derandomised("events")),
    (Rule("full", "average"), Derandomised(full=True)),
    (Rule("full", "cuts"), Derandomised("events", full=True)),
]


@pytest.mark.parametrize(("rule", "response"), _RULES)
def test_the_rule_of_its_own_answers_as_a_simulated_agent(rule: Rule, response: Response | None) -> None:
    cuts, averages = replayed_by_hand(rule, OverAll(), {"response": response})
    # Formulas in another order: rounding, carried through a few hundred answers.
    assert cuts < 1e-12
    assert averages < 1e-12


@pytest.mark.parametrize(
    ("average", "averaged"),
    [(Fading(15.0), averaging.Forgetting(15.0)), (Rising(1.7), averaging.Polynomial(1.7))],
)
def test_averages_of_its_own_are_those_of_a_simulated_agent(average: Average, averaged: Any) -> None:
    cuts, averages = replayed_by_hand(Rule(), average, {"averaging": averaged})
    assert cuts < 1e-12
    assert averages < 1e-11


def test_known_losses_are_made_good_for() -> None:
    made = {"compensation": compensation.KnownLoss(0.1)}
    assert max(replayed_by_hand(Rule(factor=1.0 / 0.9), OverAll(), made)) < 1e-12


def test_another_rule_is_told_apart() -> None:
    """The negative control: a tenth more of lambda, and another average."""
    assert max(replayed_by_hand(Rule(factor=1.1), OverAll(), {})) > 1e-4
    assert max(replayed_by_hand(Rule(), Fading(1000.0), {})) > 1e-4


@pytest.mark.parametrize(
    ("file", "allowed"),
    [
        ("agent.py", {"emulate"}),
        ("averages.py", set()),
        ("agents_process.py", {"emulate", "channel", "utils"}),
        ("unit_process.py", {"emulate", "engine", "utils"}),
        ("pacing.py", set()),
    ],
)
def test_agents_and_unit_share_nothing_with_simulations(file: str, allowed: set[str]) -> None:
    """But the costs and the draws; of the unit of a simulation its numbers are read alone."""
    tree = ast.parse((WING / file).read_text(encoding="utf-8"))
    modules = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    modules |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    ours = {name for name in modules if name.startswith("aimd_des")}
    assert {name.split(".")[1] for name in ours} <= allowed
    assert {name for name in ours if name.startswith("aimd_des.engine")} <= {"aimd_des.engine.control_unit"}


def test_a_datagram_is_read_with_its_token_alone() -> None:
    signal = SignalDatagram(7, 2, 5)
    written = signal_datagram(signal, "right token")
    assert read_signal(written, "right token") == signal
    assert read_signal(written, "wrong token") is None
    for place in range(len(written)):
        changed = bytearray(written)
        changed[place] ^= 1
        assert read_signal(bytes(changed), "right token") is None
    for other in (b"", written[:-1], written + b"x", bytes(LONGEST_DATAGRAM + 1), b"\xff" * len(written)):
        assert read_signal(other, "right token") is None
        assert read_meter(other, "right token", 2) is None
    reading = MeterDatagram(1, 9, (0.5, -2.0))
    assert read_meter(meter_datagram(reading, "t"), "t", 2) == reading
    assert read_meter(meter_datagram(reading, "t"), "t", 3) is None
    assert read_signal(meter_datagram(reading, "t"), "t") is None


def test_frames_come_out_as_they_went_in_and_nothing_else_does() -> None:
    here, there = Framer("token"), Framer("token")
    stream = here.words(a=1) + here.words(b=[2.5])
    found = [part for k in range(0, len(stream), 7) for part in there.feed(stream[k : k + 7])]
    assert [(kind, read_words(content)) for kind, content in found] == [
        (WORDS, {"a": 1}),
        (WORDS, {"b": [2.5]}),
    ]
    with pytest.raises(BrokenFrameError):  # said once more
        there.feed(stream)
    with pytest.raises(BrokenFrameError):
        Framer("other").feed(Framer("token").words(a=1))
    with pytest.raises(BrokenFrameError):
        Framer("token").feed(Framer("token").frame(WORDS, bytes(LONGEST_FRAME + 1)))
    with pytest.raises(BrokenFrameError):
        read_words(b"[1]")


def test_rows_are_kept_as_they_are_and_half_a_row_is_left_out() -> None:
    row = Row(RowKind.ANSWER, 3, 41, 2, 17, 80, 1, 3, 0.1, 0.2, 0.3, 1.5, 1.25, 7.0, 0.4)
    found = read_rows(packed(row) * 2 + packed(row)[: ROW_SIZE - 1])
    assert len(found) == 2
    assert Row(*found[1].item()) == row


@pytest.mark.parametrize(
    "text", ["8.8.8.8:4000", "0.0.0.0:4000", "10.0.0.1", "10.0.0.1:0", "10.0.0.1:x", "host:4000", ""]
)
def test_an_address_that_is_not_of_a_private_network_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^listen = "):
        parsed_address("listen", text)


def test_addresses_of_private_networks_and_of_this_machine_are_served() -> None:
    for text in ("10.0.0.1:4000", "192.168.7.2:65535", "127.0.0.1:1"):
        assert "{}:{}".format(*parsed_address("join", text)) == text


def test_a_group_is_heard_by_several_on_loopback() -> None:
    from aimd_des.emulate.wire import group_receiver, sender

    group = find_group()
    if group is None:
        pytest.skip("this system has no multicast on loopback")
    with group_receiver(group) as first, group_receiver(group) as second, sender("127.0.0.1") as out:
        out.sendto(b"bit", (group.address, group.port))
        for receiver in (first, second):
            receiver.settimeout(5.0)
            assert receiver.recv(100) == b"bit"


def scenario(**other: Any) -> Scenario:
    given = {
        "until": 20.0,
        "dynamics": "continuous",
        "model": "models.smart_cameras",
        "control_unit": {"kind": "crossing", "hold_off": 1.0},
        **other,
    }
    return Scenario.model_validate(given)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"dynamics": "discrete", "control_unit": {"kind": "sampled"}}, "dynamics = 'discrete'"),
        (
            {"control_unit": {"kind": "crossing", "hold_off": 1.0, "longest_hold_off": 4.0}},
            "longest_hold_off",
        ),
        ({"control_unit": {"kind": "early_detection", "low": 0.9}}, "control_unit.kind = 'early_detection'"),
        ({"control_unit": {"kind": "crossing", "hold_off": 0.001}}, "control_unit.hold_off = 0.001"),
        ({"control_unit": {"kind": "sampled", "period": 0.001}}, "control_unit.period = 0.001"),
        ({"averaging": {"kind": "window", "length": 10.0}}, "averaging.kind = 'window'"),
        (
            {
                "averaging": {"kind": "forgetting", "time_constant": 9.0},
                "response": {"kind": "event_normalised"},
            },
            "averaging.kind = 'forgetting'",
        ),
        ({"compensation": {"kind": "estimated"}}, "compensation.kind = 'estimated'"),
        (
            {"interventions": [{"kind": "capacity_step", "resource": "memory", "capacity": 9.0, "at": 5.0}]},
            "interventions = '1 of them'",
        ),
        ({"channel": {"latency": [0.5, 0.5]}}, "latency"),
    ],
)
def test_what_is_not_served_is_refused_by_name(other: dict[str, Any], said: str) -> None:
    wanted = scenario(**other)
    with pytest.raises(InputError) as refusal:
        check_setting(wanted, unit=0.25, processes=4)
    assert said in str(refusal.value)


@pytest.mark.parametrize(
    ("unit", "processes"), [(0.0, 4), (1e-6, 4), (np.nan, 4), (0.25, 0), (0.25, 61), (0.25, 65)]
)
def test_numbers_out_of_range_are_refused(unit: float, processes: int) -> None:
    with pytest.raises(InputError):
        check_setting(scenario(), unit=unit, processes=processes)


def test_agents_are_dealt_out_in_even_blocks() -> None:
    setting = check_setting(scenario(), unit=0.25, processes=7)
    blocks = [setting.agents_of(process) for process in range(7)]
    assert [i for block in blocks for i in block] == list(range(60))
    assert {len(block) for block in blocks} <= {8, 9}
