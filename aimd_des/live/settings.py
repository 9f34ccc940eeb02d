"""What the page may change, and the scenario that its state describes.

The state of a page is data: values of controls from the start, and changes at times.  It names no module and
no file: an address can make the server run only variants of the scenario with which it was started.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from aimd_des.scenario import Scenario, validate_scenario
from aimd_des.scenario.models import model_parameters
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

#: The system that is played unless a file is given.
DEFAULT: dict[str, Any] = {
    "title": "60 cameras share memory, disk and bandwidth",
    "model": "models.smart_cameras",
    "dynamics": "continuous",
    "until": 2000.0,
    "seed": 1,
    "agents": "fleet",
    "parameters": {"n_cameras": 60},
    "control_unit": {"kind": "crossing", "hold_off": 0.5},
    "channel": {"latency": {"kind": "exponential", "mean": 0.6}, "loss": 0.1},
}

# More changes than that are not made by hand.
_MOST_CHANGES = 1000
# Shape of the Pareto distribution: its variance is finite, and one latency in 100 is 4.4 times the mean.
_SHAPE = 2.2


class ChoiceControl(NamedTuple):
    """A control that chooses one of several."""

    name: str
    label: str
    options: tuple[tuple[str, str], ...]  # value, and what is shown
    now: bool = False  # whether it can change while the run goes on


class SliderControl(NamedTuple):
    """A control that moves over numbers."""

    name: str
    label: str
    low: float
    high: float
    step: float
    unit: str = ""
    now: bool = False  # whether it can change while the run goes on


class ControlGroup(NamedTuple):
    """Controls about one part of the system."""

    title: str
    controls: tuple[ChoiceControl | SliderControl, ...]


_LATENCIES = (
    ("constant", "always the same"),
    ("uniform", "uniform from 0"),
    ("exponential", "exponential"),
    ("lognormal", "log-normal"),
    ("pareto", "heavy tail (Pareto)"),
)
_AVERAGES: dict[str, dict[str, Any]] = {
    "cumulative": {"kind": "cumulative"},
    "window": {"kind": "window", "length": 40.0},
    "forgetting": {"kind": "forgetting", "time_constant": 40.0},
    "polynomial": {"kind": "polynomial", "gain": 2.0},
}
_RESPONSES: dict[str, dict[str, Any]] = {
    "randomised": {"kind": "randomised"},
    "event_normalised": {"kind": "event_normalised"},
    "derandomised": {"kind": "derandomised"},
    "fractional": {"kind": "derandomised", "full": True},
}
_CLOCKS: dict[str, dict[str, Any]] = {
    "common": {},
    "random": {"phase": "random"},
    "jitter": {"phase": "random", "jitter": 0.5},
}

_CHANNEL = ControlGroup(
    "Channel",
    (
        SliderControl("latency", "Latency, mean", 0.0, 4.0, 0.05, now=True),
        ChoiceControl("latency_kind", "Latency varies", _LATENCIES, now=True),
        SliderControl("loss", "Copies lost", 0.0, 0.9, 0.01, "%", now=True),
        SliderControl("burst", "Losses in bursts of", 0.0, 20.0, 0.5, now=True),
    ),
)
_UNIT = ControlGroup(
    "Control unit",
    (
        ChoiceControl("unit", "It", (("crossing", "senses the crossing"), ("sampled", "samples at times"))),
        SliderControl("hold_off", "Hold-off", 0.0, 4.0, 0.05, now=True),
        SliderControl("period", "Sampling period", 0.1, 4.0, 0.1),
        SliderControl("threshold", "Threshold", 0.5, 1.0, 0.01, "%", now=True),
    ),
)
_AGENTS = ControlGroup(
    "Agents",
    (
        ChoiceControl(
            "dynamics", "Demand", (("continuous", "grows all the time"), ("discrete", "moves at ticks"))
        ),
        ChoiceControl(
            "clocks",
            "Clocks",
            (("common", "in phase"), ("random", "random phases"), ("jitter", "random phases and jitter")),
        ),
        ChoiceControl(
            "response",
            "Answer",
            (
                ("randomised", "at random, the paper's"),
                ("event_normalised", "at random, per signal"),
                ("derandomised", "a little at each signal"),
                ("fractional", "in full, in turn"),
            ),
        ),
        ChoiceControl(
            "averaging",
            "Average over",
            (
                ("cumulative", "all of the past"),
                ("window", "the last 40"),
                ("forgetting", "the past, forgotten over 40"),
                ("polynomial", "the past, the latest most"),
            ),
        ),
        SliderControl("count", "How many", 4, 1000, 1),
        SliderControl("seed", "Seed", 0, 99, 1),
    ),
)
GROUPS = (_CHANNEL, _UNIT, _AGENTS)
_CONTROLS = {control.name: control for group in GROUPS for control in group.controls}
_NOW = {name for name, control in _CONTROLS.items() if control.now}
_OF_CHANNEL = {control.name for control in _CHANNEL.controls}


def default_scenario() -> Scenario:
    """Give what is played by default: the paper's cameras behind a channel that is late and loses copies."""
    return validate_scenario(DEFAULT, "the paper's cameras")


