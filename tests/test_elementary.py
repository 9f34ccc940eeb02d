"""Logarithm, exponential and normal quantile: good to the last bits, and the same bits everywhere."""

import ast
import math
from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import lru_cache
from pathlib import Path
from typing import cast

import numba
import numpy as np
import pytest

from aimd_des.utils import portable_math
from aimd_des.utils.validation import FloatArray

ROOT = Path(__file__).resolve().parents[1]
CELL = 2.0**-53  # uniform numbers are multiples of it


def error(value: float, exact: Decimal) -> float:
    """Distance from the exact value, in units of the last place of its double."""
    return float(abs(Decimal(value) - exact) / Decimal(math.ulp(float(exact))))


def worst(
    function: Callable[[float], float], exact: Callable[[Decimal], Decimal], points: FloatArray
) -> float:
    with localcontext(prec=50):
        return max(error(function(x), exact(Decimal(x))) for x in points.tolist())


def around(*places: float) -> FloatArray:
    """The doubles next to some places, where branches meet and digits cancel."""
    near = [np.nextafter(place, side) for place in places for side in (-np.inf, np.inf)]
    return np.array([*places, *near])


rng = np.random.default_rng(20)
UNIFORMS = np.concatenate(
    [
        rng.random(6000),
        np.arange(20) * CELL,
        1.0 - np.arange(1, 21) * CELL,
        0.5 + np.arange(-10, 10) * CELL,
        np.floor(10.0 ** rng.uniform(-16, 0, 1000) / CELL) * CELL,
        *(np.round((place + rng.normal(size=100) * 1e-12) / CELL) * CELL for place in (0.075, 0.925)),
    ]
)
LOG_POINTS = np.concatenate(
    [
        1.0 - UNIFORMS,
        rng.uniform(0.5, 2.0, 20_000),
        2.0 ** rng.uniform(-1074, 1023, 5000),
        around(1.0, math.sqrt(0.5), math.sqrt(2.0), 2.0, 0.5, 1e300),
        np.array([5e-324, 2.0**-1022, np.finfo(float).max]),
    ]
)
EXP_POINTS = np.concatenate(
    [
        rng.uniform(-1.0, 1.0, 20_000),
        rng.uniform(-40.0, 40.0, 5000),
        rng.uniform(-745.0, 709.7, 5000),
        rng.uniform(-745.0, -708.0, 500),
        rng.normal(size=500) * 1e-9,
        around(0.0, 1.0, -1.0, *(0.5 * k * math.log(2.0) for k in range(-5, 6, 2))),
        np.array([709.782712893384, -745.1332191019411]),
    ]
)
SMALL_POINTS = np.concatenate([rng.normal(size=500) * scale for scale in (1e-17, 1e-9, 1e-3, 0.2)])


@lru_cache
def compiled(formula: Callable[[float], float]) -> Callable[[FloatArray], FloatArray]:
    """Compile a formula over arrays."""

    def row(points: FloatArray) -> FloatArray:
        out = np.empty_like(points)
        for place in range(len(points)):
            out[place] = formula(points[place])
        return out

    return cast(Callable[[FloatArray], FloatArray], numba.njit(error_model="numpy")(row))


@pytest.mark.parametrize(
    ("function", "exact", "points", "bound"),
    [
        (portable_math.log, Decimal.ln, LOG_POINTS, 1.0),
        (portable_math.exp, Decimal.exp, EXP_POINTS, 1.0),
        (portable_math.log1p, lambda x: (1 + x).ln(), np.abs(SMALL_POINTS), 2.0),
        (portable_math.log1p, lambda x: (1 + x).ln(), -np.minimum(np.abs(SMALL_POINTS), 0.99), 2.0),
        (portable_math.log1p, lambda x: (1 + x).ln(), LOG_POINTS[LOG_POINTS > 1e-3], 2.0),
        (portable_math.expm1, lambda x: x.exp() - 1, SMALL_POINTS[SMALL_POINTS != 0.0], 3.0),
        (portable_math.expm1, lambda x: x.exp() - 1, EXP_POINTS[EXP_POINTS != 0.0], 3.0),
    ],
)
def test_functions_are_good_to_the_last_bits(
    function: Callable[[float], float],
    exact: Callable[[Decimal], Decimal],
    points: FloatArray,
    bound: float,
) -> None:
    assert worst(function, exact, points) <= bound


