"""What holds for every test: no property fails for its time, since times belong to the benchmarks."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("project", deadline=None)
settings.load_profile("project")
