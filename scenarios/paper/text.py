"""Where the paper's word and the figures differ: the sentences of `scenarios.paper`."""

from math import ceil

import pandas as pd

from models.smart_cameras import INCREASES
from scenarios.paper.table import CAPACITY_EVENTS, ERROR_BOUND, PAPER_STEPS, PaperStudy, caption, grid


def markdown(study: PaperStudy) -> str:
    """Write table and sentences as a page of Markdown."""
    header, rows = grid(study)
    lines = [
        "# The paper's experiment",
        "",
        f"{caption(study)}.",
        "",
        f"| {' | '.join(header)} |",
        f"|---|---|{'---:|' * (len(header) - 2)}",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
        *(f"- {sentence}" for sentence in sentences(study)),
    ]
    return "\n".join(lines) + "\n"


def sentences(study: PaperStudy) -> list[str]:
    """Say where the paper's word and the figures differ, in computed numbers, a few sentences a point."""
    scaled = f"The paper's capacity events are scaled from {PAPER_STEPS:,} to {study.steps:,} steps."
    return [
        *([] if study.steps == PAPER_STEPS else [scaled]),
        _alpha(study),
        _cost(study),
        _split(study),
        _lag(study),
        _peaks(study),
        _event_driven(study),
    ]


def _case(study: PaperStudy, lag: int, increase: str = "as_run") -> pd.DataFrame:
    """Take the measures of one way of running, all draws and resources."""
    rows = study.measures
    return rows[(rows["increase"] == increase) & (rows["lag"] == lag)]


def _first(study: PaperStudy) -> pd.DataFrame:
    """Take the measures of the run that is drawn, one row per resource."""
    case = _case(study, 1)
    return case[case["draw"] == 0]


def _events(study: PaperStudy, lag: int, resource: str, increase: str = "as_run") -> tuple[str, float]:
    """Sum up capacity events: mean and spread in words, and standard deviations to the paper's number."""
    case = _case(study, lag, increase)
    drawn = case.loc[case["resource"] == resource, "signals"]
    mean, std = float(drawn.mean()), float(drawn.std())
    paper = CAPACITY_EVENTS[resource] * study.steps / PAPER_STEPS
    return f"{mean:,.0f} ± {std:,.0f}", abs(paper - mean) / std


def _percent(share: float, digits: int = 1) -> str:
    return f"{100 * share:.{digits}f} %"


def _percents(shares: "pd.Series[float]", digits: int = 1) -> str:
    return _join([_percent(share, digits) for share in shares])


def _join(texts: list[str]) -> str:
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def _alpha(study: PaperStudy) -> str:
    """Tell which additive increase of disk was run."""
    gives, far = {}, {}
    for increase, alphas in INCREASES.items():
        counts, far[increase] = _events(study, 1, "disk", increase)
        gives[increase] = (
            f"{alphas[1]:g} ({10_000 * alphas[1]:g} MB) gives {counts} capacity events, {far[increase]:.1f}"
        )
    clear = far["as_printed"] > 5.0 and far["as_run"] <= 2.0
    return (
        f"Disk's printed increase of {gives['as_printed']} standard deviations from the paper's number. "
        f"An increase of {gives['as_run']} from it."
        f"{' The printed value cannot be the one that was run.' if clear else ''}"
    )


def _cost(study: PaperStudy) -> str:
    """Explain why the cost ratio is not 1."""
    first, drawn = _first(study), _case(study, 1)["cost_ratio"]
    ratio, use = float(first["cost_ratio"].iloc[0]), float(first["cost_of_use"].iloc[0])
    return (
        f"The cost ratio is {ratio:.3f} in this run and {drawn.mean():.3f} over the draws, as totals are "
        f"above the capacities in only {_percents(first['overshoot_time'], 0)} of the steps. Optimal "
        f"shares of what was used would cost {use:.3f}; the averages cost "
        f"{_percent(ratio / use - 1.0, 2)} more."
    )


def _split(study: PaperStudy) -> str:
    """Split the relative error into what is unused and what is shared wrongly."""
    first = _first(study)
    unused = float((first["unused"] / first["relative_error"]).min())
    return (
        f"Of this run's relative errors at least {_percent(unused, 0)} is unused capacity. The misallocation "
        f"is {_percents(first['misallocation'])}."
    )


def _lag(study: PaperStudy) -> str:
    """Tell which lag fits the paper's bound of the relative error."""
    spans, fits = {}, {}
    for lag in (1, 0):
        case = _case(study, lag)
        error = case.loc[case["resource"] == "bandwidth", "relative_error"]
        fits[lag] = int((error < ERROR_BOUND).sum())
        spans[lag] = (
            f"{_percent(error.min())} to {_percent(error.max())}, "
            f"below {100 * ERROR_BOUND:g} % in {fits[lag]} of {study.draws} draws."
        )
    verdict = "fits the run without the lag" if fits[0] > fits[1] else "does not tell the two apart here"
    return (
        f"With lag 1 the relative error of bandwidth is {spans[1]} With lag 0 it is {spans[0]} "
        f"The paper's “below {100 * ERROR_BOUND:g} %” {verdict}."
    )


def _peaks(study: PaperStudy) -> str:
    """Tell what counts and peaks say of the lag."""
    counts, largest, below = {}, 0.0, 0.0
    for lag in (1, 0):
        far = [_events(study, lag, resource)[1] for resource in CAPACITY_EVENTS]
        largest = max(largest, *far)
        counts[lag] = _join([f"{distance:.1f}" for distance in far])
        highest = _case(study, lag).groupby("resource", sort=False)[["overshoot_peak", "peak_bound"]].max()
        below = max(below, float((highest["peak_bound"] - highest["overshoot_peak"]).max()))
    return (
        f"The paper's capacity events lie {counts[1]} standard deviations from the mean with lag 1 and "
        f"{counts[0]} with lag 0{', so they cannot tell which was run' if largest <= 2.0 else ''}. Peaks "
        "could: they exceed the capacity by what all agents add in two steps with lag 1, in one with lag 0, "
        f"to within {ceil(1e3 * below - 1e-9) / 1e3:g} of the capacity."
    )


def _event_driven(study: PaperStudy) -> str:
    """Say whether the event-driven simulation is the same system."""
    steps = study.event_driven_steps
    if not study.same_digests:
        return f"The event-driven run differs from the algorithm over the first {steps} steps: a fault."
    return (
        f"Over the first {steps} steps the event-driven run has the digest of the algorithm: latency 0.5 "
        "that of lag 1, latency 0 that of lag 0."
    )
