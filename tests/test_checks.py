"""Whatever is refused is refused in one sentence: field, value, range, remedy."""

import math
from collections.abc import Callable
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import InputError, Sampled, SimulationError
from aimd_des.engine.control_unit import ControlUnit
from aimd_des.utils import limits, validation


def refusal(check: Callable[..., object], *arguments: Any, **options: Any) -> str:
    """The sentence with which a check refuses, which is one line."""
    with pytest.raises(InputError) as caught:
        check(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (True, "True"),
        (np.True_, "np.True_"),
        ("1.0", "'1.0'"),
        (b"1", "b'1'"),
        (None, "None"),
        (1 + 2j, "(1+2j)"),
        ([1.0], "[1.0]"),
        (math.nan, "nan"),
        (math.inf, "inf"),
        (-math.inf, "-inf"),
        (0, "0.0"),
        (-3, "-3.0"),
        (10**400, str(10**400)),
        (np.float32(-1.5), "-1.5"),
    ],
)
def test_number_names_field_value_range_and_remedy(value: object, shown: str) -> None:
    message = refusal(
        validation.number, "capacity of disk", value, low=0.0, low_open=True, remedy="buy another"
    )
    assert message == f"capacity of disk = {shown}: must be a finite number greater than 0; buy another"


@pytest.mark.parametrize(
    ("bounds", "words", "inside", "outside"),
    [
        ({}, "a finite number", [-1e308, 0, 1e308], [math.nan]),
        ({"low": 0.0}, "a finite number at least 0", [0, 1], [-5e-324]),
        ({"high": 1.0}, "a finite number at most 1", [-7, 1], [math.nextafter(1, 2)]),
        ({"low": 0.0, "high": 1.0}, "a finite number at least 0 and at most 1", [0, 1], [-1, 2]),
        (
            {"low": 0.0, "high": 1.0, "low_open": True, "high_open": True},
            "a finite number greater than 0 and less than 1",
            [5e-324, math.nextafter(1, 0)],
            [0, 1],
        ),
    ],
)
def test_number_knows_open_and_closed_ends(
    bounds: dict[str, Any], words: str, inside: list[float], outside: list[float]
) -> None:
    for value in inside:
        clean = validation.number("x", value, **bounds)
        assert (clean, type(clean)) == (value, float)
    for value in outside:
        assert refusal(validation.number, "x", value, **bounds).endswith(f"must be {words}")


@pytest.mark.parametrize("value", [3, 3.0, np.int64(3), np.float32(3), Fraction(3)])
def test_number_takes_every_kind_of_real_number(value: Any) -> None:
    clean = validation.number("x", value)
    assert (clean, type(clean)) == (3.0, float)


@pytest.mark.parametrize("value", [True, np.False_, 2.0, "2", None, math.nan, 1j, [1], -1, 7, -(10**30)])
def test_integer_names_field_value_range_and_remedy(value: object) -> None:
    message = refusal(validation.integer, "seed", value, low=0, high=6, remedy="take 1")
    assert message == f"seed = {value!r}: must be an integer of at least 0 and at most 6; take 1"


def test_integer_says_one_sided_ranges() -> None:
    assert refusal(validation.integer, "n", 0, low=1).endswith("must be an integer of at least 1")
    assert refusal(validation.integer, "n", 9, high=8).endswith("must be an integer at most 8")
    assert refusal(validation.integer, "n", 0.5).endswith("must be an integer")


@pytest.mark.parametrize("value", [5, np.int8(5), np.uint64(5), 10**30])
def test_integer_takes_every_kind_of_integer_of_any_size(value: Any) -> None:
    clean = validation.integer("n", value, low=0)
    assert (clean, type(clean)) == (int(value), int)


@pytest.mark.parametrize(
    ("check", "sign"), [(validation.number, 1), (validation.number, -1), (validation.integer, -1)]
)
def test_an_integer_too_long_to_be_printed_is_refused_like_others(
    check: Callable[..., object], sign: int
) -> None:
    assert refusal(check, "seed", sign * 10**5000, low=0).startswith("seed = ")


