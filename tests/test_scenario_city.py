"""What stays as a city grows, and what evens out: six draws of the costs, 60 cameras and 960."""

import numpy as np
import pytest

from aimd_des.utils.validation import FloatArray
from scenarios.city import _city, _Size

DRAWS = range(6)
# By Student's t with 5 degrees of freedom, beyond once in 200 for each of three resources.
Z = 5.0

Cities = dict[int, dict[str, FloatArray]]


@pytest.fixture(scope="module")
def cities() -> Cities:
    """Measures by number of cameras, each (draws, resources)."""
    found = {n: [_city(_Size(n, 150.0), draw, 1000 * draw).values for draw in DRAWS] for n in (60, 960)}
    return {n: {name: np.array([run[name] for run in runs]) for name in runs[0]} for n, runs in found.items()}


def test_signals_are_those_of_sixty_cameras_but_for_the_draw(
    cities: dict[int, dict[str, FloatArray]],
) -> None:
    few, many = (found["signals"] for found in cities.values())
    error = np.sqrt((few.var(axis=0, ddof=1) + many.var(axis=0, ddof=1)) / len(DRAWS))
    assert (np.abs(few.mean(axis=0) - many.mean(axis=0)) < Z * error).all()
    # Negative control: a tenth fewer signals would be seen in disk space and bandwidth.
    assert (0.1 * few.mean(axis=0) > Z * error)[1:].any()


def test_times_between_signals_even_out_and_averages_do_not(cities: Cities) -> None:
    """Scatter is that of a mean of so many, a quarter; luck of averages is each camera's own."""
    few, many = ({name: values.mean(axis=0) for name, values in found.items()} for found in cities.values())
    assert (many["scatter"] < 0.5 * few["scatter"]).all()
    assert (many["misallocation"] > 0.8 * few["misallocation"]).all()
    # They wear off with time.
    assert (many["misallocation"] < 0.8 * many["misallocation, first quarter"]).all()
