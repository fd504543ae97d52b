"""Packages that only some uses need: imported at first use, with the install command where one is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from residual_mpc.errors import BadInput


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Surrounds the import of packages that the extra `name` of pyproject.toml installs.

    Raises BadInput with the install command where one of them is missing; a package that is there but broken raises
    what it raises.
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        raise BadInput(
            f"the package {missing.name} is not installed", "", f"install it with `pip install 'residual-mpc[{name}]'`"
        ) from missing
