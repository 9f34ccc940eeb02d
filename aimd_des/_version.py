"""The version of the package, and that of its results, below everything that writes them down."""

__all__ = ["RESULT_VERSION", "__version__"]

__version__ = "0.1.0"

#: Raised when a scenario gives other results than before: see lines of the changelog tagged **Results**.
RESULT_VERSION = 1
