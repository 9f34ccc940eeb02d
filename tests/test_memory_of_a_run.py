"""How much memory a run takes for each agent."""

import errno
import gc
import pickle
from collections.abc import Iterator
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest

from aimd_des import BroadcastChannel, Crossing, Fleet, PolynomialCosts, Recording, Simulation, latency
from aimd_des.utils import spare_arrays
from aimd_des.utils.jit import Kernel
from aimd_des.utils.spare_arrays import spare, spare_zeros
from models import smart_cameras

FEW, MORE = 1000, 2000


def arrays(*roots: object) -> Iterator[np.ndarray[Any, Any]]:
    """Yield all arrays that can be reached; views stand for what they look at."""
    seen: set[int] = set()
    left = list(roots)
    while left:
        thing = left.pop()
        # Nor through compiled code, which leads to all that Numba has.
        if id(thing) in seen or isinstance(thing, type | ModuleType | Kernel | BuiltinFunctionType):
            continue
        seen.add(id(thing))
        if not isinstance(thing, np.ndarray):
            # Of a function not the module, through which all of the package could be reached.
            left += thing.__closure__ or () if isinstance(thing, FunctionType) else gc.get_referents(thing)
        elif isinstance(thing.base, np.ndarray):
            left.append(thing.base)
        else:
            yield thing


def size(*roots: object) -> int:
    return sum(array.nbytes for array in arrays(*roots))


def simulation(n: int) -> Simulation:
    return Simulation(
        smart_cameras(n_cameras=n),
        dynamics="continuous",
        control_unit=Crossing(hold_off=1.0),
        channel=BroadcastChannel(latency=latency.Exponential(0.5), loss=0.1),
        agents=Fleet,
        recording=Recording("end", overshoot=False),
        seed=0,
    )


@pytest.fixture(scope="module")
def bytes_per_agent() -> dict[str, float]:
    """What the arrays of each stage take more with one agent more; what is left of earlier stages counts."""
    sizes = []
    for n in (FEW, MORE):
        given = simulation(n)
        begun = size(given)
        run = given.start(until=3.0)
        run.advance()
        sizes.append({"simulation": begun, "run": size(run), "result": size(run.result())})
    fewer, more = sizes
    return {stage: (more[stage] - fewer[stage]) / (MORE - FEW) for stage in fewer}


@pytest.mark.parametrize(
    ("stage", "most"),
    [
        # 12 coefficients, and 3 derivatives of degree 7.
        ("simulation", 8 * (12 + 3 * 8)),
        # Much of it is space for copies on their way, which takes memory only where it is written to.
        ("run", 1783),
        # Of the simulation, and: demand and average, six counts for each resource, and whether it is here.
        ("result", 8 * (12 + 3 * 8) + 8 * 3 * (2 + 6) + 1),
    ],
)
def test_an_agent_takes_no_more_memory_than_it_needs(
    bytes_per_agent: dict[str, float], stage: str, most: float
) -> None:
    # If more is needed, raise the number: a row of floats for each resource is 24 bytes here.
    assert bytes_per_agent[stage] <= most


def test_tables_that_no_run_reads_are_made_when_they_are_asked_for() -> None:
    given = simulation(60)
    result = given.run(3.0)
    tables = {"_indices", "_increase", "_decrease"}
    assert result.problem is given.problem
    assert not tables & vars(given.problem).keys()
    assert given.problem.agent_names[-1] == "59"
    assert given.problem.increase.shape == given.problem.decrease.shape == (60, 3)
    assert tables <= vars(given.problem).keys()


def test_a_run_of_few_agents_takes_little_memory() -> None:
    """Splitting keeps hundreds of them, each with total demand followed; they had 5.6 million bytes."""
    run = simulation(10).replace(recording=Recording()).start(until=3.0)
    run.advance()
    assert size(run) < 2_000_000


def in_use() -> int:
    """How much memory this process takes now, in bytes."""
    fields = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * next(int(line.split()[1]) for line in fields if line.startswith("VmRSS:"))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system does not tell")
def test_powers_that_no_agent_has_take_no_memory() -> None:
    n = 100_000
    coefficients = np.ones((n, 1, 2))
    before = in_use()
    costs = PolynomialCosts([1, 64], coefficients)
    table = costs.table()
    # Two rows of 64 are written.  Half of all rows is so far from both two and 64 that nothing else matters.
    assert in_use() - before < 8 * 32 * n
    costs = pickle.loads(pickle.dumps(costs))  # as a study hands them to its processes
    table = costs.table()
    assert np.shares_memory(table.slopes, costs.slopes)
    assert (table.slopes[0, 0] == 1.0).all()
    assert (table.slopes[0, 63] == 64.0).all()
    assert not table.slopes[0, 1:63].any()
    # What is read takes no memory either.
    assert in_use() - before < 8 * 32 * n


def test_zeros_can_be_written_wherever_they_come_from() -> None:
    for shape in ((2, 3), (3, 200_001)):
        zeros = spare_zeros(shape)
        assert not zeros.any()
        zeros[-1, 1:] = 7.0
        assert zeros.sum() == 7.0 * (shape[1] - 1)
        # The type by which compiled code knows an array.
        assert numba.typeof(zeros) == numba.typeof(np.zeros(shape))


@pytest.mark.parametrize("make", [spare, spare_zeros])
def test_what_the_system_refuses_is_a_lack_of_memory(make: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error of the system is taken for one of a file, which a study would end with."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    monkeypatch.setattr(spare_arrays, "mmap", SimpleNamespace(MAP_PRIVATE=2, MAP_ANONYMOUS=32, mmap=refuse))
    with pytest.raises(MemoryError, match=r"^Cannot allocate memory: 8388608 bytes$"):
        make((1 << 20,))
