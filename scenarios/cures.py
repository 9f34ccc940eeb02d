"""What is the cheapest cure for loss and delay?

Cures are compared at the same bits per unit of time, by Gamma, and at the same risk, by the threshold: total
demand is above the capacity for about 1 % of the time.  Agents that know their loss need no other cure:
signals sent once and answered 1 / (1 - p) times as often are better than signals sent three times.  Other
agents can infer their loss from signals that are sent twice, without running numbers; in bursts copies are
lost together and tell nothing.  Against latency more bits do not help; a hold-off does that repeats fewer of
the signals in flight.
"""  # noqa: D400 - a question

from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from aimd_des import BroadcastChannel, Problem, Recording, Result
from aimd_des.compensation import Compensation, EstimatedLoss, KnownLoss
from aimd_des.loss import GilbertElliott
from aimd_des.lowlevel import FloatArray
from aimd_des.plots import colour
from aimd_des.responses import CustomResponse, Derandomised, EventNormalised, Response
from scenarios.common import figures
from scenarios.common.command import Finding, command
from scenarios.common.measure import distance, quietly, rows_of, run_draws, sensed, signal_rate, totals
from scenarios.common.systems import lowered, memory_alone, rate
from scenarios.common.tables import number, over_draws, pick, shown, summarise_draws

_N = 60
_HOLD_OFF, _LONG = 0.25, 1.0
# Above the capacity for at most so much of the time.
_RISK = 0.01
# The length of a pilot run, as a part of the run, the lowest threshold, and the first seed of pilots.
_PILOT, _FLOOR, _PILOT_SEED = 0.25, 0.05, 500
_LOOKS = 0.1
# Copies of one signal leave together; another signal leaves a hold-off later at the earliest.
_SAME_SIGNAL = 0.5 * _HOLD_OFF
# Beyond this share of what a hold-off admits signals are short.
_LOAD = 0.8

LOSS, DELAY, BOTH = "loss 0 to 0.5", "latency 5", "both"
_BURST = 10.0
BURSTS = f"loss 0 to 0.5 in bursts of {_BURST:g}"
_LATENCY = {LOSS: 0.25, DELAY: 5.0, BOTH: 5.0, BURSTS: 0.25}
# Bits per unit of time that cures may take at most where they are compared.
BUDGET = {LOSS: 1.5, DELAY: 1.5, BOTH: 2.0, BURSTS: 1.5}


@numba.njit  # type: ignore[untyped-decorator]
def _inferring(normalization: float, slope: float, average: float, age: float, memory: FloatArray) -> float:
    """Respond to the first copy of a signal as an agent that infers its loss from second ones.

    Of signals that are heard at all both copies arrive with probability (1 - p) / (1 + p), and p**2 of all
    signals are not heard.  Memory: when the last signal was heard, how many were, and how many of them twice.
    """
    if memory[1] > 0.0 and age - memory[0] < _SAME_SIGNAL:
        memory[2] += 1.0
        return 0.0
    twice = (memory[2] + 1.0) / (memory[1] + 1.0)
    memory[0] = age
    memory[1] += 1.0
    lost = (1.0 - twice) / (1.0 + twice)
    return normalization * slope / average / (1.0 - lost * lost)  # type: ignore[no-any-return]


class Cure(NamedTuple):
    """What is done."""

    copies: int = 1  # of each signal
    hold_off: float = _HOLD_OFF
    response: Response | None = None
    known: bool = False  # agents know their loss
    number_bits: int = 0  # of the running number by which they count what they lose
    both_heard: bool = False  # agents hear each copy; else they do not tell one from several

    @property
    def bits(self) -> int:
        """Bits of a broadcast."""
        return self.copies * (1 + self.number_bits)

    def lost(self, setting: str, loss: FloatArray) -> FloatArray:
        """Compute the share of the signals that each agent loses: all copies, independent or in a burst."""
        return loss if setting == BURSTS else loss**self.copies

    def channel(self, setting: str, loss: FloatArray) -> BroadcastChannel:
        """Make the channel; of the signals that are heard, so many are heard twice."""
        lost, second = self.lost(setting, loss), (1.0 - loss) / (1.0 + loss)
        if setting == BURSTS:
            return BroadcastChannel(_LATENCY[setting], GilbertElliott(lost, _BURST), float(self.both_heard))
        return BroadcastChannel(_LATENCY[setting], lost, second if self.both_heard else 0.0)

    def compensation(self, setting: str, loss: FloatArray) -> Compensation | None:
        """Make what agents do about what they lose."""
        if self.known:
            return KnownLoss(self.lost(setting, loss))
        return EstimatedLoss(self.number_bits) if self.number_bits else None


