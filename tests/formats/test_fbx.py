import logging
import zlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku import builtin
from bunraku.errors import NOTE, Code
from bunraku.formats import inspect, read_character, read_figure
from bunraku.formats.fbx.clips import CONSTANT, CUBIC, Curve, evaluate
from bunraku.formats.fbx.records import MAGIC, Packed, read_records
from bunraku.rotations import compose_transforms
from bunraku.skinning import forward_kinematics, linear_blend_skinning
from bunraku.types import Character, FormatError
from tests.creatures import make_creature
from tests.formats.made_fbx import TICKS, Maker, Node, encode, encode_character, properties

SAME = 1e-5  # of the size; the project asks for 1e-4
Z_UP = {"UpAxis": 2, "FrontAxis": 1, "FrontAxisSign": -1, "CoordAxis": 0}
FILE_FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@pytest.fixture(scope="module")
def creature() -> Character:
    return make_creature(0.1)


def posed(character: Character, like: Character) -> list[np.ndarray]:
    """Give the mesh in its bind pose, and in all clips at the times of another's keys."""
    frames = [character.mesh.vertices[None]]
    for clip, other in zip(character.clips, like.clips, strict=True):
        keys = np.abs(clip.times[:, None] - other.times).argmin(axis=0)
        np.testing.assert_allclose(clip.times[keys], other.times - other.times[0], atol=1e-5)
        turns = Rotation.from_quat(clip.rotations[keys].reshape(-1, 4)).as_matrix()
        turns = turns.reshape(len(keys), -1, 3, 3) * clip.scales[keys][..., None, :]
        local = compose_transforms(clip.translations[keys], turns)
        moved = forward_kinematics(character.skeleton.parents, local)
        moved = moved @ character.skin.inverse_bind
        skin = character.skin.weights
        frames.append(linear_blend_skinning(character.mesh.vertices, skin, moved))
    return frames


def assert_same(found: Character, wanted: Character) -> None:
    """Compare names, and all places that the mesh ever takes."""
    assert set(found.skeleton.names) == set(wanted.skeleton.names)
    assert [clip.name for clip in found.clips] == [clip.name for clip in wanted.clips]
    size = np.ptp(wanted.mesh.vertices, axis=0).max()
    corners = found.mesh.faces.ravel(), wanted.mesh.faces.ravel()
    for mine, theirs in zip(posed(found, wanted), posed(wanted, wanted), strict=True):
        assert np.abs(mine[:, corners[0]] - theirs[:, corners[1]]).max() < SAME * size


def write(folder, content: bytes, name: str = "a.fbx"):
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"centimetres": 100.0, "packed": False},
        {"centimetres": 2.54, "file_from_world": FILE_FROM_Y_UP, "axes": Z_UP},
        {"version": 7700, "before": (0, 0, 0), "pivot": (0, 0, 0)},
    ],
    ids=["centimetres", "metres", "inches, z up", "version 7.7"],
)
def test_a_character_is_the_same_in_any_units_and_axes(tmp_path, creature, how):
    assert_same(read_character(write(tmp_path, encode_character(creature, **how))), creature)


def test_the_builtin_human_is_the_same_from_fbx_and_from_glb(tmp_path):
    human = builtin.human()
    human = replace(human, clips=human.clips[:2])
    assert_same(read_character(write(tmp_path, encode_character(human))), human)


def test_a_figure_keeps_uvs_normals_and_materials(tmp_path, creature):
    path = write(tmp_path, encode_character(creature), "no-suffix")
    found = inspect(path)
    assert (found.kind, found.format, found.materials) == ("character", "fbx", 1)
    assert found.joints == len(creature.skeleton.names)
    assert {clip.name for clip in found.clips} == {clip.name for clip in creature.clips}
    figure = read_figure(path)
    assert len(figure.mesh.faces) == len(creature.mesh.faces)
    json = figure.document.document.copy_json()
    (primitive,) = json["meshes"][0]["primitives"]
    assert {"NORMAL", "TEXCOORD_0"} < set(primitive["attributes"])
    assert json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] == [1, 0, 0, 1]


def box(**model) -> list[Node]:
    """Make the records of four vertices and a quad, with properties of its node."""
    objects, links = Node("Objects"), Node("Connections")
    node = objects.add("Model", 1, "box\0\x01Model", "Mesh")
    properties(node, **model)
    geometry = objects.add("Geometry", 2, "box\0\x01Geometry", "Mesh")
    geometry.add("Vertices", np.array([0.0, 0, 0, 1, 0, 0, 1, 2, 1, 0, 2, 0]))
    geometry.add("PolygonVertexIndex", np.array([0, 1, 2, -4], "<i4"))
    links.add("C", "OO", 1, 0)
    links.add("C", "OO", 2, 1)
    return [objects, links]


def test_polygons_become_triangles_and_geometry_has_a_place_of_its_own(tmp_path):
    path = write(tmp_path, encode(box(GeometricTranslation=[0.0, 0, 300], Lcl_Scaling=[2.0, 2, 2])))
    mesh = read_figure(path).mesh
    assert len(mesh.faces) == 2
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [0.02, 0.04, 6.02], atol=1e-6)