@pytest.mark.parametrize(
    "value",
    [
        None,
        "abc",
        ["1", "2"],
        [True, False],
        [None, 1.0],
        [[1.0], [1.0, 2.0]],
        [10**400, 1],
        {"a": 1},
        np.array([1, 2], dtype=object),
        np.array(["2024-01-01", "2024-01-02"], dtype="datetime64[D]"),
    ],
)
def test_array_refuses_what_is_no_array_of_numbers(value: object) -> None:
    message = refusal(validation.array, "weights", value, (2,), remedy="see the guide")
    assert message == f"weights = {value!r}: must be an array of numbers of shape (2,); see the guide"


@pytest.mark.parametrize("value", [[1 + 2j, 3], np.array([1j, 2])])
def test_array_refuses_complex_numbers_without_a_warning(value: object) -> None:
    assert refusal(validation.array, "weights", value, (2,)).endswith(
        "must be an array of numbers of shape (2,)"
    )


@pytest.mark.parametrize(
    ("value", "shape", "wanted"),
    [
        (1.0, (2,), "(2,)"),
        ([1.0], (2,), "(2,)"),
        ([[1.0, 2.0]], (2, 1), "(2, 1)"),
        (np.ones((3, 2, 1)), ("n_agents", 2), "(n_agents, 2)"),
        ([], (1,), "(1,)"),
    ],
)
def test_array_names_the_shape_it_wants(value: object, shape: tuple[int | str, ...], wanted: str) -> None:
    have = np.shape(value)  # type: ignore[arg-type]
    message = refusal(validation.array, "weights", value, shape, remedy="one per agent")
    assert message == f"shape of weights = {have!r}: must be {wanted}; one per agent"


@pytest.mark.parametrize(
    ("bad", "shown"), [(math.nan, "nan"), (math.inf, "inf"), (-math.inf, "-inf"), (0.0, "0.0"), (1.5, "1.5")]
)
def test_array_names_the_first_bad_element(bad: float, shown: str) -> None:
    values = np.full((2, 3), 0.5)
    values[1, 0] = values[1, 2] = bad
    message = refusal(
        validation.array, "loss", values, ("n", 3), low=0.0, low_open=True, high=1.0, remedy="less"
    )
    assert message == f"loss[1, 0] = {shown}: must be a finite number greater than 0 and at most 1; less"


def test_array_is_a_copy_that_cannot_be_written() -> None:
    given_values = np.array([1, 2, 3])
    clean = validation.array("x", given_values, ("n",))
    given_values[0] = 7
    assert clean.tolist() == [1.0, 2.0, 3.0]
    assert clean.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        clean[0] = 5.0


@pytest.mark.parametrize("value", [2, 2.0, np.float64(2), np.int32(2)])
def test_per_agent_gives_a_float_for_a_scalar(value: Any) -> None:
    clean = validation.per_agent("alpha", value, low=0.0)
    assert (clean, type(clean)) == (2.0, float)


@pytest.mark.parametrize("value", [[1, 2], (1, 2), np.array([1, 2])])
def test_per_agent_gives_an_array_for_many(value: Any) -> None:
    clean = validation.per_agent("alpha", value, low=0.0)
    assert isinstance(clean, np.ndarray)
    assert clean.tolist() == [1.0, 2.0]
    assert not clean.flags.writeable


@pytest.mark.parametrize(
    ("value", "start"),
    [
        ([1.0, -1.0], "alpha[1] = -1.0: must be a finite number greater than 0"),
        ([[1.0]], "shape of alpha = (1, 1): must be (n_agents,)"),
        (-1.0, "alpha = -1.0: must be a finite number greater than 0"),
        ("1", "alpha = '1': must be a finite number greater than 0"),
        (True, "alpha = True: must be a finite number greater than 0"),
        (["a"], "alpha = ['a']: must be an array of numbers"),
    ],
)
def test_per_agent_refuses_as_its_parts_do(value: object, start: str) -> None:
    message = refusal(validation.per_agent, "alpha", value, low=0.0, low_open=True, remedy="help")
    assert message.startswith(start)
    assert message.endswith("; help")


