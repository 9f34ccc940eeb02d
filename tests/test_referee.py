"""The referee's script: what it takes for chance, that it can fail, and that it judges what is published."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t as student
from scipy.stats import ttest_ind_from_stats

from benchmarks.referee import CLAIMS, Claim, judge, main

FINDINGS = Path(__file__).parents[1] / "docs" / "findings"
DELAY = next(claim for claim in CLAIMS if claim.study == "delay")


def _made_up(published: str, draws: int) -> Claim:
    return replace(DELAY, published=published, draws=draws)


def test_ten_findings_are_of_ten_studies() -> None:
    assert len(CLAIMS) == len({claim.study for claim in CLAIMS}) == 10


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.study)
def test_what_is_judged_is_what_the_page_says(claim: Claim) -> None:
    page = (FINDINGS / f"{claim.study}.md").read_text(encoding="utf-8")
    assert re.search(rf"(?<![\d.]){re.escape(claim.published)}(?![\d.]*\d)", " ".join(page.split()))


# Three runs of 6,000 periods each time.
@pytest.mark.parametrize(("moved", "status", "told"), [(0.0, 0, "yes"), (10.0, 1, "NO")])
def test_a_finding_holds_and_does_not_where_it_is_moved_by_ten_half_widths(
    moved: float, status: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    mean, half = map(float, DELAY.published.split(" ± "))
    claim = replace(DELAY, published=f"{mean + moved * half:.1f} ± {half}")
    assert main(["--draws", "3"], [claim]) == status
    row = next(line for line in capsys.readouterr().out.splitlines() if "delay:" in line)
    assert claim.published in row
    assert row.split()[-1] == told


@pytest.mark.parametrize("option", [["--draws", "1"], ["--first", "-1"]])
def test_what_cannot_be_judged_is_refused(option: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(option)
    assert refused.value.code == 2
    assert f"{option[0]} {option[1]}: must be at least" in capsys.readouterr().err


def test_what_is_allowed_is_where_the_test_of_welch_gives_a_tenth_of_the_risk() -> None:
    draws, half = 12, 0.5
    values = np.random.default_rng(1).normal(3.0, 2.0, 7)
    # So many digits that rounding is nothing.
    verdict = judge(_made_up(f"3.000000000 ± {half:.9f}", draws), values, 10)
    spread = half / student.ppf(0.975, draws - 1) * np.sqrt(draws)
    found = ttest_ind_from_stats(
        verdict.allowed, values.std(ddof=1), len(values), 0.0, spread, draws, equal_var=False
    )
    assert found.pvalue == pytest.approx(0.05 / 10, rel=1e-6)


def test_rounding_of_what_is_published_is_allowed_for() -> None:
    values = np.array([3.0, 3.1, 2.9])
    fine, coarse = (judge(_made_up(number, 10), values, 1).allowed for number in ("3.000 ± 0.1", "3 ± 0.1"))
    rounding = (1.0 - 1e-6) / 12.0
    ratio = np.sqrt(1.0 + rounding / _variance(values))
    assert coarse / fine == pytest.approx(ratio, rel=1e-6)


def _variance(values: np.ndarray) -> float:
    """Variance of the difference from "3.000 ± 0.1", its rounding included."""
    published = (0.1 / student.ppf(0.975, 9)) ** 2
    return float(values.var(ddof=1) / len(values) + published + 1e-6 / 12.0)


def test_true_findings_fail_by_chance_as_seldom_as_promised() -> None:
    # 200 tables of ten findings that are true, published over 12 draws and measured over 10; seed 2.
    tables, rng, failed = 200, np.random.default_rng(2), 0
    for _ in range(tables):
        theirs, ours = rng.normal(size=(10, 12)), rng.normal(size=(10, 10))
        halves = student.ppf(0.975, 11) * theirs.std(axis=1, ddof=1) / np.sqrt(12.0)
        claims = [
            _made_up(f"{mean:.6f} ± {half:.6f}", 12)
            for mean, half in zip(theirs.mean(axis=1), halves, strict=True)
        ]
        failed += not all(judge(claim, row, 10).holds for claim, row in zip(claims, ours, strict=True))
    # Ten findings that do not depend on each other: by Bonferroni a little less than the 5 % promised.
    chance = 1.0 - (1.0 - 0.05 / 10) ** 10
    error = np.sqrt(chance * (1.0 - chance) / tables)
    assert abs(failed / tables - chance) < 3.5 * error
    # As separate tests at 5 % each four in ten tables would fail.
    assert 1.0 - 0.95**10 - chance > 10.0 * error