def test_curves_go_in_steps_lines_and_hermite_arcs():
    ticks, values = np.array([0, 10]) * TICKS, np.array([0.0, 10.0])
    at = np.array([0, 5, 10, 15]) * TICKS
    for flag, slopes, middle in ((0, (0, 0), 5), (CONSTANT, (0, 0), 0), (CUBIC, (0, 0), 5)):
        curve = Curve(ticks, values, np.full(2, flag), np.tile(slopes, (2, 1)).astype(float))
        np.testing.assert_allclose(evaluate(curve, at), [0, middle, 10, 10])
    steep = Curve(ticks, values, np.full(2, CUBIC), np.tile([3.0, 0.0], (2, 1)))
    assert evaluate(steep, at)[1] == pytest.approx(5 + 10 * 3 / 8)


def test_sparse_keys_are_filled_at_the_rate_of_the_file(tmp_path, creature):
    clip = creature.clips[0]
    ends = np.array([0, len(clip.times) - 1])
    sparse = replace(
        clip,
        times=np.array([0.0, 1.0]),
        translations=clip.translations[ends],
        rotations=clip.rotations[ends],
        scales=clip.scales[ends],
    )
    path = write(tmp_path, encode_character(replace(creature, clips=(sparse,))))
    (found,) = read_character(path).clips
    assert len(found.times) == 31
    assert np.ptp(np.diff(found.times)) < 1e-5


def change(creature, name: str, value: object) -> bytes:
    """Write the creature with the first record of a name changed."""
    records = Maker(creature).make()
    waiting = list(records)
    while waiting:
        node = waiting.pop(0)
        if node.name == name:
            node.values = (value,)
            return encode(records)
        waiting += node.inside
    raise KeyError(name)


@pytest.mark.parametrize(
    ("name", "value", "code", "words"),
    [
        ("Vertices", np.array([0.0, 1.0]), Code.FBX_RECORDS, "no whole vertices"),
        ("Vertices", np.array([0.0, np.nan, 0.0]), Code.MESH_NONFINITE, "vertex 0 is not finite"),
        ("Vertices", "text", Code.FBX_RECORDS, "wanted an array"),
        ("PolygonVertexIndex", np.array([0, 1, 2], "<i4"), Code.FBX_RECORDS, "has no end"),
        ("PolygonVertexIndex", np.array([0, 1, -99999], "<i4"), Code.MESH_INDEX, "vertex 99998"),
        ("Indexes", np.array([-1], "<i4"), Code.SKIN_WEIGHTS, "weights do not fit"),
        ("Transform", np.zeros(3), Code.SKIN_BIND, "no Transform of 16"),
        ("Transform", np.zeros(16), Code.SKIN_BIND, "cannot be inverted"),
        ("KeyTime", np.array([5, 1], "<i8"), Code.CLIP_VALUES, "values for 2 keys"),
    ],
)
def test_what_is_damaged_is_told(tmp_path, creature, name, value, code, words):
    with pytest.raises(FormatError, match=words) as caught:
        read_character(write(tmp_path, change(creature, name, value)))
    assert caught.value.code is code


def test_weights_and_normals_too_large_for_glb_are_no_surprise(tmp_path, creature):
    weights = np.full(int((creature.skin.weights[:, 0] != 0).sum()), 1e300)
    found = read_character(write(tmp_path, change(creature, "Weights", weights)))
    assert np.isfinite(found.skin.weights).all()
    huge = change(creature, "Normals", np.array([1e308, 1e308, 1e308]))
    assert len(read_figure(write(tmp_path, huge)).mesh.faces) == len(creature.mesh.faces)


def test_records_that_do_not_fit_are_refused(creature):
    whole = encode_character(creature)
    for content, words in (
        (whole[:20], "ends within its header"),
        (whole[:200], "ends elsewhere|breaks off"),
        (MAGIC + b"\x70\x17\0\0" + bytes(40), r"version 6; save it as FBX 2014"),
        (whole[:27] + b"\xff" * 12 + whole[39:], "too many records or values"),
    ):
        with pytest.raises(FormatError, match=words):
            read_records("a.fbx", content)


def test_an_array_that_unpacks_to_more_than_it_says_is_refused(tmp_path):
    records = box()
    bomb = zlib.compress(bytes(50_000_000))
    node = records[0].inside[1].inside[0]
    node.values = (Packed("d", 12, True, memoryview(bomb)),)
    with pytest.raises(FormatError, match="unpacks to other than 12 numbers"):
        read_figure(write(tmp_path, encode(records)))


def test_text_is_refused_and_textures_are_told(tmp_path, caplog):
    path = write(tmp_path, b"; FBX 7.4.0 project file\n")
    with pytest.raises(FormatError, match="written as text; save it as binary FBX"):
        read_figure(path)
    records = box()
    records[0].add("Texture", 9, "t\0\x01Texture", "")
    with caplog.at_level(NOTE):
        read_figure(write(tmp_path, encode(records)))
    assert "1 textures are left out" in caplog.text


@pytest.mark.parametrize(
    ("axes", "words"),
    [({"UpAxis": 0}, "not three different"), ({"UnitScaleFactor": 0.0}, "wanted centimetres")],
)
def test_settings_that_cannot_be_are_refused(tmp_path, axes, words):
    settings = Node("GlobalSettings")
    properties(settings, **axes)
    with pytest.raises(FormatError, match=words):
        read_figure(write(tmp_path, encode([settings, *box()])))


def test_left_handed_axes_are_told(tmp_path, caplog):
    settings = Node("GlobalSettings")
    properties(settings, CoordAxisSign=-1)
    with caplog.at_level(logging.WARNING):
        mesh = read_figure(write(tmp_path, encode([settings, *box()]))).mesh
    assert "left-handed" in caplog.text
    assert mesh.vertices[:, 0].max() == pytest.approx(0.01)
