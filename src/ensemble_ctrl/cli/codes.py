"""Exit codes, as documented for users."""

from __future__ import annotations

OK = 0
INTERNAL = 1
USAGE = 2
NO_PLAN = 3
NOT_VERIFIED = 4
LIMIT = 5
INTERRUPTED = 130
TERMINATED = 143
