"""A study's folder read back: tidy frames, and the scenario of every run."""

import json
import tomllib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import pyarrow as pa

from aimd_des.results.measures import FIRST
from aimd_des.scenario import Scenario, validate_scenario, with_settings
from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.study.axis import Axis
from aimd_des.study.columns import known_frame
from aimd_des.study.run_tables import RUN_AWAY, VERSIONS, plan_schema, run_schema
from aimd_des.study.store import Store
from aimd_des.study.stored_rows import StoredRows, read_rows
from aimd_des.study.study import Study, axis_words, stored_study, titled
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.shown import Shown, ShowsItself

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def load_study(folder: str | Path) -> "StudyResults":
    """Open the folder of a study, whether or not all of its runs are there.

    Parameters
    ----------
    folder : str or Path
        As `run_study` or ``aimd-des sweep`` has written it.

    Returns
    -------
    StudyResults
        Frames are read when they are asked for.

    Raises
    ------
    InputError
        If it is no such folder, or what it says of the study is damaged.
    """
    store = Store(validation.path("folder", folder))
    manifest, plan = store.manifest(), store.plan()
    if manifest is None or plan is None:
        raise InputError.of("folder", str(folder), "that of a study, with its manifest.json and plan.parquet")
    study = stored_study(manifest, store.folder)
    try:
        plan = plan.cast(plan_schema(study))
    except (pa.ArrowException, ValueError) as error:
        raise InputError(f"{store.folder / 'plan.parquet'}: is that of another study ({error})") from None
    return StudyResults(store, study, plan.to_pandas())


