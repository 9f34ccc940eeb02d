"""Nothing imports what is slow to import before it needs it."""

from tests.conftest import python

HEAVY = {"matplotlib", "networkx", "numba", "numpy", "pandas", "pyarrow", "pydantic", "rich", "simpy"}
HEAVY |= {"scipy.integrate", "scipy.optimize", "scipy.special", "scipy.stats"}

#: What is imported, and what of the heavy that takes with it.
IMPORTS: dict[str, set[str]] = {
    "import aimd_des": set(),
    "from aimd_des import BroadcastChannel, Fleet, Simulation": {"numba", "numpy", "simpy"},
    "from aimd_des import run_synchronous": {"numba", "numpy"},
}


def test_faces_import_nothing_heavy_that_they_do_not_need() -> None:
    for line, needed in IMPORTS.items():
        outcome = python("-c", f"import sys\n{line}\nprint(*sorted({HEAVY!r} & sys.modules.keys()))")
        assert outcome.returncode == 0, outcome.stderr
        assert set(outcome.stdout.split()) == needed, line