NOTHING, THRICE, TWICE = "nothing", "sent three times", "sent twice"
KNOWN, COUNTED, INFERRED = "known loss", "counted loss, 5 bits", "inferred from two copies"
EVENTS, FRACTIONAL, WAIT = "event-normalised", "fractional cuts", "hold-off 1"
_INFERS = CustomResponse(_inferring, memory=3)
_EXACT = Derandomised("events")
CURES: dict[str, dict[str, Cure]] = {
    LOSS: {
        NOTHING: Cure(),
        THRICE: Cure(copies=3),
        TWICE: Cure(copies=2),
        KNOWN: Cure(known=True),
        COUNTED: Cure(number_bits=5),
        INFERRED: Cure(copies=2, response=_INFERS, both_heard=True),
        EVENTS: Cure(response=EventNormalised()),
        FRACTIONAL: Cure(response=_EXACT),
        f"{KNOWN}, {FRACTIONAL}": Cure(known=True, response=_EXACT),
    },
    DELAY: {
        NOTHING: Cure(),
        WAIT: Cure(hold_off=_LONG),
        EVENTS: Cure(response=EventNormalised()),
        FRACTIONAL: Cure(response=_EXACT),
        f"{WAIT}, {FRACTIONAL}": Cure(hold_off=_LONG, response=_EXACT),
    },
    BOTH: {
        NOTHING: Cure(),
        THRICE: Cure(copies=3),
        WAIT: Cure(hold_off=_LONG),
        f"{WAIT}, {THRICE}": Cure(copies=3, hold_off=_LONG),
        f"{WAIT}, {INFERRED}": Cure(copies=2, hold_off=_LONG, response=_INFERS, both_heard=True),
        f"{WAIT}, {KNOWN}": Cure(hold_off=_LONG, known=True),
        f"{WAIT}, {KNOWN}, {FRACTIONAL}": Cure(hold_off=_LONG, known=True, response=_EXACT),
    },
    BURSTS: {
        NOTHING: Cure(),
        KNOWN: Cure(known=True),
        INFERRED: Cure(copies=2, response=_INFERS, both_heard=True),
        FRACTIONAL: Cure(response=_EXACT),
        f"{KNOWN}, {FRACTIONAL}": Cure(known=True, response=_EXACT),
        WAIT: Cure(hold_off=_LONG),
    },
}
# What is run for longer, too: its errors are bias, or random error that is left.
_LONGER = (NOTHING, THRICE, KNOWN, f"{KNOWN}, {FRACTIONAL}")
_LABELS = ("setting", "cure", "over_gamma", "until")
# Measures that have a panel for each setting: title, label and scale.
_ROWS = {
    "misallocation": ("shares", "distance from the optimum (%)", "log"),
    "utilisation": ("use", "use of the capacity (%), above it 1 % of the time", "linear"),
}


class Case(NamedTuple):
    """A setting and a cure, 1 / Gamma, and the end in units of time."""

    setting: str
    cure: str
    over_gamma: float
    until: float
    pilots: int = 3  # runs by which the threshold is chosen, with seeds of their own

    @property
    def possible(self) -> bool:
        """Whether the hold-off admits the signals that are needed, below a threshold for the latency."""
        cure, plain = CURES[self.setting][self.cure], memory_alone(normalization=1.0 / self.over_gamma)
        lift = float(plain.increase.sum() / plain.capacity[0]) * _LATENCY[self.setting]
        heard = 1.0
        if not (self.setting == DELAY or cure.known):
            heard -= float(cure.lost(self.setting, losses(0)).mean())
        return rate(lowered(plain, 1.0 - lift)) / heard * cure.hold_off < _LOAD


def losses(draw: int) -> FloatArray:
    """Draw how much each agent loses, (n,)."""
    return np.random.default_rng([2028, draw]).permutation(np.linspace(0.0, 0.5, _N))


def measure(case: Case, draw: int, seed: int) -> dict[str, float]:
    """Choose the threshold for the risk by pilot runs, then run and measure."""
    problem, threshold = memory_alone(normalization=1.0 / case.over_gamma, draw=draw), 1.0
    for pilot in range(case.pilots):
        short = case._replace(until=_PILOT * case.until)
        seen = _run(short, lowered(problem, threshold), draw, seed + _PILOT_SEED + pilot)
        high = float(np.quantile(totals(seen), 1.0 - _RISK))
        threshold = float(np.clip(threshold + 1.0 - high, _FLOOR, 1.0))
    result = _run(case, lowered(problem, threshold), draw, seed)
    total, account = totals(result), result.account
    signals = signal_rate(result, case.until / 4.0)
    return {
        "bits": signals * CURES[case.setting][case.cure].bits,  # per unit of time
        "misallocation": distance(result.problem, result.average_at_end)[0],
        "utilisation": total.mean(),
        "above": (total > 1.0).mean(),  # share of the time above the capacity
        # Share of the responses with a probability above 1.
        "saturated": account.saturated.sum() / max(account.responses.sum(), 1),
        "threshold": threshold,
    }


