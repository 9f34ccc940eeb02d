"""The paper's numbers, and what to say of ours: table and sentences of `scenarios.paper`."""

from typing import TYPE_CHECKING

import pandas as pd

from models.smart_cameras import INCREASES

if TYPE_CHECKING:
    from scenarios.paper import PaperStudy

__all__ = ["CAPACITY_EVENTS", "PAPER_STEPS", "caption", "grid", "markdown", "sentences", "table"]

#: What the paper reports: capacity events in 30,000 steps, a bound for the relative error.
CAPACITY_EVENTS = {"memory": 11_427, "disk": 11_988, "bandwidth": 8_355}
PAPER_STEPS = 30_000
_ERROR_BOUND = 0.05

# Column of the measures, its name in words, the factor and the format in which it is written.
_MEASURES = (
    ("signals", "capacity events", 1, "{:,.0f}"),
    ("relative_error", "relative error, %", 100, "{:.2f}"),
    ("unused", "unused capacity, %", 100, "{:.2f}"),
    ("misallocation", "misallocation, %", 100, "{:.2f}"),
    ("overshoot_peak", "peak / capacity", 1, "{:.3f}"),
    ("cost_ratio", "cost ratio", 1, "{:.3f}"),
)


def table(measures: pd.DataFrame, steps: int) -> pd.DataFrame:
    """Put the paper's numbers beside ours.

    Parameters
    ----------
    measures : DataFrame
        As in `PaperStudy`.
    steps : int
        Length of the runs: the paper's capacity events are scaled to it.

    Returns
    -------
    DataFrame
        Columns: increase, lag, measure, resource, paper, this_run (the first draw), mean, std
        (over the draws).  All measures but the signals are pure numbers.
    """
    rows = []
    for (increase, lag), case in measures.groupby(["increase", "lag"], sort=False):
        for column, *_ in _MEASURES:
            shared = column == "cost_ratio"  # one number for all resources together
            for resource in ["all"] if shared else list(CAPACITY_EVENTS):
                drawn = case[case["resource"] == ("memory" if shared else resource)][column]
                rows.append(
                    {
                        "increase": increase,
                        "lag": lag,
                        "measure": column,
                        "resource": resource,
                        "paper": _paper(column, resource, steps),
                        "this_run": drawn.iloc[0],
                        "mean": drawn.mean(),
                        "std": drawn.std(),
                    }
                )
    return pd.DataFrame(rows)


def _paper(column: str, resource: str, steps: int) -> str:
    """Say what the paper reports."""
    if column == "signals":
        return f"{CAPACITY_EVENTS[resource] * steps / PAPER_STEPS:.0f}"
    return {"relative_error": f"below {_ERROR_BOUND:g}", "cost_ratio": "close to 1"}.get(column, "")


def grid(study: "PaperStudy") -> tuple[list[str], list[list[str]]]:
    """Lay out the table for readers, both lags side by side.

    Parameters
    ----------
    study : PaperStudy
        What was found.

    Returns
    -------
    header, rows : list of str, list of list of str
        The last row is disk with the increase as printed.
    """
    header = ["measure", "resource", "paper", "run, lag 1", "draws, lag 1", "run, lag 0", "draws, lag 0"]
    numbers = table(study.measures, study.steps).set_index(["increase", "lag", "measure", "resource"])
    rows = []
    for column, words, factor, form in _MEASURES:
        for resource in ["all"] if column == "cost_ratio" else list(CAPACITY_EVENTS):
            with_lag = numbers.loc[("as_run", 1, column, resource)]
            without = numbers.loc[("as_run", 0, column, resource)]
            cells = [*_cells(with_lag, factor, form), *_cells(without, factor, form)]
            rows.append([words, resource, _for_readers(with_lag["paper"]), *cells])
    printed = numbers.loc[("as_printed", 1, "signals", "disk")]
    words = f"events, alpha {INCREASES['as_printed'][1]:g}"
    rows.append([words, "disk", _for_readers(printed["paper"]), *_cells(printed, 1, "{:,.0f}"), "", ""])
    return header, rows


