"""How pages and figures of studies write measures: shares as percentages, with the unit said once."""

from typing import NamedTuple

from aimd_des.results.measures import MEASURES

_SHARE = "share of "


class ShownMeasure(NamedTuple):
    """A measure as charts and tables have it."""

    title: str  # for people
    unit: str  # of its numbers
    factor: float  # from the measure to these numbers

    @property
    def label(self) -> str:
        """Name the measure with its unit."""
        return f"{self.title} ({self.unit})"


def shown_measure(name: str) -> ShownMeasure:
    """Say how a measure is shown."""
    measure = MEASURES[name]
    if measure.unit.startswith(_SHARE):
        return ShownMeasure(measure.title, f"% of {measure.unit.removeprefix(_SHARE)}", 100.0)
    return ShownMeasure(measure.title, measure.unit, 1.0)


#: Where good ends, of measures for which there is such a point: 1 % above the capacity, and 5 % misallocated.
LIMITS = {"utilisation": 1.01, "misallocation": 0.05}
#: Measures of which all of the capacity, 100 %, is the middle.
AROUND_CAPACITY = ("utilisation", "overshoot_peak")