def test_the_bound_would_see_a_value_that_is_two_places_off() -> None:
    wrong = [
        lambda x: portable_math.log(x) * (1.0 + 2.0**-51),
        lambda x: portable_math.log(x * (1.0 + 2.0**-51)),
    ]
    assert all(worst(function, Decimal.ln, LOG_POINTS[:500]) > 1.0 for function in wrong)


def normal_integral(z: Decimal) -> tuple[Decimal, Decimal]:
    """Phi(z) - 1/2 by its power series, and the density."""
    pi = Decimal("3.14159265358979323846264338327950288419716939937510582097494")
    term = total = z
    step = 1
    while abs(term) > Decimal("1e-55"):
        term *= z * z / (2 * step + 1)
        total += term
        step += 1
    density = (-z * z / 2).exp() / (2 * pi).sqrt()
    return density * total, density


def test_normal_numbers_are_quantiles_at_the_middle_of_their_cells() -> None:
    with localcontext(prec=60):
        for uniform in UNIFORMS[::3].tolist():
            z = portable_math.standard_normal(uniform)
            integral, density = normal_integral(Decimal(z))
            wanted = Decimal(uniform) + Decimal(2) ** -54 - Decimal("0.5")
            # Phi is straight enough over a few units in the last place.
            assert error(z, Decimal(z) - (integral - wanted) / density) <= 8.0, uniform


def test_normal_numbers_are_symmetric_and_finite() -> None:
    mirrored = (1.0 - UNIFORMS) - CELL
    normals = compiled(portable_math.standard_normal)
    assert np.array_equal(normals(mirrored), -normals(UNIFORMS))
    assert portable_math.standard_normal(0.0) == -portable_math.standard_normal(1.0 - CELL) > -8.3


def test_functions_know_the_edges() -> None:
    inf, nan = math.inf, math.nan
    cases = {
        portable_math.log: {0.0: -inf, -1.0: nan, inf: inf, nan: nan, 1.0: 0.0, -inf: nan},
        portable_math.log1p: {-1.0: -inf, -2.0: nan, inf: inf, nan: nan, 0.0: 0.0, 1e-300: 1e-300},
        portable_math.exp: {0.0: 1.0, 710.0: inf, inf: inf, -746.0: 0.0, -inf: 0.0, nan: nan},
        portable_math.expm1: {
            0.0: 0.0,
            710.0: inf,
            inf: inf,
            -746.0: -1.0,
            -inf: -1.0,
            nan: nan,
            1e-300: 1e-300,
        },
    }
    for function, pairs in cases.items():
        for x, wanted in pairs.items():
            assert function(x) == wanted or (math.isnan(wanted) and math.isnan(function(x))), (function, x)
    assert portable_math.exp(-0.0) == 1.0
    assert portable_math.log(-0.0) == -inf


@pytest.mark.parametrize(
    ("formula", "points"),
    [
        (portable_math.log, LOG_POINTS),
        (portable_math.log_normal, LOG_POINTS[LOG_POINTS >= 2.0**-1022]),
        (portable_math.exp, EXP_POINTS),
        (portable_math.standard_normal, UNIFORMS),
    ],
)
def test_compiled_formulas_give_the_same_bits(formula: Callable[[float], float], points: FloatArray) -> None:
    interpreted = np.array([formula(x) for x in points.tolist()])
    assert compiled(formula)(points).tobytes() == interpreted.tobytes()