class PageState(NamedTuple):
    """What a page has chosen: from the start, and in the course of the run."""

    start: dict[str, Any]  # values of controls
    changes: tuple[dict[str, Any], ...]  # each with its time, in the order of time


def read_state(data: object) -> PageState:
    """Take in the state of a page, which is not trusted."""
    given = _table("state", data)
    start = _values("state.start", given.get("start", {}), set(_CONTROLS))
    changes = given.get("changes", [])
    if not isinstance(changes, list) or len(changes) > _MOST_CHANGES:
        raise InputError.of("state.changes", type(changes).__name__, f"a list of at most {_MOST_CHANGES}")
    read = [_change(f"state.changes[{number}]", change) for number, change in enumerate(changes)]
    return PageState(start, tuple(sorted(read, key=lambda change: float(change["at"]))))


def _table(field: str, data: object) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise InputError.of(field, type(data).__name__, "an object")
    return data


def _values(field: str, data: object, known: set[str]) -> dict[str, Any]:
    values = _table(field, data)
    for name in values:
        validation.known(field, name, sorted(known))
    return {name: _value(f"{field}.{name}", _CONTROLS[name], value) for name, value in values.items()}


def _value(field: str, control: ChoiceControl | SliderControl, value: object) -> float | int | str:
    if isinstance(control, ChoiceControl):
        return validation.choice(field, str(value), [option for option, _ in control.options])
    if control.name in ("count", "seed"):
        low = 0 if control.name == "seed" else 1
        return validation.integer(field, value, low=low, high=2**53)
    return validation.number(field, value, low=0.0)  # the scenario knows the rest


def _change(field: str, data: object) -> dict[str, Any]:
    change = _table(field, data)
    made: dict[str, Any] = {"at": validation.number(f"{field}.at", change.get("at"), low=0.0)}
    if "set" in change:
        return made | {"set": _values(f"{field}.set", change["set"], _NOW)}
    kind = validation.choice(f"{field}.do", change.get("do"), list(_DONE))
    details: dict[str, Any] = {name: change[name] for name in ("of", "for", "to") if name in change}
    return made | {"do": kind} | details


def scenario_of(base: Scenario, state: PageState) -> Scenario:
    """Put the choices of a page over a scenario; refuse what does not go together."""
    shown = {**shown_of(base), **state.start}
    data = base.spoken()
    _put_channel(data, state.start, shown)
    _put_unit(data, state.start, shown)
    _put_agents(data, state.start, base)
    if state.changes:
        made = _interventions(base, state, {**shown, "channel": data.get("channel", {})})
        data["interventions"] = [*data.get("interventions", []), *made]
    return validate_scenario(data, "what is chosen")


def _put_channel(data: dict[str, Any], chosen: Mapping[str, Any], shown: Mapping[str, Any]) -> None:
    if _OF_CHANNEL & set(chosen):
        data["channel"] = {**_without_network(data.get("channel", {})), **_links(chosen, shown)}


def _without_network(channel: Mapping[str, Any]) -> dict[str, Any]:
    return {} if "network" in channel else dict(channel)


def _links(chosen: Mapping[str, Any], shown: Mapping[str, Any]) -> dict[str, Any]:
    """Write latency and loss, as far as they have been chosen or are known."""
    links: dict[str, Any] = {}
    if {"latency", "latency_kind"} & set(chosen) or shown["latency"] is not None:
        links["latency"] = _latency(shown["latency_kind"] or "constant", shown["latency"] or 0.0)
    if {"loss", "burst"} & set(chosen) or shown["loss"] is not None:
        links["loss"] = _loss(shown["loss"] or 0.0, shown["burst"] or 0.0)
    return links


