"""`aimd-des show`: what was run and what came out, of a run."""

import json
from io import StringIO
from pathlib import Path

import pandas as pd
import pytest

from aimd_des.results.measures import measure_words
from aimd_des.study import load_study
from aimd_des.utils.checksums import checksums_of, write_checksums
from aimd_des.utils.formatting import measured
from tests.command_line import invoke, refusal, run, said, words, write

pytestmark = pytest.mark.usefixtures("own_folder")


def a_run() -> None:
    assert run(str(write()), "--out", "out").exit_code == 0


def test_a_run_is_shown_with_all_its_measures() -> None:
    a_run()
    out = said("show", "out")
    rows = words(out)
    provenance = json.loads(Path("out/run.json").read_text(encoding="utf-8"))
    assert ["title", "five", "agents,", "two", "resources"] in rows
    assert ["until", "60"] in rows
    assert ["problem", "written", "out:", "5", "agents,", "2", "resources"] in rows
    assert ["digest", provenance["digest"]] in rows
    for library, version in provenance["versions"].items():
        assert f"{library} {version}" in " ".join(out.split())
    summary = pd.read_csv("out/summary.csv", index_col="resource")
    assert ["measure", "memory", "disk"] in rows
    for name, column in summary.items():
        assert [*measure_words(str(name)).split(), *map(measured, column.tolist())] in rows


def test_a_model_is_shown_with_its_parameters() -> None:
    text = 'until = 30\nmodel = "models.smart_cameras"\n[parameters]\nn_cameras = 4\n'
    assert run(str(write(text)), "--out", "out").exit_code == 0
    rows = words(said("show", "out"))
    assert ["model", "models.smart_cameras"] in rows
    assert any(row[:1] == ["parameters"] and "n_cameras" in row and "4," in row for row in rows)


def test_measures_are_chosen() -> None:
    a_run()
    rows = words(said("show", "out", "--measure", "utilisation", "--measure", "signals"))
    table = rows[rows.index(["measure", "memory", "disk"]) + 2 :]
    assert [row[0] for row in table] == ["utilisation", "signals"]


def test_a_value_that_is_missing_is_not_a_number() -> None:
    a_run()
    summary = pd.read_csv("out/summary.csv", index_col="resource")
    summary["misallocation"] = float("nan")
    summary.to_csv("out/summary.csv")
    write_checksums(Path("out"), checksums_of(Path("out"), [path.name for path in Path("out").glob("[!S]*")]))
    assert ["misallocation", "nan", "nan"] in words(said("show", "out"))


def test_an_unknown_measure_is_refused() -> None:
    a_run()
    found = refusal("show", "out", "--measure", "utilization")
    assert found.startswith("measure = 'utilization': must be one of signals, bits, ")
    assert found.endswith("; did you mean 'utilisation'?")


def test_another_folder_is_refused() -> None:
    Path("empty").mkdir()
    expected = "folder = 'empty': must be one that aimd-des run or aimd-des sweep wrote; it has no run.json"
    assert refusal("show", "empty").startswith(expected)
    assert refusal("show", "nowhere") == "Invalid value for 'DIR': Directory 'nowhere' does not exist."


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("run.json", "{"),
        ("run.json", "{}"),
        ("run.json", "[1]"),
        ("run.json", "[" * 100_000),
        ("scenario.toml", "until = "),
        ("summary.csv", "a,b\n1,2\n"),
        ("summary.csv", "resource,signals\nmemory,many\n"),
        ("summary.csv", "resource,signals\nmemory\n"),
        ("summary.csv", "resource,signals\nmemory,1,2\n"),
    ],
)
def test_a_damaged_folder_is_refused(name: str, content: str) -> None:
    a_run()
    Path("out", name).write_text(content, encoding="utf-8")
    assert refusal("show", "out").startswith(f"out/{name}: does not have the checksum")
    Path("out/SHA256SUMS").unlink()  # as in the folder of an earlier version
    found = refusal("show", "out")
    assert found.startswith(f"out/{name}: is damaged (")
    assert found.endswith("; run the scenario again")


@pytest.mark.parametrize("name", ["scenario.toml", "summary.csv"])
def test_a_folder_that_lacks_a_file_is_refused(name: str) -> None:
    a_run()
    Path("out", name).unlink()
    assert f"it has no {name}" in refusal("show", "out")
    Path("out", name).mkdir()
    assert refusal("show", "out").startswith(f"out/{name}: cannot be read (")
    Path("out", name).rmdir()
    Path("out/SHA256SUMS").unlink()
    Path("out", name).write_bytes(b"\xff\xfe")
    assert refusal("show", "out").startswith(f"out/{name}: cannot be read (")


def test_a_run_is_printed_as_data() -> None:
    a_run()
    summary = pd.read_csv("out/summary.csv", index_col="resource")
    found = pd.read_csv(StringIO(invoke("show", "out", "--csv").stdout), index_col="resource")
    pd.testing.assert_frame_equal(found, summary, rtol=1e-12)
    (first, _) = json.loads(invoke("show", "out", "--json", "--measure", "utilisation").stdout)
    assert first == {"resource": "memory", "utilisation": pytest.approx(summary["utilisation"]["memory"])}
    assert refusal("show", "out", "--plot", "a.png").startswith(
        "--plot: has a meaning for the folder of a study"
    )


def test_a_study_is_printed_as_data_and_drawn() -> None:
    axes = {"loss": [0.0, 0.5], "latency": [0.5, 1.0]}
    tables = "".join(
        f'[[axes]]\nname = "{name}"\nkey = "channel.{name}"\nvalues = {v}\n' for name, v in axes.items()
    )
    base = 'model = "models.smart_cameras"\nparameters.n_cameras = 3\nuntil = 20\n'
    Path("study.toml").write_text(f"replications = 2\n[scenario]\n{base}{tables}", encoding="utf-8")
    assert invoke("sweep", "study.toml", "--out", "study", "--workers", "1").exit_code == 0
    found = pd.read_csv(StringIO(invoke("show", "study", "--csv", "--measure", "signals").stdout))
    assert len(found) == 4 * 3
    runs = load_study("study").runs
    here = (runs["loss"] == 0.5) & (runs["latency"] == 1.0) & (runs["resource"] == "disk")
    row = found[(found["loss"] == 0.5) & (found["latency"] == 1.0) & (found["resource"] == "disk")]
    assert row["mean"].tolist() == pytest.approx([runs[here]["signals"].mean()])
    for name, by in (("map.pdf", ()), ("line.svg", ("--by", "loss")), ("map.png", ())):
        outcome = invoke("show", "study", "--plot", name, *by)
        assert outcome.exit_code == 0, outcome.output
    assert [Path(name).read_bytes()[:4] for name in ("map.pdf", "line.svg", "map.png")] == [
        b"%PDF",
        b"<?xm",
        b"\x89PNG",
    ]
    assert "must be a new file" in refusal("show", "study", "--plot", "map.png")
    assert "must end in .pdf, .svg, .png" in refusal("show", "study", "--plot", "map.gif")
    assert "needs one or two axes" in refusal("show", "study", "--plot", "none.png", "--by", "resource")
    assert "cannot be given together" in refusal("show", "study", "--plot", "none.png", "--csv")
