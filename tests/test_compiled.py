"""Compiled code gives the bits of the source it is made from, and is made anew when any source changes."""

import importlib.util
import os
import shutil
import tomllib
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError

from aimd_des.problem.costs import Costs, cost_table, marginal_cost
from aimd_des.problem.costs.kernels import gradient_row
from aimd_des.scenario import Scenario
from aimd_des.utils.compiling import ABOVE_KERNELS
from tests.conftest import INLINE, ROOT, random_problem
from tests.forks import FILE, compilers
from tests.test_layering import ORDER

SOURCE = """
import numpy as np
from aimd_des.utils.jit import announced, formula, kernel, routine

@formula
def line(x, alpha, steps):
    return x + alpha * steps

@kernel
def lines(x, alpha, steps, out):
    for i in range(out.shape[0]):
        out[i] = line(x[i], alpha[i], steps[i])

@kernel
def total(values):
    added = 0.0
    for value in values:
        added += value
    return added

@kernel
def ratio(one, other):
    return one / other

@announced("a thing (a moment)")
def twice(x):
    return 2.0 * x

@routine
def allocate(n):
    return np.zeros(n)[0]

@routine
def scaled(x, factor):
    return factor * x

@kernel
def thrice(x, factor):
    return scaled(x, 0) + scaled(x, 1) + scaled(x, factor=2) + scaled(x, factor)
"""


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """A module of its own, so that its compiled code is kept in a folder of its own."""
    path = tmp_path_factory.mktemp("compiled") / "compiled_here.py"
    path.write_text(SOURCE, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec
    assert spec.loader
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def inputs(size: int) -> Any:
    rng = np.random.default_rng(0)
    return (
        rng.uniform(0.0, 3.0, size),
        rng.uniform(0.0, 0.1, size),
        rng.integers(1, 10_000, size).astype(float),
    )


def test_a_kernel_multiplies_and_adds_with_two_roundings_as_python_does(module: ModuleType) -> None:
    x, alpha, steps = inputs(20_000)
    out = np.empty_like(x)
    module.lines(x, alpha, steps, out)
    rows = zip(x.tolist(), alpha.tolist(), steps.tolist(), strict=True)
    assert out.tolist() == [module.line(*row) for row in rows]


def test_one_rounding_would_be_noticed(module: ModuleType) -> None:
    """A fused multiply-add, computed exactly and rounded once, differs for many of these inputs."""
    rows = zip(*(values.tolist() for values in inputs(2000)), strict=True)
    fused = [
        float(Fraction(x) + Fraction(alpha) * Fraction(steps)) != module.line(x, alpha, steps)
        for x, alpha, steps in rows
    ]
    assert sum(fused) > 100


def test_a_kernel_adds_in_the_order_of_the_source(module: ModuleType) -> None:
    values = np.random.default_rng(1).uniform(-1.0, 1.0, 100_001)
    added = 0.0
    for value in values.tolist():
        added += value
    assert module.total(values) == added
    assert added != values.sum()  # NumPy adds pairwise, which is another sum


def test_a_kernel_divides_by_zero_as_arrays_do(module: ModuleType) -> None:
    assert module.ratio(1.0, 0.0) == np.inf


def test_a_formula_is_the_function_and_a_kernel_keeps_its_source(module: ModuleType) -> None:
    assert module.line(1.0, 0.5, 4.0) == 3.0
    assert type(module.line) is type(test_a_kernel_divides_by_zero_as_arrays_do)
    assert module.total.py_func(np.array([1.0, 2.0])) == 3.0


def cached_program(package: Path) -> Callable[..., list[str]]:
    """A copy of the package with a kernel that uses a formula of another file; run it in a fresh process.

    What it says on its standard error comes last, if a source is edited before it calls the kernel.
    """
    shutil.copytree(ROOT / "aimd_des", package / "aimd_des", ignore=shutil.ignore_patterns("__pycache__"))
    (package / "aimd_des" / "outer.py").write_text(
        "from aimd_des.utils.jit import kernel\nfrom aimd_des.inner import times\n\n"
        "@kernel\ndef apply(x):\n    return times(x)\n",
        encoding="utf-8",
    )
    # Numba has asked the installed package what it has to be taught: the copy is imported in its place.
    program = (
        "import sys\nfor name in [*sys.modules]:\n    if 'aimd_des' in name: del sys.modules[name]\n"
        "from aimd_des.outer import apply\n"
        "import os, time\n"
        "for path in sys.argv[1:]: os.utime(path, (time.time() + 1.0,) * 2)\n"
        "print(apply(21.0), sum(apply.dispatcher.stats.cache_hits.values()))"
    )

    def run(*edited: Path) -> list[str]:
        outcome = compilers().run(program, *map(str, edited), cwd=package, NUMBA_CACHE_DIR="")
        assert outcome.returncode == 0, outcome.stderr
        return [*outcome.stdout.split(), *([outcome.stderr] if edited else [])]

    return run


def test_a_kernel_is_compiled_anew_when_a_formula_of_another_file_changes(tmp_path: Path) -> None:
    inner = tmp_path / "aimd_des" / "inner.py"
    run = cached_program(tmp_path)
    # Numbers of other lengths: Python takes byte code for that of a source of the same second and size.
    formula = "from aimd_des.utils.jit import formula\n\n@formula\ndef times(x):\n    return {} * x\n"
    inner.write_text(formula.format("2.0"), encoding="utf-8")
    assert run() == ["42.0", "0"]
    assert run() == ["42.0", "1"]  # from the cache
    inner.write_text(formula.format("3.00"), encoding="utf-8")
    assert run() == ["63.0", "0"]
    # What is imported may be older than the source then: it must not be kept as made of the source.
    inner.write_text(formula.format("5.000"), encoding="utf-8")
    number, hits, said = run(inner)
    assert (number, hits) == ("105.0", "0")
    assert said.startswith("compiled code is not kept (the sources have changed since they were imported)")
    assert "start Python again" in said
    assert run() == ["105.0", "0"]


def test_no_kernel_can_depend_on_what_leaves_it_as_it_was() -> None:
    # What stands above the last kernels is imported by nothing below it (see test_layering); faces have none.
    above = ORDER[ORDER.index("interventions") + 1 :]
    faces = {
        "_deprecated",
        "_version",
        "averaging",
        "compensation",
        "latency",
        "loss",
        "lowlevel",
        "topology",
        "theory",
        "plots",
    }
    assert {"__init__", *above, *faces} == ABOVE_KERNELS
    for path in (ROOT / "aimd_des").rglob("*.py"):
        if Path(path.relative_to(ROOT / "aimd_des").parts[0]).stem in ABOVE_KERNELS:
            text = path.read_text(encoding="utf-8").replace("aimd_des.utils.jit import teach_numba\n", "")
            assert "aimd_des.utils.jit" not in text


def derivatives(costs: Costs, averages: Any) -> Any:
    """All derivatives at averages of shape (m, n), by the kernel."""
    m, n = averages.shape
    out, spare = np.empty((m, n)), np.empty((2, n))
    for j in range(m):
        gradient_row(cost_table(costs), averages, j, out[j], spare)
    return out


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 9),
    st.integers(1, 3),
    st.sampled_from(["polynomial", "coupled"]),
)
def test_one_agents_derivative_has_the_bits_of_the_kernel(seed: int, n: int, m: int, family: str) -> None:
    costs = random_problem(seed, n, m, family).costs
    averages = np.random.default_rng(seed).uniform(0.0, 3.0, (m, n))
    compiled = derivatives(costs, averages)
    singles = [marginal_cost(costs, i) for i in range(n)]
    columns = averages.T.tolist()
    assert compiled.tolist() == [[singles[i](columns[i], j) for i in range(n)] for j in range(m)]
    np.testing.assert_allclose(compiled, costs.gradient(averages.T).T, rtol=1e-13)


