"""Nothing imports what is slow to import before it needs it."""

from pathlib import Path
from typing import Any

from tests.conftest import INLINE, python

HEAVY = {"matplotlib", "networkx", "numba", "numpy", "pandas", "pyarrow", "pydantic", "rich", "simpy"}
HEAVY |= {"scipy.integrate", "scipy.optimize", "scipy.special", "scipy.stats"}

#: What is imported, and what of the heavy that takes with it.
IMPORTS: dict[str, set[str]] = {
    "import aimd_des": set(),
    "from aimd_des import BroadcastChannel, Fleet, Simulation": {"numba", "numpy", "simpy"},
    "from aimd_des import run_synchronous": {"numba", "numpy"},
    "import aimd_des.study": set(),
    "import models": {"numba", "numpy", "pydantic", "simpy"},
}

# What a file is checked with: its tables are pydantic's, and the parts that they name hold formulas.
CHECKED = {"numba", "numpy", "pydantic", "simpy"}
FRAMES = {"pandas", "pyarrow"}
# Intervals of means are Student's.
INTERVALS = {"scipy.special"}
# What theory expects of a run stands in its folder.
EXPECTED = {"scipy.integrate", "scipy.optimize", "scipy.special"}

#: Commands in the order in which they are given, and what of the heavy each takes with it.
COMMANDS: dict[str, set[str]] = {
    "--help": set(),
    "validate one.toml": CHECKED,
    "validate study.toml": CHECKED,
    "list": CHECKED | {"rich"},
    "schema": CHECKED,
    "schema study": CHECKED,
    "run one.toml --out one --no-figures": CHECKED | FRAMES | EXPECTED | {"rich"},
    "show one": CHECKED | {"rich"},
    "sweep study.toml --out many --workers 1": CHECKED | FRAMES | {"rich"},
    "sweep study.toml --out many --dry-run": CHECKED | FRAMES | {"rich"},
    "show many": CHECKED | FRAMES | INTERVALS | {"rich"},
}

_SAY = f"\nimport sys\nprint(*sorted({HEAVY!r} & sys.modules.keys()), file=sys.stderr)"
_COMMAND = """
from aimd_des.cli import main
try:
    main({!r}, prog_name="aimd-des")
except SystemExit as end:
    assert not end.code, end.code
"""


def imported(code: str, **options: Any) -> tuple[str, set[str]]:
    """What a program prints, and what of the heavy it imports."""
    outcome = python("-c", code + _SAY, **options)
    assert outcome.returncode == 0, outcome.stderr
    return outcome.stdout, set(outcome.stderr.splitlines()[-1].split())


def test_faces_import_nothing_heavy_that_they_do_not_need() -> None:
    for line, needed in IMPORTS.items():
        assert imported(line)[1] == needed, line


def test_commands_import_nothing_heavy_that_they_do_not_need(tmp_path: Path) -> None:
    Path(tmp_path, "one.toml").write_text(INLINE, encoding="utf-8")
    Path(tmp_path, "study.toml").write_text('base = "one.toml"\nreplications = 2\n', encoding="utf-8")
    for line, needed in COMMANDS.items():
        assert imported(_COMMAND.format(line.split()), cwd=tmp_path)[1] == needed, line


def test_completing_a_key_imports_what_a_file_is_checked_with(tmp_path: Path) -> None:
    Path(tmp_path, "one.toml").write_text(INLINE, encoding="utf-8")
    words = {"COMP_WORDS": "aimd-des run one.toml --set chan", "COMP_CWORD": "4"}
    said, heavy = imported(_COMMAND.format([]), cwd=tmp_path, _AIMD_DES_COMPLETE="bash_complete", **words)
    assert "channel.latency=" in said
    assert heavy == CHECKED