def _for_readers(paper: str) -> str:
    return (
        f"{int(paper):,}"
        if paper.isdigit()
        else paper.replace(f"{_ERROR_BOUND:g}", f"{_ERROR_BOUND:.0%}"[:-1])
    )


def _cells(row: "pd.Series[float]", factor: int, form: str) -> list[str]:
    this, mean, std = (form.format(factor * row[column]) for column in ("this_run", "mean", "std"))
    return [this, f"{mean} ± {std}"]


def caption(study: "PaperStudy") -> str:
    """Say what the table shows.

    Parameters
    ----------
    study : PaperStudy
        What was found.

    Returns
    -------
    str
        One sentence.
    """
    return (
        f"60 cameras, {study.steps:,} steps: the run with seed {study.seed}, and mean ± standard deviation over "
        f"{study.draws} draws of the costs"
    )


def markdown(study: "PaperStudy") -> str:
    """Write table and sentences as Markdown.

    Parameters
    ----------
    study : PaperStudy
        What was found.

    Returns
    -------
    str
        A page.
    """
    header, rows = grid(study)
    lines = [
        "# The paper's experiment",
        "",
        caption(study),
        "",
        f"| {' | '.join(header)} |",
        f"|{'---|' * len(header)}",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
        *(f"- {sentence}" for sentence in sentences(study)),
    ]
    return "\n".join(lines) + "\n"


def sentences(study: "PaperStudy") -> list[str]:
    """Say where the paper's word and the figures differ, in computed numbers.

    Parameters
    ----------
    study : PaperStudy
        What was found.

    Returns
    -------
    list of str
        One or a few sentences for each point.
    """
    measures = study.measures
    first = measures[(measures["increase"] == "as_run") & (measures["lag"] == 1) & (measures["draw"] == 0)]
    scaled = (
        []
        if study.steps == PAPER_STEPS
        else [f"The paper's capacity events are scaled from {PAPER_STEPS:,} to {study.steps:,} steps."]
    )
    return [
        *scaled,
        _alpha(study),
        _cost(study, first),
        _split(first),
        _lag(study),
        _peaks(study),
        _event_driven(study),
    ]


def _of(study: "PaperStudy", increase: str, lag: int, column: str, resource: str) -> "pd.Series[float]":
    """One measure of one resource over the draws."""
    rows = study.measures
    chosen = (rows["increase"] == increase) & (rows["lag"] == lag) & (rows["resource"] == resource)
    return rows.loc[chosen, column]


def _distance(study: "PaperStudy", increase: str, lag: int, resource: str) -> float:
    """How many standard deviations the paper's capacity events lie from the mean over the draws."""
    drawn = _of(study, increase, lag, "signals", resource)
    paper = CAPACITY_EVENTS[resource] * study.steps / PAPER_STEPS
    return float(abs(paper - drawn.mean()) / drawn.std())


def _join(texts: list[str]) -> str:
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def _percent(share: float, digits: int = 1) -> str:
    return f"{100 * share:.{digits}f} %"


def _percents(shares: "pd.Series[float]", digits: int = 1) -> str:
    return _join([_percent(share, digits) for share in shares])


def _alpha(study: "PaperStudy") -> str:
    """Which additive increase of disk was run."""
    gives, far = {}, {}
    for increase, alphas in INCREASES.items():
        drawn = _of(study, increase, 1, "signals", "disk")
        far[increase] = _distance(study, increase, 1, "disk")
        gives[increase] = (
            f"{alphas[1]:g} ({10_000 * alphas[1]:g} MB) gives {drawn.mean():,.0f} ± {drawn.std():,.0f} capacity events, "
            f"{far[increase]:.1f} standard deviations from the paper's number"
        )
    nearest = min(far, key=far.__getitem__)
    verdict = "The printed value cannot be the one that was run." if nearest == "as_run" else ""
    return (
        f"Disk's additive increase, in units of 10 GB: the printed {gives['as_printed']}; {gives['as_run']}. {verdict}"
    ).rstrip()


