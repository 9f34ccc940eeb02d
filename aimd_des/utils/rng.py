"""Named random streams, and draws that have an address instead of a turn.

Every stream descends from one seed: ``SeedSequence(seed, spawn_key=(purpose,))`` gives a Philox
key; in a fork with draws of its own, the spawn key has its salts besides.  The uniform number of agent i for
broadcast b of resource j is word i mod 4 of block (i div 4 + 1, lane, j, b) of Philox-4x64-10 (Salmon,
Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011).  It is the same number in any
order of processing and with any number of other agents; ``numpy.random.Philox`` produces the very same bits.
The lane is 0 but where one broadcast needs several numbers for an agent (a second copy, a rejected draw).
"""

from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.jit import formula, instruction, kernel, routine, shared
from aimd_des.utils.opaque import opaque
from aimd_des.utils.validation import FloatArray

Key = tuple[np.uint64, np.uint64]
WordArray = npt.NDArray[np.uint64]

_MULTIPLIER = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_WEYL = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_ROUNDS = 10

#: How many uniform numbers a block gives.
FOUR = 4

# A double has 53 bits: drop the lowest 11 of the 64 and scale to [0, 1).
_DROPPED, _SCALE = np.uint64(11), 1.0 / 9007199254740992.0

_M0, _M1 = _MULTIPLIER
_W0, _W1 = _WEYL


class Purpose(IntEnum):
    """What a stream is for; the number is its spawn key and never changes."""

    PROBLEM = 0
    RESPONSE = 1
    LOSS = 2
    LATENCY = 3
    CLOCK = 4
    DUPLICATION = 5
    SENSING = 6


def key(seed: int, purpose: Purpose, salts: tuple[int, ...] = ()) -> Key:
    """Derive the Philox key of one purpose.

    Parameters
    ----------
    seed : int
        The run's seed, at least 0.
    purpose : Purpose
        What the stream is for.
    salts : tuple of int
        Of the forks that have led to the run and were given other draws, from the first on.

    Returns
    -------
    tuple of two uint64
        The key.

    Raises
    ------
    InputError
        If the seed is no integer of at least 0.
    """
    return _key(validation.integer("seed", seed, low=0), (int(purpose), *salts))


# Points of a study share their seeds.
@lru_cache(maxsize=1 << 10)
def _key(seed: int, address: tuple[int, ...]) -> Key:
    first, second = np.random.SeedSequence(seed, spawn_key=address).generate_state(2, np.uint64)
    return first, second


def generator(seed: int, purpose: Purpose) -> np.random.Generator:
    """Make a generator for draws that need no address, such as the making of a problem.

    Parameters
    ----------
    seed : int
        The run's seed, at least 0.
    purpose : Purpose
        What the stream is for.

    Returns
    -------
    numpy.random.Generator
        On Philox, with the purpose's key.
    """
    # Philox takes its key as an array; the second word completes the 128 bits.
    return np.random.Generator(np.random.Philox(key=np.array(key(seed, purpose), dtype=np.uint64)))


@instruction
def _multiply_wide(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Multiply two 64-bit words to the high and low word of their 128-bit product."""
    product = int(a) * int(b)
    return np.uint64(product >> 64), np.uint64(product & 0xFFFFFFFFFFFFFFFF)


@kernel
def _block(c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, key: Key) -> Any:
    """Encrypt one counter: four words of 64 random bits."""
    k0, k1 = key
    for _ in range(_ROUNDS):
        high0, low0 = _multiply_wide(_M0, c0)
        high1, low1 = _multiply_wide(_M1, c2)
        c0, c1, c2, c3 = high1 ^ c1 ^ k0, low1, high0 ^ c3 ^ k1, low0
        k0 += _W0
        k1 += _W1
    return c0, c1, c2, c3


@formula
def four_words(key: Key, resource: int, number: int, lane: int, block: int) -> Any:
    """Draw the random words of the agents of one block, 4 * block and the three after it."""
    # Block by block: LLVM would take two of them as vectors, which have no wide product, take these apart for
    # each of twenty products, and be half as fast.
    counter = opaque(np.uint64(block + 1))
    return _block(counter, np.uint64(lane), np.uint64(resource), np.uint64(number), key)


@formula
def uniform_of(word: np.uint64) -> float:
    """Turn a random word to a uniform number."""
    return (word >> _DROPPED) * _SCALE


@formula
def draw_words(key: Key, resource: int, number: int, lane: int, words: WordArray) -> None:
    """Fill `words`, whole blocks of them, with those of agents 0, 1, ... for one broadcast."""
    for block in range(words.shape[0] // FOUR):
        i = FOUR * block
        words[i], words[i + 1], words[i + 2], words[i + 3] = four_words(key, resource, number, lane, block)


@shared
def uniforms_row(key: Key, resource: int, number: int, lane: int, out: FloatArray) -> None:
    """Fill `out` with the draws of agents 0, 1, ... for one broadcast."""
    # Words first, in the place of the numbers: several are converted at once.
    words, whole = out.view(np.uint64), out.shape[0] // FOUR
    draw_words(key, resource, number, lane, words)
    if FOUR * whole < out.shape[0]:
        last = four_words(key, resource, number, lane, whole)
        for rest in range(out.shape[0] - FOUR * whole):
            words[FOUR * whole + rest] = last[rest]
    for i in range(out.shape[0]):
        out[i] = uniform_of(words[i])


@routine
def uniform_at(key: Key, resource: int, number: int, lane: int, agent: int) -> float:
    """Draw the uniform number of one agent: what `uniforms_row` puts at its place."""
    return float(uniform_of(four_words(key, resource, number, lane, agent // FOUR)[agent % FOUR]))


def uniforms(key: Key, resource: int, number: int, n_agents: int, lane: int = 0) -> npt.NDArray[np.float64]:
    """Draw the uniform numbers of all agents for one broadcast.

    Parameters
    ----------
    key : tuple of two uint64
        The key of the purpose.
    resource : int
        j, the resource the broadcast is about.
    number : int
        b, its number among the broadcasts for that resource.
    n_agents : int
        How many agents; a larger number only adds draws at the end.
    lane : int
        Which of several numbers for the same agent and broadcast.

    Returns
    -------
    ndarray, shape (n_agents,)
        Uniform on [0, 1).
    """
    out = np.empty(n_agents)
    uniforms_row(key, resource, number, lane, out)
    return out