def test_what_takes_long_to_compile_is_announced_once(
    module: ModuleType, caplog: pytest.LogCaptureFixture
) -> None:
    assert [module.twice(1.5), module.twice(2.5)] == [3.0, 5.0]
    assert [record.getMessage() for record in caplog.records] == [
        "compiling a thing (a moment), which is done once on a machine; please wait"
    ]


def test_compiling_is_announced_whatever_is_compiled(tmp_path: Path) -> None:
    """In a process of its own, which has told nobody of anything yet; what takes long is told besides."""
    (tmp_path / "compiled_here.py").write_text(SOURCE, encoding="utf-8")
    program = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from compiled_here import ratio, twice, scaled\n"
        "ratio(1.0, 2.0), scaled(2.0, 3), twice(2.0), ratio(1, 2)"
    )
    told = [
        f"compiling {what}, which is done once on a machine; please wait"
        for what in ("formulas (some seconds)", "a thing (a moment)")
    ]
    for lines in (told, []):  # the second time everything comes from the disk
        outcome = compilers().run(program, str(tmp_path), NUMBA_CACHE_DIR="")
        assert (outcome.returncode, outcome.stderr.splitlines()) == (0, lines)


FORKED = """
import os, sys
sys.path.insert(0, sys.argv[1])
from compiled_here import thrice
gate, go = os.pipe()
children = []
for child in range(3):
    there, here = os.pipe()
    if (pid := os.fork()) == 0:
        os.close(go)
        os.read(gate, 1)  # until all are there
        result = thrice(1.5, 3)
        os.write(here, bytes([int(result), sum(thrice.dispatcher.stats.cache_misses.values())]))
        os._exit(0)
    children.append((pid, there))
os.close(go)
for pid, there in children:
    os.waitpid(pid, 0)
    print(*os.read(there, 2))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system cannot copy processes")
def test_a_kernel_is_compiled_by_one_process_while_others_wait(tmp_path: Path) -> None:
    (tmp_path / "compiled_here.py").write_text(SOURCE, encoding="utf-8")
    outcome = compilers().run(FORKED, str(tmp_path), NUMBA_CACHE_DIR="")
    assert outcome.returncode == 0, outcome.stderr
    assert sorted(outcome.stdout.splitlines()) == ["9 0", "9 0", "9 1"]


def test_numbers_written_out_in_calls_make_no_code_of_their_own(module: ModuleType) -> None:
    assert module.thrice(1.5, 3) == 9.0
    part = module.scaled.dispatcher.get_overload.__self__
    assert len(part.signatures) == 1


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("m", [1, 2])
def test_one_cost_table_has_the_types_of_all(n: int, m: int) -> None:
    """Or all that uses it would be compiled once more, which for the fleet takes ten seconds."""
    kinds = {
        numba.typeof(cost_table(random_problem(0, *size, family).costs))
        for size in ((n, m), (5, 3))
        for family in ("polynomial", "coupled")
    }
    assert len(kinds) == 1


def test_compiled_code_that_allocates_is_refused(module: ModuleType) -> None:
    with pytest.raises(TypingError, match="built-in function zeros"):
        module.allocate(3)


# -- where nothing can be kept, and where nothing is compiled --------------------------------------------

KERNELS = (
    "from aimd_des.utils.jit import kernel\n"
    "@kernel\ndef twice(x):\n    return 2.0 * x\n"
    "@kernel\ndef thrice(x):\n    return 3.0 * x\n"
    "print(twice(1.0), thrice(1.0))\n"
)


@pytest.mark.parametrize(
    "trouble",
    [
        # A package that is read-only, and no home; a disk that is full.
        "caching.CacheImpl._locator_classes = []",
        "caching.IndexDataCacheFile._save_data = lambda *_: open('no folder of that name/file')",
    ],
)
def test_without_a_place_for_compiled_code_it_is_told_once(trouble: str, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(f"import numba.core.caching as caching\n{trouble}\n{KERNELS}", encoding="utf-8")
    outcome = compilers().run(FILE, str(program), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert outcome.returncode == 0, outcome.stderr
    assert outcome.stdout == "2.0 3.0\n"
    (line,) = (line for line in outcome.stderr.splitlines() if not line.startswith("compiling formulas"))
    assert line.startswith("compiled code is not kept (")
    assert line.endswith(
        "set NUMBA_CACHE_DIR to a folder that can be written, and code is compiled only once"
    )


def test_damaged_code_is_compiled_anew(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(f"{KERNELS}print(sum(twice.dispatcher.stats.cache_hits.values()))\n", encoding="utf-8")
    hits = []
    for damage in ("", "data", "index", ""):
        for path in (tmp_path / "cache").rglob(
            "*.nbc" if damage == "data" else "*.nbi" if damage else "none"
        ):
            path.write_bytes(path.read_bytes()[:40])
        outcome = compilers().run(FILE, str(program), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
        assert outcome.returncode == 0, outcome.stderr
        hits.append(outcome.stdout.splitlines()[1])
    assert hits == ["0", "0", "0", "1"]


RUN = """
import sys, tomllib
from aimd_des.scenario import Scenario
for agents in ("process", "fleet"):
    print(Scenario(**{**tomllib.loads(sys.argv[1]), "agents": agents}).run().digest)
"""


def test_without_a_compiler_the_digest_is_the_same() -> None:
    text = INLINE + "\n[channel]\nlatency = { kind = 'exponential', mean = 0.5 }\nloss = 0.2\n"
    outcome = compilers().run(RUN, text, NUMBA_DISABLE_JIT="1")
    assert outcome.returncode == 0, outcome.stderr
    expected = Scenario(**tomllib.loads(text)).run().digest
    assert outcome.stdout.split() == [expected, expected]
