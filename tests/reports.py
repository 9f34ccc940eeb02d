"""What the tests of reports share: results of a study that nobody has carried out, and what a page holds."""

import json
from html.parser import HTMLParser
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aimd_des.study import Study, StudyResults
from aimd_des.study.store import Store
from tests.conftest import INLINE

#: A text that must stay one, wherever it comes from.
HOSTILE = (
    "</script><script>window.hacked = 1</script><img src=x onerror=alert(1)> & \"quoted\" 'too' {{ 7 * 7 }}"
)

RESOURCES = ("memory", "disk")
MEASURES = ("utilisation", "misallocation", "overshoot_peak", "signals")


def study_of(values: dict[str, list[Any]], replications: int = 2, **more: Any) -> Study:
    tables = [{"name": name, "key": f"parameters.{name}", "values": those} for name, those in values.items()]
    given = {
        "title": "A study",
        "replications": replications,
        "measures": list(MEASURES),
        "scenario": {"model": "models.smart_cameras", "until": 10},
        "axes": tables,
    }
    return Study.model_validate({**given, **more})


def results_of(
    study: Study, folder: Path, resources: tuple[str, ...] = RESOURCES, *, done: bool = True
) -> StudyResults:
    """Results as they are read from a folder, with numbers that tell point, resource and measure apart."""
    axes = {axis.name: [value for value, _ in axis.settings()] for axis in study.axes}
    zipped = [axis.name for axis in study.axes if axis.zip]
    rows = [
        {**dict(zip(axes, point, strict=True)), "replication": replication, "key": f"{place}-{replication}"}
        for place, point in enumerate(product(*axes.values()))
        for replication in range(study.replications)
        if len({axes[name].index(value) for name, value in zip(axes, point, strict=True) if name in zipped})
        < 2
    ]
    plan = pd.DataFrame(rows)
    runs = plan.merge(
        pd.DataFrame({"resource": pd.Categorical(resources, categories=resources)}), how="cross"
    )
    rng = np.random.default_rng(4)
    for name in MEASURES:
        runs[name] = rng.uniform(0.8, 1.2, len(runs))
    results = StudyResults(Store(folder), study, plan)
    results.__dict__["runs"] = runs if done else runs[:0]
    return results


class Parsed(HTMLParser):
    """What a browser would find in a page: texts, links, scripts, charts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self.scripts: list[str] = []
        self.charts: dict[str, dict[str, Any]] = {}
        self._open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in {"meta", "link", "input", "img"}:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self._open:
            return
        if self._open[-1] == "script":
            attributes = self.tags[-1][1]
            if attributes.get("type") == "application/json":
                self.charts[str(attributes["id"])] = json.loads(data)
            else:
                self.scripts.append(data)
        elif data.strip():
            self.texts.setdefault(self._open[-1], []).append(data.strip())

    def attributes(self, name: str) -> list[str]:
        return [str(found[name]) for _, found in self.tags if name in found]


def values(spec: dict[str, Any], layer: int = 0) -> list[dict[str, Any]]:
    """The data of a chart, or of one of its layers."""
    data = spec.get("data") or spec["layer"][layer]["data"]
    found = data["values"] if "values" in data else spec["datasets"][data["name"]]
    assert isinstance(found, list)
    return found


#: A scenario whose every text is hostile.
HOSTILE_SCENARIO = INLINE.replace('"five agents, two resources"', f"'''{HOSTILE}'''").replace(
    '"memory"', "'<i>memory</i>'"
)