class StudyResults(ShowsItself):
    """What a study has given so far.

    Parameters
    ----------
    store : Store
        The folder.
    study : Study
        The study.
    plan : DataFrame
        Which runs it has.

    Attributes
    ----------
    folder : Path
        Where it is.
    study : Study
        What was asked for.
    plan : DataFrame
        A row for each run: the columns of the axes, point, replication, seed, key.
    """

    def __init__(self, store: Store, study: Study, plan: pd.DataFrame) -> None:
        self._store = store
        self.folder = store.folder
        self.study = study
        self.plan = self._tidy(plan)

    def _shown(self) -> Shown:
        # Counted from names alone: what a file holds is looked at where it is asked for.
        there = len(self._stored.spans.keys() & set(self.plan["key"]))
        title = f"Study results: {titled(self.study.title)}{there:,} of {len(self.plan):,} runs"
        rows = [[axis.name, axis_words([value for value, _ in axis.settings()])] for axis in self.study.axes]
        return Shown(title, rows=[*rows, ["folder", str(self.folder)]])

    def _tidy(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Make names categoricals, in the order of the study, and integers of an axis of integers."""
        for axis in self.study.axes:
            values = [value for value, _ in axis.settings()]
            if Axis.kind(values[0]) == "string":
                frame[axis.name] = pd.Categorical(frame[axis.name], categories=values)
            elif all(type(value) is int for value in values):
                frame[axis.name] = frame[axis.name].astype("int64")
        for name in {"point", "resource"} & set(frame.columns):
            frame[name] = pd.Categorical(frame[name], categories=frame[name].unique())
        return frame

    @property
    def versions(self) -> dict[str, str]:
        """Of this program, Python and the libraries that made the runs that are there, each that occurs."""
        # Runs of earlier versions do not say it; the manifest does.
        found = [(self._store.manifest() or {}).get("versions", {})]
        found += map(json.loads, self._rows[VERSIONS].unique().to_pylist())
        names = dict.fromkeys(name for one in found for name in one)
        every = {name: dict.fromkeys(str(one[name]) for one in found if name in one) for name in names}
        return {name: ", ".join(sorted(values)) for name, values in every.items()}

    @cached_property
    def _stored(self) -> StoredRows:
        return read_rows(self._store, run_schema(self.study))

    @cached_property
    def _rows(self) -> pa.Table:
        """The rows of all runs that are there, in the order of the plan; what is damaged is refused."""
        if self._stored.damage:
            raise InputError(self._stored.damage[0])
        return self._stored.of(key for key in self.plan["key"] if key in self._stored.spans)

    @cached_property
    def runs(self) -> pd.DataFrame:
        """The measures: a row for each run and resource, in the order of the plan.

        Columns: those of the axes, point, replication, seed, key, digest, resource, the measures of
        `Result.summary`, until.  A file that is damaged is refused: `missing` lists the run.
        """
        return self._tidy(self._rows.drop_columns([RUN_AWAY, VERSIONS]).to_pandas())

    def frame(self, name: str) -> pd.DataFrame:
        """Put a frame of all runs together.

        Parameters
        ----------
        name : str
            One that the study keeps, such as "demand".

        Returns
        -------
        DataFrame
            The columns of the axes, replication and key, then those of the frame.

        Raises
        ------
        InputError
            If the study does not keep it, or that of a run that is there is lost or damaged.
        """
        known_frame("name", name)
        if name not in self.study.keep:
            raise InputError.of(
                "name", name, f"one of what the study keeps: {self.study.keep}", "add it to keep"
            )
        rows = self.plan[self.plan["key"].isin(self._stored.spans)]
        tables = [self._store.frame(name, key) for key in rows["key"]]
        if not tables:
            return rows[[*(axis.name for axis in self.study.axes), "replication", "key"]].copy()
        found: pd.DataFrame = pa.concat_tables(tables).unify_dictionaries().drop_columns("key").to_pandas()
        lengths = [len(table) for table in tables]
        columns = ["key", "replication", *(axis.name for axis in reversed(self.study.axes))]
        for column in columns:
            values = rows[column].repeat(lengths).reset_index(drop=True)
            found.insert(0, column, values.astype("category") if column == "key" else values)
        return found

    def plot(self, measure: str | None = None, by: str | Sequence[str] | None = None) -> "Figure":
        """Draw a measure along one axis with its 95 % confidence intervals, or over two axes.

        Two axes of numbers give a map; one of cases, or of words, gives a line for each of them.

        Parameters
        ----------
        measure : str, optional
            One that the study keeps; default: the most telling of these, utilisation if it is kept.
        by : str or sequence of str, optional
            The axis or axes that the figure tells apart; it shows means over the others.  Default: all.

        Returns
        -------
        Figure
            Of Matplotlib, which notebooks show; ``figure.savefig`` writes it.

        Raises
        ------
        InputError
            If the study keeps no such measure, has no such axis or no run yet, or the number of axes with
            several values is neither one nor two.
        """
        from aimd_des.plots.study_measure import plot_measure
        from aimd_des.study.statistics.summary import one_or_more, summarise, whole_replications

        kept = self.study.columns()
        (name, *_) = [measure] if measure else [one for one in FIRST if one in kept] or kept
        validation.known("measure", name, kept)
        known = [axis.name for axis in self.study.axes]
        axes = known if by is None else one_or_more(by)
        for one in axes:
            validation.known("by", one, known)
        if self.runs.empty:
            raise InputError(f"{self.folder}: has no run yet, and nothing to draw; run the study first")
        points = [*axes, "resource"]
        whole = whole_replications(self.runs, points, [name])
        return plot_measure(summarise(whole, points, [name]), axes, name)

    @property
    def run_away(self) -> pd.DataFrame:
        """The runs whose demand has run away from a capacity: the columns of the plan, and its resources."""
        away = self._rows.filter(self._rows[RUN_AWAY]).select(["key", "resource"]).to_pandas()
        found = away.groupby("key")["resource"].agg(", ".join)
        rows = self.plan[self.plan["key"].isin(found.index)].reset_index(drop=True)
        return rows.assign(resources=[found[key] for key in rows["key"]])

    @property
    def failed(self) -> pd.DataFrame:
        """The runs that failed: the columns of the plan, and message; more is in the folder ``failed``."""
        there = self._store.failed() - self._stored.spans.keys()
        rows = self.plan[self.plan["key"].isin(there)].reset_index(drop=True)
        return rows.assign(message=[self._store.failure(key)["message"] for key in rows["key"]])

    @property
    def missing(self) -> pd.DataFrame:
        """The runs that a sweep would run: not there, or with a file that is lost or damaged."""
        there = [self._is_there(key) for key in self.plan["key"]]
        return self.plan[[not found for found in there]].reset_index(drop=True)

    def _is_there(self, key: str) -> bool:
        """Tell whether a run is there as a whole, or has failed."""
        return not self._store.fault(key, self.study.keep, done=key in self._stored.spans)

    def scenario(self, key: str, /, **changes: Any) -> Scenario:
        """Give the scenario of a run, to be run alone.

        Parameters
        ----------
        key : str
            Of the run.
        **changes
            Values that replace those of the run, as for `load_scenario`: ``**{"recording.events": True}``
            lets the result keep the event log, which its digest then covers, too.

        Returns
        -------
        Scenario
            Resolved, with the seed of the run: it has the digest in the run's row.

        Raises
        ------
        InputError
            If there is no such run, or not yet; if a change is refused.
        """
        planned = self.plan[self.plan["key"] == key]
        seed: dict[str, Any] = {}
        if key in self._stored.scenarios:
            text = self._stored.scenarios[key]
        elif key in self._stored.spans and len(planned):
            run = planned.iloc[0]
            text, seed = self._store.scenario(run["point"]), {"seed": int(run["seed"])}
        elif key in self._store.failed():
            text = self._store.failure(key)["scenario"]
        elif self._stored.damage and len(planned):
            raise InputError(self._stored.damage[0])
        else:
            raise InputError.of("key", key, f"that of a run in {self.folder}, done or failed")
        try:
            data = tomllib.loads(text) | seed
        except (ValueError, RecursionError) as error:
            raise InputError(f"run {key}: its scenario cannot be read ({error})") from None
        data = with_settings(with_new_keys(data, silent=True), changes)
        return validate_scenario(data, f"run {key}").resolved()


def run_away_words(results: StudyResults) -> str:
    """Say in how many runs demand has run away, and where first."""
    away = results.run_away
    first = away.iloc[0]
    where = "".join(f"{axis.name} {first[axis.name]}, " for axis in results.study.axes)
    return (
        f"demand has run away from a capacity in {len(away):,} of {len(results.runs['key'].unique()):,} runs"
        f" (first: {where}replication {first['replication']}, {first['resources']}): signals come too late,"
        " are lost, or take too little"
    )
