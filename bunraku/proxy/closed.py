"""A figure whose body is already one closed surface: take that surface, resampled evenly."""

import fast_simplification
import igl
import numpy as np
from jaxtyping import Float

from bunraku import meshes
from bunraku.types import Mesh

BESIDE = 0.03  # how far other parts may lie from the body, as a share of the longest extent
RIM = 0.5  # longest hole that is closed with a fan, as a share of the longest extent


def closed_body(figure: Mesh) -> Mesh | None:
    """Find the part that is the figure: closed but for small holes, the rest on it or in it.

    Its own triangles know what a grid cannot: that legs which touch are two.

    Args:
        figure: welded.

    Returns:
        that part, closed, facing outwards; None if there is none or if it cuts through itself.
    """
    body, others = split_largest_part(figure)
    extent = float(np.ptp(figure.vertices, axis=0).max())
    closed = close_holes(body, RIM * extent)
    if closed is None or not is_clean(closed):
        return None
    if meshes.signed_volume(closed.vertices, closed.faces) < 0:
        closed = Mesh(closed.vertices, closed.faces[:, ::-1])
    if not lie_beside(others, closed, BESIDE * extent) or cuts_itself(closed):
        return None
    return closed


def split_largest_part(figure: Mesh) -> tuple[Mesh, Float[np.ndarray, "others 3"]]:
    """Part a mesh into its connected part of the largest area, and the vertices of all others."""
    part = meshes.connected_parts(figure.faces, len(figure.vertices))
    areas = np.linalg.norm(meshes.face_normals(figure.vertices, figure.faces), axis=1)
    main = int(np.bincount(part[figure.faces[:, 0]], areas).argmax())
    kept = figure.faces[part[figure.faces[:, 0]] == main]
    used, faces = np.unique(kept, return_inverse=True)
    elsewhere = meshes.referenced(figure.faces, len(figure.vertices)) & (part != main)
    return Mesh(figure.vertices[used], faces.reshape(-1, 3)), figure.vertices[elsewhere]


def close_holes(mesh: Mesh, longest: float) -> Mesh | None:
    """Close every hole with a fan around its middle; None if one is too long to be trusted."""
    if meshes.is_closed(mesh.faces):
        return mesh
    turned = igl.bfs_orient(np.ascontiguousarray(mesh.faces))[0].astype(np.int64)
    if not igl.is_edge_manifold(turned)[0]:
        return None
    vertices, faces, count = [mesh.vertices], [turned], len(mesh.vertices)
    for loop in igl.boundary_loop_all(turned):
        rim = mesh.vertices[loop]
        if np.linalg.norm(rim - np.roll(rim, 1, axis=0), axis=1).sum() > longest:
            return None
        ends = np.array(loop, np.int64)
        faces.append(np.column_stack([np.roll(ends, -1), ends, np.full(len(ends), count)]))
        vertices.append(rim.mean(axis=0)[None])
        count += 1
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def is_clean(mesh: Mesh) -> bool:
    """Tell whether a mesh is closed, oriented, manifold and of one part."""
    one_part = meshes.connected_parts(mesh.faces, len(mesh.vertices)).max(initial=0) == 0
    return bool(
        one_part and meshes.is_closed(mesh.faces) and np.all(igl.is_vertex_manifold(mesh.faces))
    )


def lie_beside(points: Float[np.ndarray, "points 3"], body: Mesh, distance: float) -> bool:
    """Tell whether all points lie inside a closed body or near its surface."""
    if not len(points):
        return True
    apart = meshes.closest_points(points, body.vertices, body.faces)[2]
    far = np.ascontiguousarray(points[apart > distance])
    return not len(far) or bool(
        (igl.fast_winding_number(body.vertices, body.faces, far) > 0.5).all()
    )


def cuts_itself(body: Mesh, *, share: float = 0.12, samples: int = 20_000) -> bool:
    """Tell whether more than a share of a closed surface lies inside the body it encloses.

    Thighs and arms of a posed body cut into their neighbours (3-4 % of it): its own triangles
    still know better than a grid which limb is which.
    """
    rng = np.random.default_rng(0)
    face, shares = meshes.sample_surface(body.vertices, body.faces, samples, rng)
    normals = meshes.face_normals(body.vertices, body.faces)[face]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    step = 0.002 * float(np.ptp(body.vertices, axis=0).max())
    above = meshes.interpolate(body.vertices, body.faces[face], shares) + step * normals
    buried = igl.fast_winding_number(body.vertices, body.faces, above) > 0.5
    return bool(buried.mean() > share)


def resample(body: Mesh, vertex_count: int) -> Mesh | None:
    """Bring a clean mesh to about so many vertices, keeping its topology.

    Between half and two and a half times as many it is kept as it is. Otherwise coarse triangles are split, then the
    shortest edges collapsed, which leaves triangles of even size.

    Returns:
        None if no clean mesh came out.
    """
    if vertex_count / 2 <= len(body.vertices) <= 2.5 * vertex_count:
        return body
    finer = split_long_edges(body, vertex_count)
    if len(finer.faces) > 40 * vertex_count:
        finer = simplify(finer, 20 * vertex_count)
    coarser = collapse_short_edges(finer, vertex_count)
    return coarser if coarser is not None and is_clean(coarser) else None


def collapse_short_edges(mesh: Mesh, vertex_count: int) -> Mesh | None:
    """Collapse the shortest edges that may go without harm to the topology, until so many are left.

    Returns:
        None if the mesh is not manifold.
    """
    if len(mesh.vertices) <= vertex_count:
        return mesh
    vertices, faces, *_ = igl.decimate(mesh.vertices, mesh.faces, 2 * vertex_count)
    return Mesh(vertices, faces.astype(np.int64)) if len(faces) else None


def split_long_edges(body: Mesh, vertex_count: int) -> Mesh:
    """Split every triangle in four until nearly all edges are as short as they shall become."""
    area = meshes.surface_area(body.vertices, body.faces)
    wanted = 1.5 * np.sqrt(area / vertex_count)  # an even mesh has edges of 1.07 times the root
    vertices, faces = body.vertices, body.faces
    while len(faces) < 60 * vertex_count:
        first, second = vertices[faces], vertices[np.roll(faces, 1, axis=1)]
        lengths = np.linalg.norm(first - second, axis=2).max(axis=1)
        large = np.linalg.norm(meshes.face_normals(vertices, faces), axis=1)
        if large[lengths > wanted].sum() < 0.1 * large.sum() and len(vertices) >= vertex_count:
            break
        vertices, split = igl.upsample(vertices, faces, 1)
        faces = split.astype(np.int64)
    return Mesh(vertices, faces)


def simplify(mesh: Mesh, face_count: int) -> Mesh:
    """Bring a very large mesh down to about so many faces, fast; it may lose its closedness."""
    scale = float(np.ptp(mesh.vertices, axis=0).max())  # float32 inside: centre first
    middle = mesh.vertices.mean(axis=0)
    points = ((mesh.vertices - middle) / scale).astype(np.float32)
    vertices, faces = fast_simplification.simplify(
        points, mesh.faces.astype(np.int32), target_count=face_count
    )
    return Mesh(vertices.astype(np.float64) * scale + middle, faces.astype(np.int64))
