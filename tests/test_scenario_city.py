"""What stays as a city grows, and what evens out: six draws of the costs, 60 cameras and 960."""

import numpy as np
import pytest

from aimd_des.utils.validation import FloatArray
from scenarios.city import _MEASURES, _city, _Size

DRAWS = range(6)
# By Student's t with 5 degrees of freedom, beyond once in 200 for each of three resources.
Z = 5.0


@pytest.fixture(scope="module")
def cities() -> dict[int, FloatArray]:
    """Measures by number of cameras, (draws, measures, resources)."""
    return {
        n: np.array([_city(_Size(n, 150.0), draw, 1000 * draw).values for draw in DRAWS]) for n in (60, 960)
    }


def test_signals_are_those_of_sixty_cameras_but_for_the_draw(cities: dict[int, FloatArray]) -> None:
    few, many = (found[:, _MEASURES.index("signals")] for found in cities.values())
    error = np.sqrt((few.var(axis=0, ddof=1) + many.var(axis=0, ddof=1)) / len(DRAWS))
    assert (np.abs(few.mean(axis=0) - many.mean(axis=0)) < Z * error).all()
    # Negative control: a tenth fewer signals would be seen in disk space and bandwidth.
    assert (0.1 * few.mean(axis=0) > Z * error)[1:].any()


def test_times_between_signals_even_out_and_averages_do_not(cities: dict[int, FloatArray]) -> None:
    """Scatter is that of a mean of so many, a quarter; luck of averages is each camera's own."""
    few, many = (found.mean(axis=0) for found in cities.values())
    scatter, luck = (_MEASURES.index(name) for name in ("scatter", "misallocation"))
    assert (many[scatter] < 0.5 * few[scatter]).all()
    assert (many[luck] > 0.8 * few[luck]).all()
    # They wear off with time.
    assert (many[luck] < 0.8 * many[_MEASURES.index("misallocation, first quarter")]).all()
