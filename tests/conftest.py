"""What holds for every test."""

from __future__ import annotations

from tests.examples import register

register()