def _latency(kind: str, mean: float) -> Any:
    if mean == 0.0 or kind == "constant":
        return mean
    forms: dict[str, dict[str, Any]] = {
        "uniform": {"low": 0.0, "high": 2.0 * mean},
        "exponential": {"mean": mean},
        "lognormal": {"mean": mean, "std": mean},
        "pareto": {"shape": _SHAPE, "minimum": mean * (_SHAPE - 1.0) / _SHAPE},
    }
    return {"kind": kind, **forms[kind]}


def _loss(share: float, burst: float) -> Any:
    if share == 0.0 or burst == 0.0:
        return share
    return {"kind": "gilbert_elliott", "mean_loss": share, "mean_burst": burst}


def _put_unit(data: dict[str, Any], chosen: Mapping[str, Any], shown: Mapping[str, Any]) -> None:
    dynamics = chosen.get("dynamics", data.get("dynamics"))
    unit = chosen.get("unit", shown["unit"])
    # Demand that jumps at ticks crosses nothing.
    if dynamics == "discrete" and unit == "crossing":
        unit = "sampled"
    if unit != shown_unit(data) or {"unit", "hold_off", "period"} & set(chosen):
        if unit == "crossing":
            data["control_unit"] = {"kind": "crossing", "hold_off": _or_one(shown["hold_off"])}
        else:
            data["control_unit"] = {"kind": "sampled", "period": _or_one(shown["period"])}
    if "threshold" in chosen:
        _put_threshold(data, chosen["threshold"])


def _or_one(value: Any) -> Any:
    return 1.0 if value is None else value


def shown_unit(data: Mapping[str, Any]) -> str | None:
    """Name the control unit of a scenario, if a page can choose it."""
    kind = data.get("control_unit", {}).get("kind")
    return kind if kind in ("crossing", "sampled") else None


def _put_threshold(data: dict[str, Any], threshold: float) -> None:
    resources = data.get("resources")
    if isinstance(resources, list):
        data["resources"] = [{**resource, "threshold": threshold} for resource in resources]
    else:
        count = validate_scenario(data, "what is chosen").problem().n_resources
        places = (str(number) for number in range(count))
        known = resources or {}
        data["resources"] = {place: {**known.get(place, {}), "threshold": threshold} for place in places}


def _put_agents(data: dict[str, Any], chosen: Mapping[str, Any], base: Scenario) -> None:
    if "dynamics" in chosen:
        data["dynamics"] = chosen["dynamics"]
        if chosen["dynamics"] == "continuous":
            data.pop("clocks", None)
    if "clocks" in chosen and data.get("dynamics") == "discrete":
        data["clocks"] = _CLOCKS[chosen["clocks"]]
    if "response" in chosen:
        data["response"] = _RESPONSES[chosen["response"]]
    if "averaging" in chosen:
        data["averaging"] = _AVERAGES[chosen["averaging"]]
    if "seed" in chosen:
        data["seed"] = chosen["seed"]
    counted = _counted(base)
    if "count" in chosen and counted:
        data["parameters"] = {**data.get("parameters", {}), counted: chosen["count"]}


def _counted(base: Scenario) -> str | None:
    """Name the parameter of the model that says how many agents there are."""
    if base.model is None:
        return None
    parameters = model_parameters(base.model, base.parameters, base.seed)
    names = [name for name in parameters if name.startswith("n_") and name != "n_resources"]
    return names[0] if len(names) == 1 else None


def shown_of(scenario: Scenario) -> dict[str, Any]:
    """Say where the controls stand for a scenario; None where no position says what it has."""
    data = scenario.spoken()
    channel = data.get("channel", {})
    latency_kind, latency = _shown_latency(channel.get("latency"))
    loss, burst = _shown_loss(channel.get("loss"))
    unit = data.get("control_unit", {})
    counted = _counted(scenario)
    problem = scenario.problem()
    threshold = set(problem.threshold.tolist())
    return {
        "latency": latency,
        "latency_kind": latency_kind,
        "loss": loss,
        "burst": burst,
        "unit": shown_unit(data),
        "hold_off": unit.get("hold_off"),
        "period": unit.get("period"),
        "threshold": threshold.pop() if len(threshold) == 1 else None,
        "dynamics": data["dynamics"],
        "clocks": _shown_in(_CLOCKS, data.get("clocks", {}), {"period": 1.0, "phase": 0.0}),
        "response": "randomised"
        if data.get("response") is None
        else _shown_in(_RESPONSES, data["response"], {"full": False, "divisor": "average"}),
        "averaging": _shown_in(_AVERAGES, data.get("averaging", {}), {"parts": 20}),
        "count": problem.n_agents if counted else None,
        "seed": scenario.seed,
    }


