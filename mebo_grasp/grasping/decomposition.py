"""Convex parts of a concave mesh, found by coacd in a process of its own and cached by content.

Decomposition changes the shape: coacd's parts lie about 0.7 mm outside of the surface in the middle, and up to several
millimetres where a hollow is bridged. Trials therefore use the surface itself unless parts are asked for.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import logging
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

FloatArray = npt.NDArray[np.float64]

LOGGER = logging.getLogger(__name__)

THRESHOLD = 0.05
"""Concavity at which coacd stops to cut; smaller gives more and finer parts."""
SEED = 0
PATIENCE = 180.0
"""Seconds after which a decomposition is given up."""

_PROGRAM = """
import sys
import coacd
import numpy as np
coacd.set_log_level("error")
source, result, threshold, seed = sys.argv[1:]
with np.load(source) as data:
    mesh = coacd.Mesh(data["vertices"], data["faces"])
parts = coacd.run_coacd(mesh, threshold=float(threshold), seed=int(seed))
np.savez(result, *[vertices for vertices, _ in parts])
"""


def cache_folder() -> Path:
    """Return the folder of cached parts, ``$XDG_CACHE_HOME/mebo_grasp/convex_parts``."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "mebo_grasp" / "convex_parts"


def coacd_version() -> str | None:
    """Return the version of the installed coacd; None if there is none."""
    try:
        return importlib.metadata.version("coacd")
    except importlib.metadata.PackageNotFoundError:
        return None


def content_key(mesh: trimesh.Trimesh, version: str) -> str:
    """Return a digest of a mesh's triangles and of everything that its parts depend on."""
    digest = hashlib.sha256(f"coacd {version} {THRESHOLD} {SEED}".encode())
    digest.update(np.ascontiguousarray(mesh.vertices, dtype=np.float64).tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype=np.int64).tobytes())
    return digest.hexdigest()


def convex_parts(
    mesh: trimesh.Trimesh, name: str, folder: Path | None = None, patience: float = PATIENCE
) -> tuple[FloatArray, ...]:
    """Return convex parts whose union stands for a mesh's solid, each (n, 3) vertices in metres.

    Args:
        mesh: the surface, metres.
        name: name of the object, for the log.
        folder: where parts are cached; None: ``cache_folder()``.
        patience: seconds after which a decomposition is given up.

    Returns:
        The parts; none, with a warning that says why, where coacd is absent, fails or takes too long: the surface
        itself is then used.
    """
    version = coacd_version()
    if version is None:
        LOGGER.warning("'%s' keeps its surface: coacd is not installed (pip install coacd)", name)
        return ()
    path = (folder or cache_folder()) / f"{content_key(mesh, version)}.npz"
    parts = read_parts(path)
    if parts is None:
        parts = _decompose(mesh, name, patience)
        if parts:
            _store(path, parts)
    return parts


def read_parts(path: Path) -> tuple[FloatArray, ...] | None:
    """Return cached parts; None where there are none or they cannot be read."""
    try:
        with np.load(path) as data:
            parts = tuple(np.array(data[f"arr_{i}"], dtype=np.float64) for i in range(len(data.files)))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    sound = bool(parts) and all(part.ndim == 2 and part.shape[1] == 3 and np.isfinite(part).all() for part in parts)
    return parts if sound else None


def _store(path: Path, parts: tuple[FloatArray, ...]) -> None:
    """Write the parts beside their place and move them there, so that no reader sees half a file."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            unfinished = Path(folder) / path.name
            np.savez(unfinished, *parts)
            unfinished.replace(path)
    except OSError as error:
        LOGGER.warning("convex parts are not kept for the next start: %s", error)


def _decompose(mesh: trimesh.Trimesh, name: str, patience: float) -> tuple[FloatArray, ...]:
    with tempfile.TemporaryDirectory() as folder:
        source, result = Path(folder) / "mesh.npz", Path(folder) / "parts.npz"
        np.savez(source, vertices=np.asarray(mesh.vertices), faces=np.asarray(mesh.faces))
        command = [sys.executable, "-c", _PROGRAM, str(source), str(result), str(THRESHOLD), str(SEED)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=patience, check=False)
        except subprocess.TimeoutExpired:
            LOGGER.warning("'%s' keeps its surface: its decomposition took more than %.0f s", name, patience)
            return ()
        parts = read_parts(result)
    if done.returncode != 0 or parts is None:
        reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        LOGGER.warning("'%s' keeps its surface: coacd failed: %s", name, reason)
        return ()
    return tuple(np.array(trimesh.PointCloud(part).convex_hull.vertices) for part in parts)
