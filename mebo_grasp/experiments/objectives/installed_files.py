"""Data files of installed packages, found without importing the package."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from mebo_grasp.errors import InvalidObjectError


def package_folder(package: str) -> Path:
    """Return the folder of an installed package.

    Args:
        package: dotted name.

    Raises:
        InvalidObjectError: it is not installed.
    """
    try:
        spec = find_spec(package)
    except (ModuleNotFoundError, ValueError):  # a part before the last dot is absent, or the name is no name
        spec = None
    if spec is None or spec.origin is None:
        raise InvalidObjectError(f"the package {package} is not installed; install it or leave its objects out")
    return Path(spec.origin).parent
