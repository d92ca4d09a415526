"""Read a glTF file as a figure, or as a character with its clips."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.formats.gltf.binding import bind_skins, place_block
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.draco import read_unpacked
from bunraku.formats.gltf.geometry import Block, read_blocks
from bunraku.formats.gltf.tree import Tree, build_tree
from bunraku.meshes import face_normals
from bunraku.types import Figure, Mesh

IDENTITY = np.eye(4)


@dataclass(frozen=True, eq=False)
class FigureDocument:
    """What a glTF figure keeps for its writer."""

    document: Document
    tree: Tree
    blocks: tuple[Block, ...]
    world_from_mesh: Float[np.ndarray, "blocks 4 4"]
    world_from_file: Float[np.ndarray, "4 4"]


def read_figure(
    path: Location,
    content: bytes | None = None,
    *,
    world_from_file: Float[np.ndarray, "4 4"] | None = None,
) -> Figure:
    """Read the surface of a glTF file in world space; of a rigged file, in its bind pose.

    Args:
        path: the file.
        content: its bytes, if they are known already.
        world_from_file: turns and scales the file's own world, for files with other axes.

    Returns:
        the figure; each of its pieces is a vertex buffer as one node shows it, and vertices are
        those of the file, in its order.

    Raises:
        FormatError: if the file cannot be trusted, or shows no surface of any area.
    """
    document = read_unpacked(path, content)
    tree = build_tree(document)
    blocks = read_blocks(document, tree)
    turn = np.eye(4) if world_from_file is None else world_from_file
    figure = build_figure(document, tree, blocks, world_from_file=turn)
    if len(figure.mesh.faces) and not face_normals(figure.mesh.vertices, figure.mesh.faces).any():
        raise document.fault(
            "/meshes",
            "every triangle has zero area; export the surface again",
            code=Code.MESH_NO_AREA,
        )
    return figure


def looks_back(figure: Figure) -> bool:
    """Tell whether a figure looks along -Z in its file, as VRM 0 does by definition."""
    kept = figure.document
    return isinstance(kept, FigureDocument) and "VRM" in kept.document.gltf.extensions_used


def turn_round(figure: Figure) -> Figure:
    """Turn a glTF figure by half a turn about Y: one that looked along -Z looks along +Z."""
    kept = figure.document
    assert isinstance(kept, FigureDocument)
    half = np.diag([-1.0, 1.0, -1.0, 1.0])
    turned = replace(
        kept,
        world_from_mesh=half @ kept.world_from_mesh,
        world_from_file=half @ kept.world_from_file,
    )
    return replace(
        figure,
        mesh=replace(figure.mesh, vertices=figure.mesh.vertices @ half[:3, :3]),
        document=turned,
        world_from_file=half @ figure.world_from_file,
    )


def build_figure(
    document: Document,
    tree: Tree,
    blocks: list[Block],
    *,
    world_from_file: Float[np.ndarray, "4 4"] = IDENTITY,
) -> Figure:
    """Place all blocks in the world, in their bind pose; see `read_figure`."""
    if not blocks:
        raise document.fault("/meshes", "no mesh is shown; export a surface", code=Code.MESH_EMPTY)
    binding = bind_skins(document, tree, blocks)
    places = np.stack([world_from_file @ place_block(document, tree, binding, b) for b in blocks])
    mesh = join_blocks(document, blocks, places)
    sizes = [len(block.vertices) for block in blocks]
    kept = FigureDocument(document, tree, tuple(blocks), places, world_from_file)
    pieces = np.repeat(np.arange(len(blocks)), sizes)
    return Figure(document.path, mesh, pieces, kept, world_from_file)


def join_blocks(
    document: Document, blocks: list[Block], world_from_mesh: Float[np.ndarray, "blocks 4 4"]
) -> Mesh:
    """Put all blocks into one mesh in world space; mirrored ones keep their outside outside."""
    vertices, faces, first = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for block, place in zip(blocks, world_from_mesh, strict=True):
        is_mirrored = np.linalg.det(place[:3, :3]) < 0
        vertices.append(block.vertices @ place[:3, :3].T + place[:3, 3])
        faces.append(first + (block.faces[:, ::-1] if is_mirrored else block.faces))
        first += len(block.vertices)
    joined = np.concatenate(vertices)
    if not np.isfinite(joined).all():
        raise document.fault(
            "/nodes",
            "vertices are too far away to compute with; scale it down",
            code=Code.MESH_NONFINITE,
        )
    return Mesh(joined, np.concatenate(faces))
