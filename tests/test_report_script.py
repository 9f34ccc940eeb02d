"""The script of pages is bundled once on a machine, and is the same wherever it comes from."""

from pathlib import Path

import pytest
import vl_convert

from aimd_des.report import script

GLUE = "console.log('glue');"


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was bundled, by a bundler that is quick; its results are kept in a folder of the test."""
    given: list[str] = []

    def bundle(glue: str) -> str:
        given.append(glue)
        return f"vega;\n{glue}"

    monkeypatch.setattr(script, "_KEPT", tmp_path / "kept")
    monkeypatch.setattr(vl_convert, "javascript_bundle", bundle)
    script.bundled.cache_clear()
    return given


def bundled(glue: str = GLUE) -> str:
    """The script, as a process that has just begun has it."""
    found = script.bundled(glue)
    script.bundled.cache_clear()
    return found


def test_it_is_bundled_once(calls: list[str]) -> None:
    assert [bundled(), bundled()] == [f"vega;\n{GLUE}"] * 2
    assert calls == [GLUE]


def test_other_glue_and_another_bundler_make_another(
    calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bundled()
    assert bundled("other") == "vega;\nother"
    monkeypatch.setattr(script, "version", lambda _: "9.9")
    bundled()
    assert calls == [GLUE, "other", GLUE]


@pytest.mark.parametrize("damage", [b"", b"\xff", b"alert(1)", b"0\nvega;"])
def test_what_is_damaged_is_made_anew(calls: list[str], tmp_path: Path, damage: bytes) -> None:
    bundled()
    (kept,) = (tmp_path / "kept").iterdir()
    whole = kept.read_bytes()
    for content in (damage, whole[:-1], whole[:-1] + b"?"):
        kept.write_bytes(content)
        assert bundled() == f"vega;\n{GLUE}"
        assert kept.read_bytes() == whole
    assert len(calls) == 4


def test_a_folder_that_cannot_be_written_is_no_reason_to_stop(calls: list[str], tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("a file")
    assert [bundled(), bundled()] == [f"vega;\n{GLUE}"] * 2
    assert calls == [GLUE, GLUE]
