"""The notebook among the examples runs from the first cell to the last, and objects show themselves in it."""

import json
from pathlib import Path
from typing import Any

from tests.conftest import ROOT, python

NOTEBOOK = ROOT / "examples" / "notebook.ipynb"


def outputs(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """What the last line of each cell of code shows, by its kind."""
    cells = [cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return [out["data"] for cell in cells for out in cell if out["output_type"] == "execute_result"]


def test_the_notebook_runs_and_shows_tables_and_figures(tmp_path: Path) -> None:
    held = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    # What is kept has no outputs: they would be another version's.
    assert all(not cell.get("outputs") for cell in held["cells"])
    ran = python(
        *("-m", "nbconvert", "--to", "notebook", "--execute", str(NOTEBOOK)),
        *("--output-dir", str(tmp_path), "--log-level", "ERROR"),
    )
    assert ran.returncode == 0, ran.stderr
    problem, simulation, result, overview, summary, panel = outputs(
        json.loads((tmp_path / "notebook.ipynb").read_text(encoding="utf-8"))
    )
    words = ("Problem: 20 agents", "Simulation: ", "utilisation")
    for data, word in zip((problem, simulation, result), words, strict=True):
        assert word in "".join(data["text/html"])
        assert word in "".join(data["text/plain"])
    assert "text/html" in summary
    assert overview["image/png"]
    assert panel["image/png"]
