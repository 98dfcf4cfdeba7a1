"""Drop compiled kernels that are older than the source of any.

Numba compiles a kernel again when its own file has changed, but not when that of a kernel has which it calls: what it
kept has the old one inside. After a `git pull` or an edit a run would be made of old and new parts, and would be
neither. This happens when the package is imported, before any kernel is loaded.
"""

from pathlib import Path


def drop_stale_kernels(package: Path) -> int:
    """Delete indices of kernels beneath a folder that are older than the newest source with kernels; how many.

    An installation that cannot be written to is left as it is: its sources do not change either.
    """
    indices = list(package.glob("**/__pycache__/*.nbi"))
    sources = {index.parent.parent / f"{index.name.partition('.')[0]}.py" for index in indices}
    newest = max((source.stat().st_mtime_ns for source in sources if source.exists()), default=0)
    dropped = 0
    for index in indices:
        try:
            if index.stat().st_mtime_ns < newest:
                index.unlink()
                dropped += 1
        except OSError:  # somebody else was faster, or the installation cannot be written to
            continue
    return dropped
