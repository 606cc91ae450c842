"""The settings of the project's tests hold for those of the benchmarks, too."""

from tests import conftest  # noqa: F401
