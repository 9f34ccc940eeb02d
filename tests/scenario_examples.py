"""Scenario files in which every table, and every kind of each, occurs; and the files that they name."""

from pathlib import Path
from typing import Any

import networkx as nx

from aimd_des.scenario import Scenario, load_scenario
from tests.conftest import INLINE

# What comes before the first table: the rest of INLINE follows.
HEAD, TABLES = INLINE.split("[recording]", 1)
TABLES = "[recording]" + TABLES

MODEL = """\
until = 40
seed = 3
model = "models.smart_cameras"

[parameters]
n_cameras = 5
"""


def inline(head: str = "", tables: str = "") -> str:
    """The problem written out, with more at the top level and more tables."""
    return f"{HEAD}{head}\n{TABLES}\n{tables}\n"


_INTERVENTIONS = {
    "capacity_step": 'resource = "disk"\nat = 5\ncapacity = 1.5',
    "capacity_ramp": "resource = 0\nstart = 2.5\nend = 20\ncapacity = 2.0\nsteps = 4",
    "capacity_profile": 'resource = "memory"\ntimes = [0, 10]\ncapacities = [2.0, 3.5]\nperiod = 24',
    "join": "agents = 1\nat = 7.5",
    "absence": "agents = [0, 3]\nat = 10\nuntil = 20",
    "crash": "agents = 4\nat = 12.5",
    "unusual_activity": "agents = [2]\nat = 3\nuntil = 33.5\nweight = 0.25",
    "failover": "at = 15\nduration = 4.5",
    "partition": "at = 20\nduration = 5\nagents = [0, 1]",
}
_FROM_FILE = 'resource = "memory"\npath = "day.csv"\ntime = "hour"\nperiod = 24'

_LATENCIES = {
    "constant": "value = 0.5",
    "uniform": "low = 0.1\nhigh = [0.5, 0.5, 0.5, 1, 1]",
    "exponential": "mean = 0.5",
    "gamma": "shape = 2\nscale = 0.1\nshift = 0.2",
    "lognormal": "mean = 0.5\nstd = 0.1",
    "pareto": "shape = 3\nminimum = 0.1",
    "empirical": "values = [0.1, 0.2, 0.9]",
    "measured": 'path = "wifi.csv"\ncolumn = "delay"\nscale = 0.001',
}
_LOSSES = {
    "bernoulli": "probability = [0.1, 0.1, 0.2, 0.2, 0.3]",
    "gilbert_elliott": "mean_loss = 0.1\nmean_burst = 5",
    "common": "probability = 0.05",
    "trace": "lost = [[0, 1, 0, 0, 0], [1, 0, 0, 0, 1]]\nrepeat = true",
    "recorded": 'path = "lost.csv"\ncolumns = "lost"\nrepeat = true',
}
_NETWORKS = {
    "star": "n_agents = 5\nlatency = [0.1, 0.2, 0.1, 0.2, 0.1]\nloss = 0.1",
    "balanced_tree": "branching = 2\nheight = 2\nloss = 0.05\nagents = [2, 3, 4, 5, 6]",
    "grid": "rows = 2\ncolumns = 3\nlatency = 0.1\nloss = 0.1\nroot = [0, 1]",
    "random_geometric": "n_agents = 5\nradius = 0.8\nlatency_per_distance = 0.5\nseed = 2",
    "graphml": 'path = "network.graphml"\nroot = "hub"',
    "edges": 'path = "links.csv"\nroot = "hub"\nlatency = "delay"\nagents = ["a", "b", "c", "d", "e"]',
}


_CONTINUOUS = 'dynamics = "continuous"'