def _cost(study: "PaperStudy", first: pd.DataFrame) -> str:
    """Why the cost ratio is not 1."""
    drawn = _of(study, "as_run", 1, "cost_ratio", "memory")
    ratio, use = float(first["cost_ratio"].iloc[0]), float(first["cost_of_use"].iloc[0])
    return (
        f"The cost ratio is {ratio:.3f} in this run and {drawn.mean():.3f} ± {drawn.std():.3f} over the draws, because "
        "the averages do not use up the capacities: each signal throws the total below its capacity, and it is "
        f"above in only {_percents(first['overshoot_time'], 0)} of the steps, so that on average "
        f"{_percents(first['unused'])} of memory, disk and bandwidth stay unused. To share optimally just "
        f"what was used would cost {use:.3f} of the optimum; the averages cost {_percent(ratio / use - 1.0, 2)} more than that."
    )


def _split(first: pd.DataFrame) -> str:
    """What the relative error is made of."""
    return (
        f"Of this run's relative errors, {_percents(first['relative_error'])}, unused capacity alone accounts for "
        f"{_percents(first['unused'])}: no way of sharing what was used could be nearer. Against the optimum "
        f"for what was used (misallocation) the averages are {_percents(first['misallocation'])} off."
    )


def _lag(study: "PaperStudy") -> str:
    """What the relative error says of the lag."""
    spans, fits = {}, {}
    for lag in (1, 0):
        error = _of(study, "as_run", lag, "relative_error", "bandwidth")
        fits[lag] = int((error < _ERROR_BOUND).sum())
        spans[lag] = (
            f"{_percent(error.min())} to {_percent(error.max())}, below 5 % in {fits[lag]} of {study.draws} draws,"
        )
    verdict = "fits the run without the lag" if fits[0] > fits[1] else "does not tell the two apart here"
    return (
        f"The relative error of bandwidth is {spans[1]} if a signal acts one step after the excess, as the "
        f"algorithms are printed (lag 1), and {spans[0]} if it acts in the same step (lag 0): the "
        f"paper's “below 5 %” {verdict}."
    )


def _peaks(study: "PaperStudy") -> str:
    """What counts and peaks say of the lag."""
    rows, counts, peaks, far = study.measures, {}, {}, {}
    for lag in (1, 0):
        far[lag] = [_distance(study, "as_run", lag, resource) for resource in CAPACITY_EVENTS]
        counts[lag] = _join([f"{distance:.1f}" for distance in far[lag]])
        case = rows[(rows["increase"] == "as_run") & (rows["lag"] == lag)]
        highest = case.groupby("resource", sort=False)[["overshoot_peak", "peak_bound"]].max()
        peaks[lag] = (
            f"{_join([f'{peak:.3f}' for peak in highest['overshoot_peak']])} of the capacities "
            f"(at most {_join([f'{bound:.3f}' for bound in highest['peak_bound']])})"
        )
    either = max(far[1]) <= 2.0 and max(far[0]) <= 2.0
    return (
        f"The paper's capacity events lie {counts[1]} standard deviations from the mean with lag 1 and {counts[0]} with "
        f"lag 0{', so they cannot tell which was run' if either else ''}. The peaks of the total could: {peaks[1]} with "
        f"lag 1, {peaks[0]} with lag 0. In brackets, one plus what all agents add in two steps, or one, over the capacity."
    )


def _event_driven(study: "PaperStudy") -> str:
    """Whether the event-driven simulation is the same system."""
    steps = study.event_driven_steps
    if study.same_digests:
        return (
            f"The event-driven run with latency 0.5 has the same digest over the first {steps} steps as the algorithm "
            "with lag 1, and with latency 0 the same as with lag 0."
        )
    return (
        f"The event-driven run differs from the algorithm within the first {steps} steps, which it must not."
    )
