"""Finds files named ``package://NAME/path``, with or without an installed ROS."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from mebo_grasp.errors import InvalidHandError

SCHEME = "package://"


def package_folders(name: str, near: Path | None = None) -> Iterator[Path]:
    """Yield the folders that may be a package's share folder, the likeliest first.

    Args:
        name: name of the package.
        near: a file that names it; a folder of the package's name above it is taken first.
    """
    if near is not None:
        yield from (parent for parent in near.resolve().parents if parent.name == name)
    yield from (Path(prefix) / "share" / name for prefix in _listed("AMENT_PREFIX_PATH"))
    yield from (Path(root) / name for root in _listed("ROS_PACKAGE_PATH"))
    # Wheels put data files below the environment's prefix, or beside the modules (pip install --target).
    yield Path(sys.prefix) / "share" / name
    yield from (Path(entry) / "share" / name for entry in sys.path if entry)


def _listed(variable: str) -> list[str]:
    """Return the folders that an environment variable lists."""
    return [folder for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def resolve(uri: str, folder: Path, near: Path | None = None) -> Path:
    """Return the file that a path or URI names.

    Args:
        uri: ``package://NAME/path``, ``file://…``, an absolute path, or one relative to ``folder``.
        folder: where relative paths begin.
        near: file that names the URI, see ``package_folders``.

    Raises:
        InvalidHandError: no folder of the package holds the file.
    """
    if not uri.startswith(SCHEME):
        return (folder / uri.removeprefix("file://")).resolve()
    name, _, path = uri.removeprefix(SCHEME).partition("/")
    looked = list(dict.fromkeys(package_folders(name, near)))
    for place in looked:
        if (place / path).is_file():
            return (place / path).resolve()
    raise InvalidHandError(
        f"'{uri}' is not found; looked in {', '.join(str(place) for place in looked[:4])} …: install the package "
        f"'{name}', or set AMENT_PREFIX_PATH or ROS_PACKAGE_PATH to where it is"
    )
