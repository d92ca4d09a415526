"""A figure whose body is already one closed surface: take that surface, resampled evenly."""

import fast_simplification
import igl
import numpy as np
from jaxtyping import Float

from bunraku import meshes
from bunraku.types import Mesh

BESIDE = 0.03  # how far other parts may lie from the body, as a share of the longest extent
MOST_HALVINGS = 20  # of the edges of a coarse body
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

    Between half and two and a half times as many it is kept as it is. Otherwise long edges are
    split, then the shortest collapsed, which leaves triangles of even size.

    Returns:
        None if no clean mesh of about that size came out.
    """
    if vertex_count / 2 <= len(body.vertices) <= 2.5 * vertex_count:
        return body
    finer = split_long_edges(body, vertex_count)
    coarser = collapse_short_edges(finer, vertex_count)
    return coarser if stands_in(coarser, vertex_count) else None


def stands_in(mesh: Mesh, vertex_count: int) -> bool:
    """Tell whether a mesh is clean, faces outwards and has half to double as many vertices."""
    fits = vertex_count / 2 <= len(mesh.vertices) <= 2 * vertex_count
    return fits and is_clean(mesh) and meshes.signed_volume(mesh.vertices, mesh.faces) > 0


def collapse_short_edges(mesh: Mesh, vertex_count: int) -> Mesh:
    """Collapse the shortest edges that may go without harm to the topology, until so many are left.

    What is not manifold comes back without faces.
    """
    if len(mesh.vertices) <= vertex_count:
        return mesh
    vertices, faces, *_ = igl.decimate(mesh.vertices, mesh.faces, 2 * vertex_count)
    return Mesh(vertices, faces.astype(np.int64))


def split_long_edges(body: Mesh, vertex_count: int) -> Mesh:
    """Halve the long edges of a closed mesh until it is as fine as it shall become, or finer."""
    area = meshes.surface_area(body.vertices, body.faces)
    longest = float(np.sqrt(area / vertex_count))  # an even mesh has edges of 1.07 times that
    for _ in range(MOST_HALVINGS):
        finer = halve_edges(body, longest)
        if len(finer.faces) == len(body.faces):
            if len(body.vertices) >= vertex_count:
                break
            longest *= 0.7
        crowded = len(finer.vertices) > 6 * vertex_count  # thin triangles beget thin triangles
        body = collapse_short_edges(finer, 2 * vertex_count) if crowded else finer
    return body


def halve_edges(mesh: Mesh, longest: float) -> Mesh:
    """Put a vertex into the middle of every longer edge, and cut its triangles there."""
    count = len(mesh.vertices)
    ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1), axis=-1)
    keys, edge = np.unique(ends[..., 0] * count + ends[..., 1], return_inverse=True)
    start, stop = (mesh.vertices[keys // count], mesh.vertices[keys % count])
    lengths = np.linalg.norm(stop - start, axis=1)
    long = lengths > longest
    middle = np.where(long, count - 1 + np.cumsum(long), -1)
    edge = edge.reshape(-1, 3)
    turns = (lengths[edge].argmax(axis=1)[:, None] + np.arange(3)) % 3  # the longest edge first
    corners, edge = np.take_along_axis(mesh.faces, turns, 1), np.take_along_axis(edge, turns, 1)
    kept = ~long[edge[:, 0]]
    (a, b, c), (ab, bc, ca) = corners[~kept].T, middle[edge[~kept]].T
    pieces = [
        corners[kept],
        np.column_stack([a, ab, np.where(ca < 0, c, ca)]),
        np.column_stack([ab, c, ca])[ca >= 0],
        np.column_stack([ab, b, np.where(bc < 0, c, bc)]),
        np.column_stack([ab, bc, c])[bc >= 0],
    ]
    vertices = np.concatenate([mesh.vertices, (start + stop)[long] / 2])
    return Mesh(vertices, np.concatenate(pieces))


def simplify(mesh: Mesh, face_count: int) -> Mesh:
    """Bring a very large mesh down to about so many faces, fast; it may lose its closedness."""
    scale = float(np.ptp(mesh.vertices, axis=0).max())  # float32 inside: centre first
    middle = mesh.vertices.mean(axis=0)
    points = ((mesh.vertices - middle) / scale).astype(np.float32)
    vertices, faces = fast_simplification.simplify(
        points, mesh.faces.astype(np.int32), target_count=face_count
    )
    return Mesh(vertices.astype(np.float64) * scale + middle, faces.astype(np.int64))
