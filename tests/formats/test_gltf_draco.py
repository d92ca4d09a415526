import sys

import numpy as np
import pytest

from bunraku.errors import Code
from bunraku.formats import inspect
from bunraku.formats.gltf import encode_character, read_character, read_figure
from bunraku.types import FormatError
from tests.formats.made_gltf import Made
from tests.fuzz.mutants import cube, make_rigged

draco = pytest.importorskip("DracoPy", reason="needs the extra draco")


def pack(made: Made, *, keep: bool = False) -> Made:
    """Compress the first primitive of a document, as exporters do."""
    primitive = made.json["meshes"][0]["primitives"][0]
    vertices, faces = cube().vertices, cube().faces
    joints = np.zeros((len(vertices), 4), np.uint8)
    joints[:, 0] = vertices[:, 1] > 1
    shares = np.tile(np.float32([1, 0, 0, 0]), (len(vertices), 1))
    generic = {0: joints, 1: shares}
    content = draco.encode(
        vertices.astype(np.float32),
        faces.astype(np.uint32),
        quantization_bits=20,
        preserve_order=True,
        generic_attributes=generic,
    )
    numbers = {
        "JOINTS_0": 0,
        "WEIGHTS_0": 1,
        "POSITION": next(
            entry["unique_id"]
            for entry in draco.decode(content).attributes
            if entry["attribute_type"] == 0
        ),
    }
    extension = {"bufferView": made.view(content), "attributes": numbers}
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    made.json["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    if not keep:
        made.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
        for index in (*primitive["attributes"].values(), primitive["indices"]):
            del made.json["accessors"][index]["bufferView"]
    return made


def test_a_packed_character_is_the_plain_one():
    plain = read_character("a.glb", make_rigged().glb())
    packed = read_character("a.glb", pack(make_rigged()).glb())
    np.testing.assert_allclose(packed.mesh.vertices, plain.mesh.vertices, atol=1e-5)
    np.testing.assert_array_equal(packed.mesh.faces, plain.mesh.faces)
    np.testing.assert_allclose(packed.skin.weights, plain.skin.weights, atol=1e-6)


def test_what_is_written_back_is_plain():
    figure = read_figure("a.glb", pack(make_rigged()).glb())
    character = read_character("a.glb", pack(make_rigged()).glb())
    again = read_character("b.glb", encode_character(figure, character))
    assert b"draco" not in encode_character(figure, character)
    np.testing.assert_allclose(again.mesh.vertices, character.mesh.vertices, atol=1e-5)


def test_plain_arrays_beside_packed_ones_are_used(monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    figure = read_figure("a.glb", pack(make_rigged(), keep=True).glb())
    assert len(figure.mesh.vertices) == 8


def test_without_the_decoder_one_line_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(FormatError, match=r"pip install \"bunraku\[draco\]\"") as caught:
        read_figure("a.glb", pack(make_rigged()).glb())
    assert caught.value.code is Code.GLTF_COMPRESSED


def spoil_data(made):
    extension = made.json["meshes"][0]["primitives"][0]["extensions"]
    view = made.json["bufferViews"][extension["KHR_draco_mesh_compression"]["bufferView"]]
    start = view["byteOffset"]
    made.binary[start : start + 5] = b"WRONG"


def spoil_count(made):
    position = made.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    made.json["accessors"][position]["count"] = 7


def spoil_number(made):
    extension = made.json["meshes"][0]["primitives"][0]["extensions"]
    extension["KHR_draco_mesh_compression"]["attributes"]["POSITION"] = 99


def spoil_view(made):
    extension = made.json["meshes"][0]["primitives"][0]["extensions"]
    extension["KHR_draco_mesh_compression"]["bufferView"] = 999


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_data, "Draco data are damaged"),
        (spoil_count, r"decodes to shape \(8, 3\), not \(7, 3\)"),
        (spoil_number, "compressed POSITION is missing"),
        (spoil_view, "view 999 does not exist"),
    ],
)
def test_damaged_packing_is_refused(spoil, message):
    made = pack(make_rigged())
    spoil(made)
    with pytest.raises(FormatError, match=message):
        read_figure("a.glb", made.glb())


def test_inspection_reads_it(tmp_path):
    (tmp_path / "a.glb").write_bytes(pack(make_rigged()).glb())
    found = inspect(tmp_path / "a.glb")
    assert (found.vertices, found.closed, found.joints) == (8, True, 2)


def test_packed_meshes_that_no_node_shows_are_shown(tmp_path, caplog):
    made = pack(make_rigged())
    del made.json["nodes"][2]["mesh"], made.json["nodes"][2]["skin"], made.json["animations"]
    del made.json["skins"]
    assert len(read_figure("a.glb", made.glb()).mesh.faces) == 12
    assert "no node shows a mesh" in caplog.text