def _shown_in(
    known: Mapping[str, Mapping[str, Any]], data: Mapping[str, Any], usual: Mapping[str, Any]
) -> str | None:
    """Find which of the choices a table is."""
    given = {key: value for key, value in data.items() if value not in (0.0, usual.get(key))}
    for name, table in known.items():
        if {key: value for key, value in table.items() if value not in (0.0, usual.get(key))} == given:
            return name
    return None


def _shown_latency(table: Any) -> tuple[str | None, float | None]:
    if isinstance(table, int | float):
        return "constant", float(table)
    kind = table.get("kind") if isinstance(table, dict) else None
    means: dict[str, Callable[[dict[str, Any]], float]] = {
        "constant": lambda given: given["value"],
        "exponential": lambda given: given["mean"],
        "uniform": lambda given: 0.5 * given["high"],
        "lognormal": lambda given: given["mean"],
        "pareto": lambda given: given["minimum"] * _SHAPE / (_SHAPE - 1.0),
    }
    if kind not in means or not isinstance(mean := means[kind](table), int | float):
        return None, None
    back = _latency(kind, mean)
    same = kind == "constant" or (
        isinstance(back, dict) and all(math.isclose(table[key], back[key]) for key in back if key != "kind")
    )
    return (kind, float(mean)) if same else (None, None)


def _shown_loss(table: Any) -> tuple[float | None, float | None]:
    if isinstance(table, int | float):
        return float(table), 0.0
    kind = table.get("kind") if isinstance(table, dict) else None
    if kind == "bernoulli" and isinstance(table["probability"], int | float):
        return float(table["probability"]), 0.0
    if kind == "gilbert_elliott" and all(
        isinstance(table[key], int | float) for key in ("mean_loss", "mean_burst")
    ):
        return float(table["mean_loss"]), float(table["mean_burst"])
    return None, None


def _interventions(base: Scenario, state: PageState, shown: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Write what was changed in the course of the run as interventions."""
    present = dict(shown)
    made: list[dict[str, Any]] = []
    problem = base.problem() if any("do" in change for change in state.changes) else None
    for change in state.changes:
        at = change["at"]
        if "do" in change:
            assert problem is not None  # noqa: S101 - built where anything is done
            made.extend(_DONE[change["do"]](change, problem))
            continue
        chosen = change["set"]
        present.update(chosen)
        if _OF_CHANNEL & set(chosen):
            channel = {**_without_network(present["channel"]), **_links(chosen, present)}
            made.append({"kind": "channel", "at": at, "channel": channel})
        if "hold_off" in chosen:
            made.append({"kind": "hold_off", "at": at, "hold_off": chosen["hold_off"]})
        if "threshold" in chosen:
            made.append({"kind": "threshold", "at": at, "threshold": chosen["threshold"]})
    return made


def _capacity(change: Mapping[str, Any], problem: Any) -> list[dict[str, Any]]:
    resource = validation.integer("of", change.get("of"), low=0, high=problem.n_resources - 1)
    share = validation.number("to", change.get("to", 0.6), low=0.0, low_open=True)
    capacity = share * float(problem.capacity[resource])
    return [{"kind": "capacity_step", "resource": resource, "at": change["at"], "capacity": capacity}]


def _absence(change: Mapping[str, Any], problem: Any) -> list[dict[str, Any]]:
    agent = validation.integer("of", change.get("of"), low=0, high=problem.n_agents - 1)
    made = {"kind": "absence", "agents": agent, "at": change["at"]}
    return [made | ({"until": change["at"] + _duration(change)} if "for" in change else {})]


def _partition(change: Mapping[str, Any], _problem: Any) -> list[dict[str, Any]]:
    made: dict[str, Any] = {"kind": "partition", "at": change["at"], "duration": _duration(change)}
    agents = change.get("of")
    return [made if agents is None else {**made, "agents": agents}]


def _failover(change: Mapping[str, Any], _problem: Any) -> list[dict[str, Any]]:
    return [{"kind": "failover", "at": change["at"], "duration": _duration(change)}]


def _duration(change: Mapping[str, Any]) -> float:
    return validation.number("for", change.get("for", 10.0), low=0.0, low_open=True)


_DONE: dict[str, Callable[[Mapping[str, Any], Any], Sequence[dict[str, Any]]]] = {
    "capacity": _capacity,
    "leave": _absence,
    "partition": _partition,
    "failover": _failover,
}
