"""The folder of a run, read back: what is not as it was written is refused, never read as another number."""

import random
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from aimd_des import InputError, load_scenario
from aimd_des.report import report_run
from aimd_des.results.frames import name_as_written, safe_names
from aimd_des.scenario.run_folder import load_run
from aimd_des.utils.checksums import SUMS, checksums_of, read_checksums, verified, write_checksums
from tests.command_line import invoke, refusal, run, said, write
from tests.conftest import INLINE

pytestmark = pytest.mark.usefixtures("own_folder")

FRAMES = ("allocations", "capacity", "convergence", "demand", "optimum", "signals")
AGAIN = "run the scenario again"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run, with figures."""
    place = tmp_path_factory.mktemp("run")
    (place / "five.toml").write_text(INLINE, encoding="utf-8")
    assert invoke("run", str(place / "five.toml"), "--out", str(place / "five")).exit_code == 0
    return place / "five"


@pytest.fixture
def folder(written: Path) -> Path:
    return Path(shutil.copytree(written, "results/five"))


def read(folder: Path) -> tuple[Any, ...]:
    """All that can be read back of a run."""
    stored = load_run(folder)
    # Bytes say more than frames: nobody can take -0.0 for 0.0, or one NaN for another.
    frames = [pd.util.hash_pandas_object(stored.frame(name)).tolist() for name in FRAMES]
    return stored.scenario, stored.digest, stored.versions, repr(stored.measures), stored.source(), frames


def test_no_flipped_bit_is_read_as_another_number(folder: Path) -> None:
    whole, luck, flips = read(folder), random.Random(13), 10
    for path in sorted(folder.iterdir()):
        content, sentences = path.read_bytes(), []
        for _ in range(flips):
            flipped = bytearray(content)
            flipped[luck.randrange(len(content))] ^= 1 << luck.randrange(8)
            path.write_bytes(flipped)
            try:
                assert read(folder) == whole
            except InputError as damage:
                sentences.append(str(damage))
        path.write_bytes(content)
        assert all(sentence.endswith(AGAIN) for sentence in sentences)
        if path.suffix == ".png":  # nothing is read of figures
            assert not sentences
        elif path.name != SUMS:  # of whose lines some are about figures
            assert len(sentences) == flips
            assert {sentence.split(" the checksum")[0] for sentence in sentences} == {
                f"{path}: does not have"
            }
    assert read(folder) == whole


def test_sha256sum_finds_every_file_as_it_was_written(folder: Path) -> None:
    sums = read_checksums(folder, "")
    assert sums is not None
    assert sorted([*sums, SUMS]) == sorted(path.name for path in folder.iterdir())
    assert sums == checksums_of(folder, sums)
    if shutil.which("sha256sum") is None:
        pytest.skip("this system has no sha256sum")
    check = ["sha256sum", "--check", "--strict", SUMS]
    assert subprocess.run(check, cwd=folder, capture_output=True, check=False).returncode == 0
    (folder / "figure1.png").write_bytes(b"another picture")
    assert subprocess.run(check, cwd=folder, capture_output=True, check=False).returncode == 1


@pytest.mark.parametrize(
    "name", [f"{frame}.parquet" for frame in ("demand", "signals", "allocations", "optimum")]
)
def test_a_report_refuses_a_damaged_frame(folder: Path, name: str) -> None:
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(content)
    sentence = (
        f"{folder / name}: does not have the checksum that it was written with: it or {folder / SUMS} is"
    )
    assert refusal("report", str(folder)).startswith(f"{sentence} damaged; {AGAIN}")


def test_show_and_compare_refuse_a_damaged_summary(folder: Path) -> None:
    shutil.copytree(folder, "whole")
    path = folder / "summary.csv"
    path.write_bytes(path.read_bytes().replace(b"0.", b"1.", 1))
    for command in (["show", str(folder)], ["compare", "whole", str(folder)], ["report", str(folder)]):
        assert refusal(*command).startswith(f"{path}: does not have the checksum")
    said("show", "whole")


def test_a_folder_without_checksums_is_read_with_one_sentence(folder: Path) -> None:
    whole = read(folder)
    (folder / SUMS).unlink()
    with pytest.warns(
        UserWarning, match=f"^results/five: has no {SUMS}, so nothing tells .*; {AGAIN}$"
    ) as told:
        found = read(folder)
    assert len(told) == 1
    assert found == whole


def test_the_folder_of_an_earlier_version_has_a_report(folder: Path) -> None:
    for name in (SUMS, "optimum.parquet", "capacity.parquet", "convergence.parquet"):
        (folder / name).unlink()
    with pytest.warns(UserWarning, match="has no SHA256SUMS"):
        page = report_run(load_run(folder))
    assert [note.split(":")[0] for note in page.notes] == [
        "Total demand over time",
        "Misallocation over time",
        "Averages against the optimum",
    ]
    assert all(AGAIN in note for note in page.notes)
    assert page.charts == []
    assert page.tables[0].rows


@pytest.mark.parametrize("content", [b"no parquet", b"", b"PAR1\0\0\0\0PAR1"])
def test_damage_without_checksums_is_a_sentence_too(folder: Path, content: bytes) -> None:
    (folder / SUMS).unlink()
    (folder / "demand.parquet").write_bytes(content)
    with (
        pytest.warns(UserWarning, match="has no SHA256SUMS"),
        pytest.raises(InputError, match=rf"demand.parquet: is damaged \(.*\); {AGAIN}"),
    ):
        load_run(folder).frame("demand")


@pytest.mark.parametrize(
    "lines",
    ["", "no checksum", "0" * 64 + " one.txt\n", "0" * 63 + "  one.txt\n", "\xff\n", "0" * 64 + "  one.txt"],
)
def test_checksums_that_are_none_are_refused(lines: str) -> None:
    Path("one.txt").write_text("1", encoding="utf-8")
    Path(SUMS).write_text(lines, encoding="latin-1")
    if not lines:
        assert read_checksums(Path(), AGAIN) == {}
        with pytest.raises(
            InputError, match=rf"^one.txt: has no checksum: it or {SUMS} is damaged; {AGAIN}$"
        ):
            verified(Path(), "one.txt", {}, AGAIN)
        return
    with pytest.raises(InputError, match=f"^{SUMS}: (is damaged|cannot be read) .*; {AGAIN}$"):
        read_checksums(Path(), AGAIN)


def test_checksums_are_of_any_files() -> None:
    Path("sub").mkdir()
    Path("sub/one two.txt").write_text("1", encoding="utf-8")
    write_checksums(Path(), checksums_of(Path(), ["sub/one two.txt"]))
    sums = read_checksums(Path(), AGAIN)
    assert verified(Path(), "sub/one two.txt", sums, AGAIN) == b"1"
    assert read_checksums(Path("sub"), AGAIN) is None
    assert verified(Path("sub"), "one two.txt", None, AGAIN) == b"1"
    with pytest.raises(FileNotFoundError):
        verified(Path(), "two.txt", sums, AGAIN)
    Path("folder").mkdir()
    with pytest.raises(InputError, match=f"^folder: cannot be read .*; {AGAIN}"):
        verified(Path(), "folder", sums, AGAIN)


# -- names that a spreadsheet would run ---------------------------------------------------------------------

FORMULAS = [
    "=cmd|' /C calc'!A0",
    "+1+2",
    "-x",
    "@SUM(A1)",
    "'quoted",
    "''",
    "plain",
    "a=b",
    "'=x",
    "\u2028 line",
]


def test_a_report_solves_for_no_optimum(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("the folder has the optimum")

    monkeypatch.setattr("aimd_des.problem.optimum.optimum.follow_central_path", refuse)
    assert "shares" in [chart.id for chart in report_run(load_run(folder)).charts]


def test_names_like_formulas_come_back_as_they_were() -> None:
    written = safe_names(FORMULAS)
    assert not [word for word in written if word[0] in "=+-@\t\r"]
    assert [name_as_written(word) for word in written] == FORMULAS
    assert [word for word, name in zip(written, FORMULAS, strict=True) if word == name] == [
        "plain",
        "a=b",
        "\u2028 line",
    ]


@pytest.mark.parametrize("name", ["=cmd|' /C calc'!A0", "@x", 'a,\\"b', "x\u00a0y"])
def test_a_resource_with_a_name_like_a_formula_is_safe_in_csv(name: str) -> None:
    assert run(str(write(INLINE.replace('"memory"', f'"{name}"')))).exit_code == 0
    asked = name.replace("\\", "")
    (first, _) = pd.read_csv("results/five/summary.csv")["resource"]
    assert first[0] not in "=@"
    assert list(load_run("results/five").measures) == [asked, "disk"]
    assert asked in said("show", "results/five")


def test_a_folder_of_before_is_read_with_the_column_of_agents_as_it_is_called_now(folder: Path) -> None:
    now = {name: load_run(folder).frame(name) for name in ("allocations", "optimum")}
    for name, frame in now.items():
        frame.rename(columns={"agent": "camera"}).to_parquet(folder / f"{name}.parquet", index=False)
    write_checksums(folder, checksums_of(folder, list(read_checksums(folder, "") or ())))
    for name, frame in now.items():
        assert "agent" in frame
        pd.testing.assert_frame_equal(load_run(folder).frame(name), frame)


def test_the_scenario_of_a_folder_is_run_again_only_as_it_was_written(folder: Path) -> None:
    path = folder / "scenario.toml"
    whole = path.read_text(encoding="utf-8")
    Path("study.toml").write_text(f'base = "{path}"\n', encoding="utf-8")
    assert load_scenario(path).to_toml() == whole
    path.write_text(whole.replace("until = ", "until = 1"), encoding="utf-8")
    sentence = f"{path}: does not have the checksum that it was written with: "
    for call in (["validate", str(path)], ["run", str(path), "--out", "again"], ["sweep", "study.toml"]):
        outcome = invoke(*call)
        assert outcome.exit_code == 2
        assert sentence in outcome.stderr
        assert outcome.stderr.endswith("copy it to another folder if you have changed it yourself\n")
    shutil.copy(path, "scenario.toml")
    assert load_scenario("scenario.toml").until == float(f"1{tomllib.loads(whole)['until']:g}")
