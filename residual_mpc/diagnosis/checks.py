"""Checks of settings records."""

from typing import Any


def check_positive(settings: Any, *names: str) -> None:
    """Raises ValueError for a field that is not above 0."""
    for name in names:
        if not getattr(settings, name) > 0:
            raise ValueError(f"{type(settings).__name__}.{name} must be > 0, got {getattr(settings, name)}")


def check_share(settings: Any, *names: str) -> None:
    """Raises ValueError for a field that is no share of a whole."""
    for name in names:
        if not 0.0 <= getattr(settings, name) <= 1.0:
            raise ValueError(f"{type(settings).__name__}.{name} must lie in [0, 1], got {getattr(settings, name)}")
