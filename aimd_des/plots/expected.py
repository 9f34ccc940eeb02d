"""What theory expects of runs, drawn behind what is measured."""

from matplotlib.axes import Axes

from aimd_des.plots import style
from aimd_des.results.result import Result
from aimd_des.theory import Convergence, Expected
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


def check_expected(expected: Convergence | None, result: Result) -> None:
    """Refuse what is expected of other resources than those of a run."""
    if expected is None:
        return
    own = validation.instance("expected", expected, Convergence, "a Convergence").problem.resource_names
    names = result.problem.resource_names
    if own != names:
        raise InputError.of("resources of expected", own, f"{names}, as of the run")


def draw_expected(axes: Axes, times: FloatArray, expected: Expected) -> None:
    """Draw what theory expects of each resource, and the band in which runs lie."""
    for j in range(expected.mean.shape[1]):
        low, high = expected.low[:, j], expected.high[:, j]
        axes.fill_between(times, low, high, color=style.colour(j), alpha=0.2, linewidth=0.0)
        axes.plot(times, expected.mean[:, j], "-.", color=style.colour(j), linewidth=1.2)
    axes.plot([], [], "-.", color=style.REFERENCE, linewidth=1.2, label="expected, 95 % of runs")