@pytest.mark.parametrize("formula", [portable_math.log, portable_math.exp])
def test_compiled_formulas_know_the_same_edges(formula: Callable[[float], float]) -> None:
    """In a loop long enough for vectors, in which all branches are computed for all numbers."""
    edges = [0.0, -0.0, math.inf, -math.inf, math.nan, -1.0, 710.0, -746.0, 5e-324, 2.0**-1022, 1.0]
    points = np.array(13 * edges)
    interpreted = np.array([formula(x) for x in points.tolist()])
    np.testing.assert_array_equal(compiled(formula)(points), interpreted)


@pytest.mark.parametrize("formula", [portable_math.log, portable_math.log_normal, portable_math.exp])
def test_compiled_formulas_call_nothing(formula: Callable[[float], float]) -> None:
    """A call in a loop keeps LLVM from making vectors of it."""
    row = compiled(formula)
    row(np.ones(3))
    code = next(iter(row.inspect_llvm().values()))  # type: ignore[attr-defined]
    assert not [name for name in ("frexp", "ldexp") if name in code]


def test_logarithms_of_normal_numbers_are_those_of_all_numbers() -> None:
    points = np.concatenate([LOG_POINTS[LOG_POINTS >= 2.0**-1022], 1.0 - UNIFORMS])
    assert (
        compiled(portable_math.log_normal)(points).tobytes() == compiled(portable_math.log)(points).tobytes()
    )


@pytest.mark.parametrize(
    ("row", "formula", "points"),
    [
        (portable_math.logs, portable_math.log, LOG_POINTS),
        (portable_math.exps, portable_math.exp, EXP_POINTS),
    ],
)
def test_arrays_keep_their_shape(
    row: Callable[[FloatArray], FloatArray], formula: Callable[[float], float], points: FloatArray
) -> None:
    interpreted = np.array([formula(x) for x in points.tolist()])
    assert row(points).tobytes() == interpreted.tobytes()
    square = points[:144].reshape(12, 12).T
    assert np.array_equal(row(square), interpreted[:144].reshape(12, 12).T)
    assert row(points[:1][0]).shape == ()


