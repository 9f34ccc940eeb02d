"""Multilevel splitting: the probability that a path reaches a level that hardly any path reaches.

Levels lie between what is common and what is rare.  A path that reaches one is gone on with several times,
with draws of its own each time, so that most of the work is done where the event is near.  Both methods are
unbiased for any levels: fixed effort spends the same number of trials on every level (L'Ecuyer,
Demers and Tuffin, ACM TOMACS 17 (2007) 9; Garvels, thesis, Twente 2000, chapter 2), and RESTART splits every
time a level is passed upwards and ends a retrial that falls below the level it was born at
(Villen-Altamirano, European Journal of Operational Research 221 (2012) 1).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from typing import Protocol, Self

import numpy as np

# Of the paths of a pilot, one in so many is to reach the next level; and into so many RESTART splits them.
_SPLIT = 5
# Levels of a pilot: a fifth to this power is below 1e-34.
_MOST_LEVELS = 50
# Steps of all paths of RESTART, before levels are refused as badly placed.
_MOST_STEPS = 10_000_000


class SplitPath(Protocol):
    """A path in progress, which may be gone on with more than once."""

    @property
    def reached(self) -> float:
        """The largest importance so far."""
        ...

    def fork(self, salt: int) -> Self:
        """Begin another path where this one stands, with other draws from now on."""
        ...

    def reach(self, level: float) -> bool:
        """Go on until the importance has reached a level, or to the end; say whether it has."""
        ...

    def step(self) -> float | None:
        """Go on by one step; return the largest importance within it, or None if the end is reached."""
        ...


@dataclass(frozen=True)
class Estimate:
    """One independent estimate."""

    probability: float  # unbiased; may be above 1 by RESTART
    # of the trials of each level, those that have reached it, up to the first that none has; empty by RESTART
    shares: tuple[float, ...] = ()


def find_levels(root: SplitPath, wanted: Sequence[float], trials: int) -> tuple[tuple[float, ...], bool]:
    """Choose levels by a pilot, each reached by a fifth of the paths from the one before, or by fewer."""
    salts, left = count(), list(wanted)
    states, levels = [root], list[float]()
    kept = max(2, trials // _SPLIT)
    while len(levels) < _MOST_LEVELS:
        # To the end, to see how far they go; those that go farthest are taken again, to where they pass.
        born = [(states[trial % len(states)], next(salts)) for trial in range(trials)]
        ways = [parent.fork(salt) for parent, salt in born]
        for way in ways:
            way.reach(left[0])
        reached = sorted((way.reached for way in ways), reverse=True)
        best = reached[kept - 1]
        if levels and best <= levels[-1]:
            # Fewer than that have gone on at all: the next level is as far as all of these have come.
            further = [each for each in reached if each > levels[-1]]
            if not further:
                return tuple(levels), False
            best = further[-1]
        if best >= left[0]:
            best = left.pop(0)
        levels.append(best)
        if not left:
            return tuple(levels), True
        again = [
            parent.fork(salt) for (parent, salt), way in zip(born, ways, strict=True) if way.reached >= best
        ]
        states = [state for state in again if state.reach(best)]
    return tuple(levels), False


def fixed_effort(root: SplitPath, levels: Sequence[float], trials: int, rng: np.random.Generator) -> Estimate:
    """Estimate by the same number of trials from the root and every level: the product of the shares."""
    salts, states, shares = count(), [root], list[float]()
    for level in levels:
        # Each state as often as the others, but for a remainder that is drawn: that lessens the variance.
        order = rng.permutation(len(states))
        ways = [states[order[trial % len(states)]].fork(next(salts)) for trial in range(trials)]
        states = [way for way in ways if way.reach(level)]
        shares.append(len(states) / trials)
        if not states:
            return Estimate(0.0, tuple(shares))
    return Estimate(float(np.prod(shares)), tuple(shares))


def restart(root: SplitPath, levels: Sequence[float], trials: int) -> Estimate | None:
    """Estimate by paths that are split into five at each level they pass; None where there are too many."""
    salts, hits, steps, splits = count(), 0, 0, len(levels) - 1
    # A path, how many levels it has passed, at which of them it was born, and what it has just seen.
    open_ways: list[tuple[SplitPath, int, int, float | None]] = []
    for _ in range(trials):
        main = root.fork(next(salts))
        open_ways.append((main, 0, 0, main.reached))
    while open_ways:
        way, passed, born, seen = open_ways.pop()
        while seen is not None:
            steps += 1
            if steps > _MOST_STEPS:
                return None
            if seen >= levels[-1]:
                # It counts for all that would have been born at the levels it has jumped over.
                hits += _SPLIT ** (splits - passed)
                break
            if passed and seen < levels[passed - 1]:
                while passed and seen < levels[passed - 1]:
                    passed -= 1
                if passed < born:
                    break
            elif passed < splits and seen >= levels[passed]:
                passed += 1
                retrials = (way.fork(next(salts)) for _ in range(_SPLIT - 1))
                open_ways.extend((retrial, passed, passed, seen) for retrial in retrials)
                continue
            seen = way.step()
    return Estimate(hits / (trials * _SPLIT**splits))