def _run(case: Case, problem: Problem, draw: int, seed: int) -> Result:
    cure, loss = CURES[case.setting][case.cure], np.zeros(_N) if case.setting == DELAY else losses(draw)
    simulation = sensed(
        problem,
        cure.hold_off,
        channel=cure.channel(case.setting, loss),
        response=cure.response,
        compensation=cure.compensation(case.setting, loss),
        seed=seed,
        recording=Recording(demand=np.arange(case.until / 4.0, case.until, _LOOKS), overshoot=False),
    )
    return quietly(simulation, case.until)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Run memory alone with every cure, for several Gamma."""
    draws, until, pilots = (2, 80.0, 1) if quick else (12, 5000.0, 3)
    scales = (45.0, 140.0) if quick else (45.0, 80.0, 140.0, 250.0)
    cases = [
        Case(setting, cure, scale, until, pilots)
        for setting, cures in CURES.items()
        for cure in cures
        for scale in scales
    ]
    cases += [Case(LOSS, cure, scales[1], 4.0 * until, pilots) for cure in _LONGER]
    pairs = run_draws(measure, [case for case in cases if case.possible], draws, 1, seed, quick, runs)
    rows = pd.DataFrame(rows_of(pairs, first=seed)).drop(columns="pilots")
    rows = pd.concat([rows, _at_budget(rows[rows["until"] == until])])
    table = summarise_draws(rows, _LABELS).assign(theory=np.nan)
    settings = {"seed": seed, "draws": draws, "until": until}
    printed = shown(_shown(table), ["setting", "cure", "measure"], ".3f")
    drawn = {"cures": partial(_figure, table, until)}
    return Finding("cures", settings, table, printed, _findings(table, until, scales[1]), drawn)


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    budget = pick(table, over_gamma=np.nan)
    return budget[budget["measure"].isin(["bits", "misallocation", "utilisation"])]


def _at_budget(rows: pd.DataFrame) -> pd.DataFrame:
    """Interpolate what every draw has with the bits of its setting; 1 / Gamma is not a number there.

    A cure that does not get by with so few has no numbers; one that cannot use as many has those of its
    smallest Gamma.
    """
    points = ["setting", "cure", "until", "draw"]
    made = []
    for at, part in rows.groupby(points, sort=False):
        labels: dict[str, Any] = dict(zip(points, at, strict=True))
        ordered = part.sort_values("bits")
        bits, budget = np.log(ordered["bits"]), np.log(BUDGET[labels["setting"]])
        measures = ordered.assign(bits=bits).drop(columns=[*points, "over_gamma"])
        found = {str(name): np.interp(budget, bits, column, left=np.nan) for name, column in measures.items()}
        made.append({**labels, "over_gamma": np.nan, **found, "bits": np.exp(found["bits"])})
    return pd.DataFrame(made)


def _figure(table: pd.DataFrame, until: float) -> Figure:
    figure, panels = figures.panels(2, 3, (14.0, 8.6))
    usual = table[(table["until"] == until) & table["over_gamma"].notna()]
    shown_settings = product(_ROWS.items(), (LOSS, DELAY, BOTH))
    for letter, axes, (row, setting) in zip("abcdef", panels, shown_settings, strict=True):
        measure, (words, label, scale) = row
        for place, cure in enumerate(CURES[setting]):
            bits, rows = (pick(usual, setting=setting, cure=cure, measure=name) for name in ("bits", measure))
            look: dict[str, Any] = {"linestyle": "-", "color": colour(place)}
            mark = place % len(figures.MARKS)
            figures.points(axes, bits["mean"].to_numpy(), rows, mark, cure, scale=100.0, **look)
        axes.axvline(BUDGET[setting], color=figures.REFERENCE, linewidth=1.0, linestyle=":")
        title = f"({letter}) {setting.capitalize()}: {words}"
        figures.dress(axes, title, "bits per control period", label, xscale="log", yscale=scale)
    figures.legends(panels[:3], fontsize="x-small")
    return figure


def _findings(table: pd.DataFrame, until: float, scale: float) -> list[str]:
    budget = pick(table, over_gamma=np.nan)
    found = []
    for setting, cures in CURES.items():
        compared = "; ".join(_said(budget, setting, cure) for cure in cures)
        risk = f"at most {BUDGET[setting]:g} bits a period, above the capacity for about 1 % of the time"
        found.append(f"{setting.capitalize()}, {risk}: {compared}.")
    longer = []
    for cure in _LONGER:
        at = {"setting": LOSS, "cure": cure, "over_gamma": scale, "measure": "misallocation"}
        ends = (over_draws(table, 100.0, 2, until=end, **at) for end in (until, 4.0 * until))
        longer.append(f"{cure} {' and '.join(ends)}")
    return [*found, f"Misallocation (%) after {until:g} and {4 * until:g} periods: {'; '.join(longer)}."]


def _said(budget: pd.DataFrame, setting: str, cure: str) -> str:
    at = {"setting": setting, "cure": cure}
    if number(budget, "draws", measure="bits", **at) < 2.0:
        return f"{cure}: takes more bits at every Gamma that does not saturate"
    shares = over_draws(budget, 100.0, 2, measure="misallocation", **at)
    use = over_draws(budget, 100.0, 1, measure="utilisation", **at)
    above = number(budget, measure="above", **at)
    risky = f", above the capacity for {100.0 * above:.0f} % of the time" if above > 2.0 * _RISK else ""
    return f"{cure}: {shares} % off, {use} % used{risky}"


main = command("cures", study, __doc__)

if __name__ == "__main__":
    main()
