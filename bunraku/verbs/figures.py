"""Figures as verbs take them: files, what `read` gave, or bare arrays."""

import os

import numpy as np

from bunraku.formats import looks_back, read_figure, turn_round
from bunraku.formats.files import Location
from bunraku.types import Figure, Mesh
from bunraku.verbs.failing import about


def as_figure(
    figure: Location | Figure | Mesh, *, up: str | None = None, facing: str | None = None
) -> Figure:
    """Read a figure, unless it is one; bare arrays become one of a single piece.

    Raises:
        FormatError: if the file cannot be read.
        ValueError: if axes are given for what is no file.
    """
    if isinstance(figure, str | os.PathLike):
        with about(os.fspath(figure)):
            return read_figure(figure, up=up, facing=facing)
    if up or facing:
        raise ValueError("`up` and `facing` are about files; give them to `read`, or turn the mesh")
    if isinstance(figure, Figure):
        return figure
    return Figure("mesh", figure, np.zeros(len(figure.vertices), np.int64))


def as_front(
    figure: Location | Figure | Mesh, *, up: str | None = None, facing: str | None = None
) -> Figure:
    """Read a figure so that it looks along +Z, for those to whom left is not right.

    A file whose format says that it looks along -Z (VRM 0) is turned, unless `facing` is given, or
    other axes than the file's own were chosen, here or in `read`.
    """
    found = as_figure(figure, up=up, facing=facing)
    is_as_stored = facing is None and np.array_equal(found.world_from_file, np.eye(4))
    return turn_round(found) if is_as_stored and looks_back(found) else found
