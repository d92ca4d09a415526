"""Make any unrigged 3D figure move.

    import bunraku

    result = bunraku.animate("hero.obj", "knight.glb", ["Walk"])
    bunraku.write("hero.glb", result)

The functions are the commands of the command line, with the same options: `animate`, `rig`,
`repose`, `pose`, `capture`, `inspect`,
`batch`; `read` and `write` are its files. A `Result` keeps every
stage. What a function needs is imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str
    from bunraku.batching.batches import batch
    from bunraku.batching.jobs import Job
    from bunraku.batching.records import Record
    from bunraku.formats import inspect
    from bunraku.formats import read_figure as read
    from bunraku.types import FormatError, MatchError
    from bunraku.verbs.animating import animate, repose, rig
    from bunraku.verbs.filming import Film, capture
    from bunraku.verbs.performing import read_performer
    from bunraku.verbs.posing import Posed, pose
    from bunraku.verbs.results import Result
    from bunraku.verbs.writing import write

UNKNOWN = "0+unknown"  # version of files that were never installed
__all__ = [
    "Film",
    "FormatError",
    "Job",
    "MatchError",
    "Posed",
    "Record",
    "Result",
    "animate",
    "batch",
    "capture",
    "inspect",
    "pose",
    "read",
    "read_performer",
    "repose",
    "rig",
    "write",
]
_HOMES = {
    "FormatError": "bunraku.types",
    "MatchError": "bunraku.types",
    "Result": "bunraku.verbs.results",
    "Job": "bunraku.batching.jobs",
    "Record": "bunraku.batching.records",
    "animate": "bunraku.verbs.animating",
    "Film": "bunraku.verbs.filming",
    "batch": "bunraku.batching.batches",
    "capture": "bunraku.verbs.filming",
    "inspect": "bunraku.formats",
    "Posed": "bunraku.verbs.posing",
    "pose": "bunraku.verbs.posing",
    "read": "bunraku.formats:read_figure",
    "read_performer": "bunraku.verbs.performing",
    "repose": "bunraku.verbs.animating",
    "rig": "bunraku.verbs.animating",
    "write": "bunraku.verbs.writing",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first used; the version is that of the installation."""
    if name == "__version__":
        return globals().setdefault(name, _find_version())
    if name not in _HOMES:
        raise AttributeError(f"module 'bunraku' has no attribute {name!r}")
    module, _, original = _HOMES[name].partition(":")
    found = getattr(import_module(module), original or name)
    globals()[name] = found
    return found


def _find_version() -> str:
    """Look up which version was installed: of the last tag, and how far beyond it."""
    metadata = import_module("importlib.metadata")
    try:
        return str(metadata.version("bunraku"))
    except metadata.PackageNotFoundError:
        return UNKNOWN


def __dir__() -> list[str]:
    """List the public names, imported or not."""
    return sorted({*globals(), *__all__})