_OTHERS = {
    "inline": inline(),
    "model": MODEL,
    "synchronous": inline(
        'dynamics = "synchronous"\nlag = 0', '[averaging]\nkind = "forgetting"\ntime_constant = 20'
    ),
    "continuous": inline(f'{_CONTINUOUS}\nagents = "fleet"'),
    "sampled": inline("", "[control_unit]\nperiod = 0.5\nphase = 0.25\nsensing_delay = 0.1"),
    "early detection": inline(
        "",
        '[control_unit]\nkind = "early_detection"\nperiod = 0.5\nlow = 0.6\nhigh = 1.05\n'
        'sensing_delay = 0.1\n[[interventions]]\nkind = "failover"\nat = 15\nduration = 4.5',
    ),
    "crossing": inline(
        _CONTINUOUS,
        '[control_unit]\nkind = "crossing"\nhold_off = 0.5\nlongest_hold_off = 4\n[channel]\nlatency = 2.0',
    ),
    "numbers": inline(
        "", "[channel]\nlatency = [0, 0.5, 1, 1.5, 2]\nloss = 0.1\nduplication = 0.1\nfifo = true"
    ),
    "combined": inline(
        "",
        '[channel]\nloss = [{ kind = "common", probability = 0.1 }, { kind = "bernoulli", probability = 0 }]',
    ),
    "clocks": inline("", '[clocks]\nperiod = [1, 1, 1, 2, 2]\nphase = "random"\ndrift = 0.001\njitter = 0.1'),
    "cumulative": inline("", '[averaging]\nkind = "cumulative"'),
    "window": inline("", '[averaging]\nkind = "window"\nlength = 40'),
    "polynomial": inline("", '[averaging]\nkind = "polynomial"\ngain = 2.5'),
    "event normalised": inline("", '[response]\nkind = "event_normalised"'),
    "derandomised": inline("", '[response]\nkind = "derandomised"\ndivisor = "events"'),
    "full cuts": inline("", '[response]\nkind = "derandomised"\nfull = true'),
    "window of continuous agents": inline(
        _CONTINUOUS, '[averaging]\nkind = "window"\nlength = 0.5\nparts = 3'
    ),
    "known": inline(
        "", '[channel]\nloss = 0.2\n[compensation]\nkind = "known"\nloss = [0.2, 0.2, 0.2, 0.2, 0]'
    ),
    "estimated": inline("", '[channel]\nloss = 0.2\n[compensation]\nkind = "estimated"\nnumber_bits = 4'),
    "prices": f'{MODEL}\n[[interventions]]\nkind = "prices"\nevery = 12.5\n',
    "threshold that changes": inline(
        "", '[[interventions]]\nkind = "threshold"\nat = 6\nthreshold = 0.8\nresource = "disk"'
    ),
    "channel that changes": inline(
        "",
        '[[interventions]]\nkind = "channel"\nat = 9.5\n'
        "channel = { latency = 1.5, loss = 0.4, duplication = 0.2, fifo = true }\n"
        '[[interventions]]\nkind = "channel"\nat = 25\n'
        'channel = { latency = { kind = "exponential", mean = 0.4 } }',
    ),
    "hold-off that changes": inline(
        _CONTINUOUS,
        '[control_unit]\nkind = "crossing"\nhold_off = 0.25\n'
        '[[interventions]]\nkind = "hold_off"\nat = 8\nhold_off = 1.5\n'
        '[[interventions]]\nkind = "hold_off"\nat = 20\nhold_off = 0.1\nlongest_hold_off = 3',
    ),
    "recording": f"{MODEL}\n[recording]\ndemand = 0.5\nallocations = [0.0, 1, 20]\nevents = true\ntail = 0",
}


def _examples() -> dict[str, str]:
    found = dict(_OTHERS)
    for kind, keys in _LATENCIES.items():
        found[f"latency {kind}"] = inline("", f'[channel.latency]\nkind = "{kind}"\n{keys}')
    for kind, keys in _LOSSES.items():
        found[f"loss {kind}"] = inline("", f'[channel.loss]\nkind = "{kind}"\n{keys}')
    for kind, keys in _NETWORKS.items():
        found[f"network {kind}"] = inline("", f'[channel.network]\nkind = "{kind}"\n{keys}')
    tables = [f'[[interventions]]\nkind = "{kind}"\n{keys}' for kind, keys in _INTERVENTIONS.items()]
    for kind, table in zip(_INTERVENTIONS, tables, strict=True):
        found[kind] = inline("", table)
    found["profile from a file"] = inline("", f'[[interventions]]\nkind = "capacity_profile"\n{_FROM_FILE}')
    found["all interventions"] = inline("", "\n\n".join(tables))
    return found


#: Every table and every kind, by name.
EXAMPLES = _examples()


def write_files(folder: Path) -> None:
    """Write what the examples name."""
    texts = {
        "day.csv": "hour,capacity\n0,3\n8,2\n20,2.5\n",
        "wifi.csv": "delay\n120\n80\n400\n",
        "lost.csv": "lost\n0\n0\n1\n",
        "links.csv": "source,target,delay,loss\nhub,a,0.1,0\nhub,b,0.2,0\na,c,0.1,0.1\na,d,0.3,0\nb,e,0.1,0",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    graph = nx.Graph([("hub", name) for name in "abcde"])
    nx.set_edge_attributes(graph, 0.25, "latency")
    nx.set_edge_attributes(graph, 0.1, "loss")
    nx.write_graphml(graph, folder / "network.graphml")


def load(text: str, **changes: Any) -> Scenario:
    """Read a scenario from a file in the working directory."""
    path = Path("scenario.toml")
    path.write_text(text, encoding="utf-8")
    return load_scenario(path, **changes)
