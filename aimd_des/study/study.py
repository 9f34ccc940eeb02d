"""A study as data: a base scenario, the axes along which it varies, and how often each point is repeated."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from aimd_des.results.measures import MEASURED, MEASURES, RARE
from aimd_des.scenario import validate_scenario
from aimd_des.scenario.dotted_keys import split_key, with_settings
from aimd_des.scenario.error_messages import checked
from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.scenario.parameters import as_data
from aimd_des.scenario.warm_up import EXCHANGED
from aimd_des.study.axis import Axis, Setting, StudyTable, Value
from aimd_des.study.columns import known_frame, known_measure
from aimd_des.study.condition import Condition
from aimd_des.utils import limits, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.shown import Shown, ShowsItself, spread

# Values of an axis that are written one by one where the study is shown.
_MOST_VALUES = 5


def shown_labels(labels: Mapping[str, Value]) -> str:
    """Name a point by its axes."""
    return ", ".join(f"{name} = {value}" for name, value in labels.items())


def titled(title: str) -> str:
    """Begin a line with a title, if there is one."""
    return f"{title}; " if title else ""


def axis_words(values: Sequence[Value]) -> str:
    """Write the values of an axis: one by one if they are few, else their range."""
    if len(values) <= _MOST_VALUES:
        return ", ".join(map(str, values))
    ends = f"{values[0]} to {values[-1]}" if isinstance(values[0], str) else spread(values)
    return f"{ends} ({len(values):,} values)"


def place_of(labels: Mapping[str, Value]) -> str:
    """Say where a scenario is, to begin a sentence with."""
    return f"at {shown_labels(labels)}" if labels else "scenario"


def stored_study(manifest: Mapping[str, Any], folder: Path) -> "Study":
    """Read the study of a folder, which an earlier version may have written; no warning is given."""
    return checked(Study, with_new_keys(manifest["study"], silent=True), str(folder / "manifest.json"))


class Precision(StudyTable):
    """``[precision]``: replications are added at each point until its mean is known well enough.

    Attributes
    ----------
    measure : str
        One of those that are kept.
    resource : str
        Of which resource; "all" for each of them.
    half_width : float
        Of the confidence interval of the mean, in the unit of the measure.
    confidence : float
        Of the interval.
    at_most : int
        Replications of a point, for any interval.
    """

    measure: str
    resource: str = "all"
    half_width: float
    confidence: float = 0.95
    at_most: int

    @model_validator(mode="after")
    def _check(self) -> Self:
        known_measure("precision.measure", self.measure)
        validation.number("half_width", self.half_width, low=0.0, low_open=True)
        validation.number("confidence", self.confidence, low=0.0, high=1.0, low_open=True, high_open=True)
        validation.integer("at_most", self.at_most, low=2)
        return self


class Study(ShowsItself, StudyTable):
    """Many runs as data.

    Attributes
    ----------
    title : str
        What the study is about, for people.
    replications : int
        Runs of each point, at least; they differ in their seeds.
    seed : int
        Decides the seeds of all runs, at least 0.
    paired : bool
        Whether replication r has the same seed at every point, so that differences between points are paired.
    measures : list of str, optional
        The measures to keep; default: the columns of the summary.  "expected_misallocation", what theory
        expects, is solved for where it is asked for.
    keep : list of str
        Frames of the results to keep besides.
    where : str, optional
        A condition over the names of the axes; points that do not fulfil it are left out.
    warm_up : float, optional
        Until when all points are as the scenario is without the axes: run once for each seed, and left out of
        the measures.
    precision : Precision, optional
        Adds replications until means are known well enough.
    scenario : dict
        The base scenario, as a scenario file has it.  Unless it says otherwise agents run as a fleet, and
        only what is kept is recorded.
    axes : list of Axis
        What varies.

    Raises
    ------
    InputError
        If anything is unknown, of a wrong type or outside its range, or the scenario of the first point is
        refused.
    """

    title: str = ""
    replications: int = 1
    seed: int = 0
    paired: bool = True
    measures: list[str] | None = None
    keep: list[str] = Field(default_factory=list)
    where: str | None = None
    warm_up: float | None = None
    precision: Precision | None = None
    scenario: dict[str, Any]
    axes: list[Axis] = Field(default_factory=list)

    def __init__(self, /, **data: Any) -> None:
        super().__init__(**data)
        for labels, settings in self.positions():
            validate_scenario(self.scenario_at(settings), place_of(labels))
            break  # a sweep will look at all

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="before")
    @classmethod
    def _from_data(cls, data: Any) -> Any:
        """Take what the parent takes, and old keys."""
        data = as_data(data)
        return with_new_keys(data) if isinstance(data, dict) else data

    @model_validator(mode="after")
    def _check(self) -> Self:
        limits.text("title", self.title, empty=True)
        validation.integer("replications", self.replications, low=1)
        validation.integer("seed", self.seed, low=0)
        for place, name in enumerate(self.measures or []):
            known_measure(f"measures[{place}]", name)
        for place, name in enumerate(self.keep):
            known_frame(f"keep[{place}]", name)
        for word in ("measures", "keep"):
            given = getattr(self, word) or []
            if len(set(given)) < len(given):
                raise InputError.of(word, given, "different from each other")
        if self.measures == []:
            raise InputError.of("measures", [], "one or more", "leave it out to keep all")
        self._check_precision()
        if "seed" in self.scenario:
            raise InputError("scenario.seed: has no meaning in a study, whose own seed decides; leave it out")
        if "rare_event" not in self.scenario and (rare := set(RARE) & set(self.measures or [])):
            raise InputError.of("measures", sorted(rare), "left out where scenario.rare_event is not given")
        self._check_axes()
        if self.warm_up is not None:
            self._check_warm_up()
        return self

    def _check_warm_up(self) -> None:
        if "warm_up" in self.scenario:
            raise InputError("scenario.warm_up: stands beside warm_up of the study; leave one of them out")
        for axis in self.axes:
            for key in (key for _, setting in axis.settings() for key in setting):
                if split_key(key)[0] not in (*EXCHANGED, "interventions"):
                    allowed = f"one of {', '.join(EXCHANGED)} and interventions where there is a warm-up"
                    remedy = (
                        f"it would act before the end of the warm-up, {self.warm_up:g}, which points share"
                    )
                    raise InputError.of(f"key of axis {axis.name!r}", key, allowed, remedy)

    def scenario_at(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """Set keys of the scenario; until the end of a warm-up it stays as it is.

        Parameters
        ----------
        settings : mapping of str to object
            A value for each dotted key.

        Returns
        -------
        dict
            Tables of a scenario.
        """
        found = with_settings(self.scenario, settings)
        if self.warm_up is None:
            return found
        others = [name for name in EXCHANGED if found.get(name) != self.scenario.get(name)]
        before = {name: self.scenario.get(name, EXCHANGED[name]) for name in others}
        return {**found, "warm_up": {"until": self.warm_up, **before}}

    def _check_precision(self) -> None:
        if self.precision is None:
            return
        if not 2 <= self.replications <= self.precision.at_most:
            allowed = f"from 2 to precision.at_most = {self.precision.at_most}"
            raise InputError.of("replications", self.replications, allowed)
        if self.precision.measure not in self.columns():
            raise InputError.of(
                "precision.measure", self.precision.measure, "one of the measures that are kept"
            )

    def _check_axes(self) -> None:
        names = [axis.name for axis in self.axes]
        if len(set(names)) < len(names):
            raise InputError.of("names of the axes", names, "different from each other")
        set_by: list[tuple[str, tuple[str, ...]]] = []
        for axis in self.axes:
            keys = dict.fromkeys(key for _, setting in axis.settings() for key in setting)
            for parts in map(split_key, keys):
                for other, earlier in set_by:
                    if other != axis.name and parts[: len(earlier)] == earlier[: len(parts)]:
                        allowed = f"set by one axis only; {other!r} sets {'.'.join(earlier)!r}"
                        raise InputError.of(f"key of axis {axis.name!r}", ".".join(parts), allowed)
                set_by.append((axis.name, parts))
        if self.where is not None:
            Condition(self.where, names)
        for word in {axis.zip for axis in self.axes if axis.zip is not None}:
            lengths = {axis.name: len(axis.settings()) for axis in self.axes if axis.zip == word}
            if len(lengths) == 1:
                raise InputError.of("zip", word, "the same word at two axes or more, which vary together")
            if len(set(lengths.values())) > 1:
                raise InputError.of(f"numbers of values of the axes with zip = {word!r}", lengths, "equal")

    def positions(self) -> Iterator[tuple[dict[str, Value], dict[str, Any]]]:
        """Combine the axes: those that are zipped as one, all others as a product, the last one fastest.

        Yields
        ------
        dict
            The value of each axis by its name; they fulfil the condition.
        dict
            The keys of the scenario that are set there, with their values.
        """
        condition = None if self.where is None else Condition(self.where, [axis.name for axis in self.axes])
        groups: dict[str, list[tuple[str, list[Setting]]]] = {}
        for place, axis in enumerate(self.axes):
            word = f"axis {place}" if axis.zip is None else f"zip {axis.zip}"
            groups.setdefault(word, []).append((axis.name, axis.settings()))
        steps = [
            [[(name, *settings[place]) for name, settings in group] for place in range(len(group[0][1]))]
            for group in groups.values()
        ]
        for chosen in product(*steps):
            parts = [part for step in chosen for part in step]
            by_name = {name: value for name, value, _ in parts}
            labels = {axis.name: by_name[axis.name] for axis in self.axes}
            if condition is None or condition(labels):
                yield labels, {key: value for _, _, setting in parts for key, value in setting.items()}

    def _shown(self) -> Shown:
        many = f"{self.replications:,} replications{' or more' if self.precision else ''} of each point"
        rows = [[axis.name, axis_words([value for value, _ in axis.settings()])] for axis in self.axes]
        return Shown(f"Study: {titled(self.title)}{many}, seed {self.seed}", rows=rows)

    def columns(self) -> tuple[str, ...]:
        """Name the measures that are kept.

        Returns
        -------
        tuple of str
            Those of the summary first, in its order.
        """
        rare = RARE if "rare_event" in self.scenario else ()
        wanted = (*MEASURED, *rare) if self.measures is None else self.measures
        return tuple(name for name in MEASURES if name in wanted)

    def spoken(self) -> dict[str, Any]:
        """Spell out everything, for TOML and JSON.

        Returns
        -------
        dict
            An equal study can be made of it.
        """
        return self.model_dump(exclude_none=True)