# Written down on x86-64. A machine on which one of them differs gives other runs for the same seed.
BITS = {
    portable_math.log: {
        "0x1.999999999999ap-4": "-0x1.26bb1bbb55515p+1",
        "0x1.6a09e667f3bccp-1": "-0x1.62e42fefa39f1p-2",
        "0x1.6a09e667f3bcdp-1": "-0x1.62e42fefa39eep-2",
        "0x1.8000000000000p+0": "0x1.9f323ecbf984cp-2",
        "0x1.8000000000000p+1": "0x1.193ea7aad030ap+0",
        "0x1.56e1fc2f8f359p-997": "-0x1.5963447f87fb5p+9",
        "0x0.0000000000001p-1022": "-0x1.74385446d71c3p+9",
        "0x1.000001ad7f29bp+0": "0x1.ad7f2847b6492p-24",
        "0x1.fffffffffffffp-1": "-0x1.0000000000000p-53",
        "0x1.0000000000000p-53": "-0x1.25e4f7b2737fap+5",
    },
    portable_math.log1p: {
        "0x1.b7cdfd9d7bdbbp-34": "0x1.b7cdfd9d1d693p-34",
        "-0x1.3333333333333p-2": "-0x1.6d3c324e13f4fp-2",
        "0x1.6666666666666p-1": "0x1.0fae81914a991p-1",
        "-0x1.4f8b588e368f1p-17": "-0x1.4f8bc681e6005p-17",
    },
    portable_math.exp: {
        "0x1.0000000000000p+0": "0x1.5bf0a8b145769p+1",
        "-0x1.0000000000000p+0": "0x1.78b56362cef38p-2",
        "0x1.999999999999ap-4": "0x1.1aec7b35a00d4p+0",
        "0x1.62e42fefa39eep-2": "0x1.6a09e667f3bccp+0",
        "-0x1.62e42fefa39f0p-2": "0x1.6a09e667f3bccp-1",
        "0x1.9133333333333p+6": "0x1.a08a5754ae034p+144",
        "-0x1.5e0cccccccccdp+9": "0x1.f52f93df4dfcfp-1011",
        "-0x1.741999999999ap+9": "0x0.0000000000001p-1022",
        "0x1.62d999999999ap+9": "0x1.d75ae7a50ee14p+1023",
        "0x1.12e0be826d695p-30": "0x1.000000044b830p+0",
    },
    portable_math.expm1: {
        "0x1.b7cdfd9d7bdbbp-34": "0x1.b7cdfd9dda4e3p-34",
        "-0x1.3333333333333p-2": "-0x1.0966f2c7907f6p-2",
        "0x1.6666666666666p-1": "0x1.03854c24d130dp+0",
        "0x1.6000000000000p+2": "0x1.e76244f21bbf6p+7",
    },
    portable_math.standard_normal: {
        "0x0.0p+0": "-0x1.095b059d67c4cp+3",
        "0x1.0000000000000p-1": "0x1.40d931ff62707p-53",
        "0x1.3333333333333p-4": "-0x1.7085226d3e521p+0",
        "0x1.333333333332cp-4": "-0x1.7085226d3e524p+0",
        "0x1.3333333333333p-2": "-0x1.0c7e39582c5fap-1",
        "0x1.d99999999999ap-1": "0x1.7085226d3e526p+0",
        "0x1.f333333333333p-1": "0x1.f5c0331eeff87p+0",
        "0x1.fffffffffffffp-1": "0x1.095b059d67c4cp+3",
        "0x1.0000000000000p-40": "-0x1.c30d61bedb7bdp+2",
        "0x1.5fd7000000000p-37": "-0x1.ad2f7f180c394p+2",
    },
}


@pytest.mark.parametrize("function", BITS, ids=lambda function: function.__name__)
def test_bits_are_the_same_on_every_machine(function: Callable[[float], float]) -> None:
    for x, wanted in BITS[function].items():
        assert function(float.fromhex(x)).hex() == wanted, x


MACHINES_OWN = {
    "exp", "exp2", "expm1", "log", "log10", "log1p", "log2", "pow", "power", "float_power", "cbrt",
    "sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsin", "arccos", "arctan",
    "gamma", "lgamma", "erf", "erfc",
}  # fmt: skip
LIBRARIES = {"math", "np", "numpy", "scipy"}


def borrowed(source: str) -> list[str]:
    """Every use of a function that comes from the machine's mathematical library."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in LIBRARIES and node.attr in MACHINES_OWN:
                found.append(ast.unparse(node))
        elif isinstance(node, ast.ImportFrom) and node.module in LIBRARIES:
            found += [alias.name for alias in node.names if alias.name in MACHINES_OWN]
        elif (
            isinstance(node, ast.BinOp)
            and isinstance(node.op, ast.Pow)
            and ast.unparse(node) != "2.0 ** (-54)"
        ):
            found.append(ast.unparse(node))
    return found


def test_nothing_that_decides_a_run_asks_the_machines_library() -> None:
    files = [ROOT / "aimd_des/utils/portable_math.py", *(ROOT / "aimd_des/channel").rglob("*.py")]
    assert len(files) > 10
    assert {str(file): found for file in files if (found := borrowed(file.read_text("utf-8")))} == {}


def test_a_use_of_the_machines_library_is_found() -> None:
    assert borrowed("a = np.log(b) + math.exp(c)") == ["np.log", "math.exp"]
    assert borrowed("from math import sqrt, log1p") == ["log1p"]
    assert borrowed("a = b ** c") == ["b ** c"]
    assert borrowed("a = np.sqrt(b) + logs(c)") == []