def test_per_agent_refuses_a_ragged_list() -> None:
    assert "alpha" in refusal(validation.per_agent, "alpha", [[1.0], [1.0, 2.0]])


def test_fits_lets_scalars_through_and_counts_arrays() -> None:
    validation.fits("latency", 0.5, 3)
    validation.fits("latency", np.ones(3), 3)
    message = refusal(validation.fits, "latency", np.ones(2), 3)
    assert message == "shape of latency = (2,): must be (3,); give one number for all agents or one for each"


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(-10, 10), st.floats(-10, 10))
def test_number_and_array_agree_with_the_definition(value: float, low: float, high: float) -> None:
    allowed = math.isfinite(value) and low < value <= high
    for check, given_value in ((validation.number, value), (validation.per_agent, [value])):
        if allowed:
            assert check("x", given_value, low=low, low_open=True, high=high) == value
        else:
            refusal(check, "x", given_value, low=low, low_open=True, high=high)


@pytest.mark.parametrize("kind", [InputError, SimulationError])
def test_exceptions_survive_being_rebuilt_from_their_arguments(kind: type[Exception]) -> None:
    original = kind("field = 1: must be 2")
    rebuilt = type(original)(*original.args)
    assert (str(rebuilt), rebuilt.args) == (str(original), original.args)


def test_the_exceptions_are_what_callers_expect() -> None:
    assert issubclass(InputError, ValueError)
    assert issubclass(SimulationError, RuntimeError)
    assert str(InputError.of("a", 1, "2")) == "a = 1: must be 2"


# -- texts, and what has no room -------------------------------------------------------------------------


@pytest.mark.parametrize("value", ["memory", "a b", "Zürich → Genève", "ذاكرة", "a" * 500, "$x^2$"])
def test_text_takes_names_of_all_scripts(value: str) -> None:
    assert limits.text("name", value) is value


@pytest.mark.parametrize(
    "value", ["a\nb", "a\rb", "\x1b[2J", "a\x07", "a\x9b2J", "a\x7f", "a\0", "a\u2028b", "a\ud800"]
)
def test_text_refuses_what_is_no_letter(value: str) -> None:
    with pytest.raises(InputError) as caught:
        limits.text("name", value)
    assert str(caught.value) == f"name = {value!r}: must be on one line and without control characters"


def test_text_refuses_pages_and_what_is_no_string() -> None:
    with pytest.raises(InputError, match=r"must be at most 500 letters long$"):
        limits.text("name", "a" * 501)
    with pytest.raises(InputError, match=r"^name = 5: must be a string that is not empty$"):
        limits.text("name", 5)
    with pytest.raises(InputError, match=r"^name = '': must be a string that is not empty$"):
        limits.text("name", "")
    assert limits.text("name", "", empty=True) == ""


def test_memory_refuses_what_the_machine_has_not() -> None:
    limits.memory("steps", 5, 1e6, "a byte for each")
    with pytest.raises(
        InputError, match=r"^steps = 5: must be less: a byte for each would take 1e\+09 GB, and"
    ):
        limits.memory("steps", 5, 1e18, "a byte for each")


def test_an_object_may_have_methods_that_its_class_does_not_have() -> None:
    """Classes are asked first, whose answer Python keeps; that of one object says nothing of another."""
    one, other = SimpleNamespace(process=print), SimpleNamespace()
    assert validation.instance("control_unit", one, ControlUnit, "a control unit") is one
    with pytest.raises(InputError, match="control_unit"):
        validation.instance("control_unit", other, ControlUnit, "a control unit")
    with pytest.raises(InputError, match="make an object of it"):
        validation.instance("control_unit", Sampled, ControlUnit, "a control unit")
