"""What a file says of a figure does not hang on how it is written down."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bunraku.formats import inspect, read_figure, write_mesh
from bunraku.formats.meshes import encode_obj
from bunraku.types import FormatError, Mesh
from tests.fuzz.mutants import cube

FORMATS = ("obj", "ply", "glb", "stl", "off")
SAME = 1e-5  # of the size: what float32 in PLY, STL and GLB leaves of a coordinate
EASY = settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
COUNTED = ("faces", "parts", "closed", "boundary_edges", "non_manifold_edges", "welded_vertices")


SIZES = st.tuples(*[st.floats(0.25, 4.0)] * 3)
BOXES = st.lists(
    st.tuples(SIZES, st.integers(0, 3)), min_size=1, max_size=3
)  # size, faces left out


def build(boxes: list[tuple[tuple[float, float, float], int]]) -> Mesh:
    """Put a few boxes beside each other, some of them open."""
    vertices, faces = [], []
    for place, (size, holes) in enumerate(boxes):
        box = cube()
        vertices.append(box.vertices * size + [20.0 * place, 0, 0])
        faces.append(box.faces[holes:] + 8 * place)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def write(folder, mesh: Mesh, kind: str):
    path = folder / f"a.{kind}"
    if kind in ("obj", "ply", "glb"):
        write_mesh(path, mesh)
    elif kind == "off":
        rows = [" ".join(f"{x:.17g}" for x in row) for row in mesh.vertices.tolist()]
        rows += [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
        path.write_text("\n".join(["OFF", f"{len(mesh.vertices)} {len(mesh.faces)} 0", *rows, ""]))
    else:
        records = np.zeros(len(mesh.faces), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
        records["v"] = mesh.vertices[mesh.faces]
        path.write_bytes(bytes(80) + np.uint32(len(records)).tobytes() + records.tobytes())
    return path


def told(path) -> tuple[dict[str, object], np.ndarray]:
    found = inspect(path)
    return {name: getattr(found, name) for name in COUNTED}, np.sort(found.extent)


def assert_alike(one, other, *, scale: float = 1.0) -> None:
    assert one[0] == other[0]
    np.testing.assert_allclose(one[1] * scale, other[1], rtol=SAME, atol=SAME * other[1].max())


@EASY
@given(boxes=BOXES, kind=st.sampled_from(FORMATS), seed=st.integers(0, 99))
def test_order_does_not_matter(tmp_path, boxes, kind, seed):
    mesh = build(boxes)
    rng = np.random.default_rng(seed)
    order, faces = rng.permutation(len(mesh.vertices)), rng.permutation(len(mesh.faces))
    turned = np.roll(mesh.faces, int(rng.integers(3)), axis=1)[faces]
    shuffled = Mesh(mesh.vertices[order], np.argsort(order)[turned])
    assert_alike(told(write(tmp_path, mesh, kind)), told(write(tmp_path, shuffled, kind)))


@EASY
@given(boxes=BOXES, kinds=st.permutations(FORMATS))
def test_the_format_does_not_matter(tmp_path, boxes, kinds):
    mesh = build(boxes)
    one, other = (told(write(tmp_path, mesh, kind)) for kind in kinds[:2])
    if "stl" in kinds[:2] or len(mesh.faces) % 12:  # STL and open boxes drop what no face uses
        one[0].pop("welded_vertices"), other[0].pop("welded_vertices")
    assert_alike(one, other)


@EASY
@given(boxes=BOXES, kind=st.sampled_from(FORMATS), power=st.integers(-6, 7))
def test_scale_does_not_matter(tmp_path, boxes, kind, power):
    mesh = build(boxes)
    scaled = Mesh(mesh.vertices * 10.0**power, mesh.faces)
    one, other = told(write(tmp_path, mesh, kind)), told(write(tmp_path, scaled, kind))
    assert_alike(one, other, scale=10.0**power)


@EASY
@given(boxes=BOXES, kind=st.sampled_from(("obj", "off")), far=st.floats(-1e4, 1e4))
def test_place_does_not_matter(tmp_path, boxes, kind, far):
    mesh = build(boxes)
    moved = Mesh(mesh.vertices + np.array([far, -far, 0.5 * far]), mesh.faces)
    assert_alike(told(write(tmp_path, mesh, kind)), told(write(tmp_path, moved, kind)))


@EASY
@given(boxes=BOXES, kind=st.sampled_from(FORMATS), seed=st.integers(0, 99))
def test_turning_keeps_what_is_counted(tmp_path, boxes, kind, seed):
    mesh = build(boxes)
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    turned = Mesh(mesh.vertices @ turn.T, mesh.faces)
    one, _ = told(write(tmp_path, mesh, kind))
    other, _ = told(write(tmp_path, turned, kind))
    assert one == other


@EASY
@given(boxes=BOXES, kind=st.sampled_from(FORMATS))
def test_unwelding_does_not_matter(tmp_path, boxes, kind):
    mesh = build(boxes)
    corners = np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    apart = Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), corners)
    one, other = told(write(tmp_path, mesh, kind)), told(write(tmp_path, apart, kind))
    used = len(np.unique(mesh.faces))
    assert other[0].pop("welded_vertices") == used
    one[0].pop("welded_vertices")
    assert_alike(one, other)


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_one_figure(tmp_path, kind):
    mesh = cube()
    figure = read_figure(write(tmp_path, mesh, kind), up="y", facing="+z")
    wanted = mesh.vertices[mesh.faces]
    found = figure.mesh.vertices[figure.mesh.faces]
    np.testing.assert_allclose(found, wanted, atol=SAME * np.ptp(mesh.vertices))


@EASY
@given(text=st.text(max_size=80))
def test_any_words_end_in_a_figure_or_the_declared_error(tmp_path, text):
    for kind in (*FORMATS, "bvh", "gltf"):
        path = tmp_path / f"a.{kind}"
        path.write_text(text, "utf-8", "surrogatepass")
        try:
            inspect(path)
        except FormatError as error:
            assert error.code
    path = tmp_path / "b.obj"
    path.write_bytes(encode_obj(cube()) + text.encode("utf-8", "surrogatepass"))
    try:
        assert inspect(path).vertices >= 8
    except FormatError as error:
        assert error.where.startswith("line ")
