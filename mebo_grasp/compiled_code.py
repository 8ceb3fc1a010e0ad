"""Throws away compiled code that no longer fits the sources.

numba compiles a function again when the file that defines it changes, but not when a function that it calls from
another file does. Within a room compiled functions call one another across modules, so after any change in its
folder all of the folder's compiled code goes. Every folder with compiled code calls this when it is imported.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

STAMP = "sources.sha256"
_HOW = Path(__file__).with_name("compiling.py")


def sources_digest(folder: Path) -> str:
    """Return a digest of names and contents of the modules in a folder, and of how they are compiled."""
    digest = hashlib.sha256()
    for path in (*sorted(folder.glob("*.py")), _HOW):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def discard_stale_code(folder: Path) -> bool:
    """Delete numba's cache beside the modules of a folder if it was made from other sources.

    Args:
        folder: the package's folder; its cache is ``__pycache__`` within.

    Returns:
        Whether anything was stale. Where the folder cannot be written nothing is done: an installed package
        changes as a whole, and numba then sees that every file is newer.
    """
    cache, digest = folder / "__pycache__", sources_digest(folder)
    stamp = cache / STAMP
    with contextlib.suppress(OSError):
        if stamp.read_text() == digest:
            return False
    try:
        cache.mkdir(exist_ok=True)
        for pattern in ("*.nbi", "*.nbc"):
            for path in cache.glob(pattern):
                path.unlink(missing_ok=True)
        stamp.write_text(digest)
    except OSError:
        return False
    return True
