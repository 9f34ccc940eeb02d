"""Do ten published findings hold with draws and seeds that the studies did not use?"""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t as student

from aimd_des import Crossing
from aimd_des.lowlevel import FloatArray
from aimd_des.study import mean_and_error
from benchmarks.harness import console, cpu_seconds, positive, table
from scenarios import (
    burst_loss,
    capacity_drop,
    continuous_vs_discrete,
    cures,
    delay,
    mesh,
    outage,
    unequal_delays,
    usable,
)
from scenarios.common.measure import run_draws
from scenarios.robust_responses import Drawn, measure_late

__all__ = ["CLAIMS", "Claim", "Verdict", "judge", "main", "measure"]

# No study has so many draws: what is measured from here on is independent of what is published.
_FIRST = 1_000
# The probability that any of the findings fails by chance, if all are true.
_FAMILY = 0.05
_COLUMNS = ("finding", "published", "measured", "difference", "allowed", "holds")
_LEGEND = (
    "± is half of a 95 % interval.  Allowed is half of Welch's interval for a difference of two means over\n"
    "draws, so wide that of {count} true findings any fails with a probability of 5 % at most (Bonferroni)."
)


@dataclass(frozen=True)
class Claim:
    """A finding as it is published, and how one of its study's draws is measured."""

    study: str
    # What holds and in which range; the number with its 95 % half-width, as docs/findings has it.
    sentence: str
    published: str
    draws: int  # of the study
    cases: Sequence[Any]
    run: Callable[[Any, int, int], Any]  # a case, a draw and a seed
    number: Callable[..., float]  # of the outcomes of one draw, one for each case

    @property
    def mean(self) -> float:
        """The number."""
        return float(self.published.split(" ± ")[0])

    @property
    def digits(self) -> int:
        """Decimals of the number."""
        return len(self.published.split(" ± ")[0].partition(".")[2])

    @property
    def variance(self) -> float:
        """Variance of the mean over draws, by its 95 % half-width."""
        return float((float(self.published.split(" ± ")[1]) / student.ppf(0.975, self.draws - 1)) ** 2)


CLAIMS = (
    Claim(
        "continuous_vs_discrete",
        "points of use that sampling adds (memory)",
        "2.26 ± 0.03",
        10,
        [
            continuous_vs_discrete.Case(name, 4_000.0)
            for name in ("continuous, sampled", "continuous, crossing")
        ],
        continuous_vs_discrete.measured,
        lambda sampled, crossing: 100.0 * float(sampled.utilisation[0] - crossing.utilisation[0]),
    ),
    Claim(
        "delay",
        "% off at latency 5, hold-off 0.1",
        "13.0 ± 0.4",
        10,
        [delay.Case(5.0, 0.1, 5_000.0)],
        delay.measure,
        lambda seen: 100.0 * seen["misallocation"],
    ),
    Claim(
        "usable",
        "latency up to which shares are 5 % off, hold-off 0.4, threshold 0.9",
        "10.4 ± 0.4",
        24,
        [usable.Case("latency", 32.0, 0.02, 0.4, 0.9, 3_000.0)],
        usable.search,
        lambda seen: seen["misallocation"],
    ),
    Claim(
        "mesh",
        "% off on a tree with every edge sent three times, loss to 0.3",
        "1.6 ± 0.1",
        12,
        [mesh.Case(mesh.THRICE, 0.3, 8_000.0)],
        mesh.measure,
        lambda seen: 100.0 * seen["from_plain"],
    ),
    Claim(
        "burst_loss",
        "% off with losses of 0 to 0.5 in bursts of 10, counted by 5 bits",
        "12.9 ± 1.0",
        10,
        [burst_loss.Answer("5 bits", 0.25, 10.0, 5_000.0)],
        burst_loss.answer,
        lambda seen: 100.0 * seen["misallocation"],
    ),
    Claim(
        "capacity_drop",
        "periods to recover from a drop of 20 %, forgetting",
        "244 ± 2",
        12,
        [capacity_drop.Drop(capacity_drop.PAPER, "forgetting", 0.0, 600.0, 400.0, left=0.8)],
        capacity_drop.recover,
        lambda seen: seen[capacity_drop.LEVEL],
    ),
    Claim(
        "outage",
        "periods to come back after silence of 20, hold-off 1",
        "13.7 ± 1.4",
        16,
        [outage.Outage(outage.ALL, 20.0, 0.5, 1.0, 200.0)],
        outage.measure,
        lambda seen: seen.numbers[outage.BACK],
    ),
    Claim(
        "robust_responses",
        "% of the time above, threshold from theory, latency 1, hold-off 0.5",
        "0.75 ± 0.01",
        10,
        [Drawn("", "", 1.0, Crossing(0.5), 1.0, 0.0, 12_500.0, safe=1.0)],
        measure_late,
        lambda seen: 100.0 * seen["above"],
    ),
    Claim(
        "unequal_delays",
        "what being early gives three of 60, as a factor, mean latency 10",
        "1.000 ± 0.002",
        16,
        [
            unequal_delays.Case(mixture, 10.0, 0.5, 16_000.0)
            for mixture in (unequal_delays.THREE, unequal_delays.ALL)
        ],
        unequal_delays.measure,
        lambda early, alike: early["three"] / alike["three"],
    ),
    Claim(
        "cures",
        "% off with losses of 0 to 0.5 that are known, Gamma 1/80",
        "1.6 ± 0.2",
        12,
        [cures.Case(cures.LOSS, cures.KNOWN, 80.0, 5_000.0)],
        cures.measure,
        lambda seen: 100.0 * seen["misallocation"],
    ),
)


