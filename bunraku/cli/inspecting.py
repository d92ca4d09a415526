"""bunraku inspect: what a file holds, and what is wrong with it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import typer

from bunraku.cli.failures import about, printing_warnings

if TYPE_CHECKING:
    from bunraku.formats import Inspection

BINDS = {
    "nodes": "meshes hang on the nodes",
    "identity": "no inverse bind matrices",
    "same": "as the nodes stand",
    "own": "another than the nodes'",
    "rest": "the recording's rest pose",
}
SHOWN = 12  # clips, faults or extensions; --json has all
WIDTH = 16


def print_inspection(path: Path, *, as_json: bool) -> None:
    """Print what the inspection of a file found, as a table or as JSON."""
    from bunraku.formats import inspect

    with about(path), printing_warnings(path):
        found = inspect(path)
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(found), indent=2))
        return
    for name, value in tabulate(found):
        shown = "".join(letter if letter.isprintable() else "?" for letter in value)
        typer.echo(f"{name:<{WIDTH}}{shown}".rstrip())  # names in a file may steer a terminal


def tabulate(found: "Inspection") -> Iterator[tuple[str, str]]:
    """List the facts that a file of this kind has, each with its name."""
    yield "file", f"{found.path}: {found.kind}, {found.format}, {found.bytes:,} bytes"
    if found.vertices:
        yield from _tabulate_surface(found)
    if found.vertices or found.joints:
        yield from _tabulate_place(found)
    yield from _tabulate_depth(found)
    for clip in found.clips[:SHOWN]:
        yield "clip", f"{clip.name}: {clip.seconds:.4g} s, {clip.frames} frames"
    for name in found.extensions_used[:SHOWN]:
        needed = " (required)" if name in found.extensions_required else ""
        yield "extension", f"{name}{needed}"
    for fault in found.faults[:SHOWN]:
        place = f"{fault.where}: " if fault.where else ""
        yield fault.severity, f"{place}{fault.message} [{fault.code}]"
    for name in ("clips", "extensions_used", "faults"):
        left = len(getattr(found, name)) - SHOWN
        if left > 0:
            yield "", f"... {left} more {name.replace('_', ' ')}: --json"


def _tabulate_depth(found: "Inspection") -> Iterator[tuple[str, str]]:
    """List what a depth camera saw, and how; nothing of other files."""
    if found.kind != "depth":
        return
    width, height = found.pixels
    across, along = found.view_degrees
    yield "frames", f"{width} x {height} pixels, a view of {across:.0f} x {along:.0f} degrees"
    yield "depth", f"{found.depth_metres[0]:.2f} to {found.depth_metres[1]:.2f} m"
    yield "subject", "masked" if found.masked else "told from the scene by depth and motion"


def _tabulate_place(found: "Inspection") -> Iterator[tuple[str, str]]:
    """List the joints, and where everything is."""
    if found.joints:
        skins = f", skins of {', '.join(map(str, found.skins))}" if found.skins else ""
        yield "joints", f"{found.joints}{skins}"
        yield "bind pose", BINDS.get(found.bind, found.bind)
    axes = zip("xyz", found.low, found.high, strict=True)
    yield "bounds", ", ".join(f"{axis} {low:.4g} to {high:.4g}" for axis, low, high in axes)
    yield "up, facing", f"{found.up}, {found.facing} (axes of the file; bounds are upright)"


def _tabulate_surface(found: "Inspection") -> Iterator[tuple[str, str]]:
    """List what there is to say about a surface."""
    yield "meshes", f"{found.meshes:,} ({found.pieces:,} pieces, {found.parts:,} connected parts)"
    yield "vertices", f"{found.vertices:,} ({found.welded_vertices:,} welded)"
    yield "faces", f"{found.faces:,}"
    if found.closed:
        yield "surface", "closed"
    elif found.faces:
        crowded = f", {found.non_manifold_edges:,} of three faces or more"
        edges = f"{found.boundary_edges:,} boundary edges"
        yield "surface", f"open: {edges}{crowded if found.non_manifold_edges else ''}"
    if found.materials or found.textures:
        yield "looks", f"{found.materials} materials, {found.textures} textures"