@dataclass(frozen=True)
class Verdict:
    """What was measured of a claim, and whether it differs from what is published by more than chance."""

    claim: Claim
    mean: float
    half: float  # of the 95 % interval of what was measured
    allowed: float  # the difference that chance allows

    @property
    def difference(self) -> float:
        """What was measured, less what is published."""
        return self.mean - self.claim.mean

    @property
    def holds(self) -> bool:
        """Whether chance allows the difference."""
        return abs(self.difference) <= self.allowed


def measure(claim: Claim, draws: int, first: int) -> FloatArray:
    """Measure the number of a claim with draws from `first` on, (draws,)."""
    pairs = run_draws(claim.run, claim.cases, draws, 1, first, quick=True)
    return np.array(
        [claim.number(*(one for (one,) in outcomes)) for outcomes in zip(*(f for _, f in pairs), strict=True)]
    )


def judge(claim: Claim, values: FloatArray, findings: int) -> Verdict:
    """Compare values of single draws with what is published, as one of so many findings.

    What is published is rounded, which adds the variance of a uniform number to that of the difference.
    """
    mean, error = (float(part) for part in mean_and_error(values))
    ours, theirs, rounding = error**2, claim.variance, 10.0 ** (-2 * claim.digits) / 12.0
    freedom = (ours + theirs) ** 2 / (ours**2 / (len(values) - 1) + theirs**2 / (claim.draws - 1))
    quantile = float(student.ppf(1.0 - 0.5 * _FAMILY / findings, freedom))
    half = float(student.ppf(0.975, len(values) - 1)) * error
    return Verdict(claim, mean, half, quantile * float(np.sqrt(ours + theirs + rounding)))


def _row(verdict: Verdict) -> tuple[str, ...]:
    claim, digits = verdict.claim, verdict.claim.digits + 1
    return (
        f"{claim.study}: {claim.sentence}",
        claim.published,
        f"{verdict.mean:.{digits}f} ± {verdict.half:.{digits}f}",
        f"{verdict.difference:+.{digits}f}",
        f"{verdict.allowed:.{digits}f}",
        "yes" if verdict.holds else "NO",
    )


def main(arguments: list[str] | None = None, claims: Iterable[Claim] = CLAIMS) -> int:
    """Measure and print the table; returns 1 if a finding does not hold, else 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--draws", type=positive, default=10, help="of costs, at least 2 (default: %(default)s)"
    )
    parser.add_argument(
        "--first",
        type=int,
        default=_FIRST,
        help="draw; the studies have 0 to 23, which repeat what is published (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    if options.draws < 2:
        parser.error(f"--draws {options.draws}: must be at least 2")
    if options.first < 0:
        parser.error(f"--first {options.first}: must be at least 0")
    claims, begun = tuple(claims), cpu_seconds()
    verdicts = [judge(claim, measure(claim, options.draws, options.first), len(claims)) for claim in claims]
    out, last = console(), options.first + options.draws - 1
    title = f"{len(claims)} findings with draws {options.first} to {last}"
    out.print(table(title, _COLUMNS, [_row(verdict) for verdict in verdicts]))
    out.print(_LEGEND.format(count=len(claims)))
    held = sum(verdict.holds for verdict in verdicts)
    out.print(f"{held} of {len(claims)} hold; {cpu_seconds() - begun:.0f} CPU seconds.")
    return int(held < len(verdicts))


if __name__ == "__main__":
    sys.exit(main())
