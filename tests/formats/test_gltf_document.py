import json
import logging
import struct

import numpy as np
import pytest

from bunraku.errors import Code
from bunraku.formats.gltf import read_figure
from bunraku.formats.gltf.document import read_document
from bunraku.types import FormatError
from tests.formats.made_gltf import TRIANGLE, Made, made_arm, made_triangle, pack_glb


def test_a_triangle_in_a_glb():
    """The smallest file worked out by hand."""
    figure = read_figure("t.glb", made_triangle().glb())
    np.testing.assert_array_equal(figure.mesh.vertices, TRIANGLE)
    np.testing.assert_array_equal(figure.mesh.faces, [[0, 1, 2]])
    np.testing.assert_array_equal(figure.pieces, [0, 0, 0])


def test_unknown_parts_stay_in_the_json_in_order():
    made = made_triangle()
    made.json = {"extras": {"b": 1, "a": None}, **made.json, "unknown": [1, 2.5]}
    found = read_document("t.glb", made.glb()).copy_json()
    assert next(iter(found)) == "extras"
    assert found["extras"] == {"b": 1, "a": None}
    assert found["unknown"] == [1, 2.5]


def test_sidecar_and_data_uri_hold_the_same(tmp_path):
    made = made_triangle()
    expected = read_figure("t.glb", made.glb()).mesh.vertices
    (tmp_path / "a b.bin").write_bytes(made.binary)
    made.json["buffers"][0]["uri"] = "a%20b.bin"
    (tmp_path / "t.gltf").write_text(json.dumps(made.json))
    np.testing.assert_array_equal(read_figure(tmp_path / "t.gltf").mesh.vertices, expected)
    import base64

    text = base64.b64encode(made.binary).decode()
    made.json["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{text}"
    content = json.dumps(made.json).encode()
    np.testing.assert_array_equal(read_figure("t.gltf", content).mesh.vertices, expected)


def broken(change):
    made = made_arm()
    made.glb()
    change(made.json)
    return made.glb()


@pytest.mark.parametrize(
    ("where", "change", "message"),
    [
        ("/nodes/0/mesh", lambda j: j["nodes"][0].update(mesh=9), "mesh 9 does not exist"),
        ("/nodes/0/mesh", lambda j: j["nodes"][0].update(mesh=-1), ">= 0"),
        ("/nodes/0/mesh", lambda j: j["nodes"][0].update(mesh=True), "Expected 'int"),
        ("/nodes/0/mesh", lambda j: j["nodes"][0].update(mesh=None), "null is not allowed"),
        ("/nodes/0/mesh", lambda j: j["nodes"][0].update(mesh=[0]), "Expected 'int"),
        ("/scene", lambda j: j.update(scene=3), "scene 3 does not exist"),
        ("/scenes/0/nodes/0", lambda j: j["scenes"][0].update(nodes=[7]), "node 7"),
        ("/skins/0/joints/1", lambda j: j["skins"][0].update(joints=[1, 99]), "node 99"),
        ("/accessors/0/bufferView", lambda j: j["accessors"][0].update(bufferView=50), "50"),
        ("/accessors/0", lambda j: j["accessors"][0].update(count=500), "needs 2000 bytes"),
        ("/accessors/0/count", lambda j: j["accessors"][0].update(count=-4), ">= 1"),
        ("/bufferViews/0", lambda j: j["bufferViews"][0].update(byteLength=10**9), "ends at"),
        ("/bufferViews/0/byteOffset", lambda j: j["bufferViews"][0].update(byteOffset=-4), ">= 0"),
        ("/bufferViews/0/buffer", lambda j: j["bufferViews"][0].update(buffer=1), "buffer 1"),
        ("/buffers/1", lambda j: j["buffers"].append({"byteLength": 4}), "has no data"),
        ("/asset/version", lambda j: j["asset"].update(version="1.0"), "only 2 is read"),
        ("/meshes/0/primitives/0/indices", lambda j: prim(j).update(indices=77), "accessor 77"),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            lambda j: prim(j)["attributes"].update(POSITION=77),
            "accessor 77",
        ),
        (
            "/animations/0/channels/0/sampler",
            lambda j: j["animations"][0]["channels"][0].update(sampler=5),
            "sampler 5",
        ),
        (
            "/animations/0/samplers/0/output",
            lambda j: j["animations"][0]["samplers"][0].update(output=500),
            "accessor 500",
        ),
        (
            "/extensionsRequired",
            lambda j: j.update(extensionsRequired=["EXT_meshopt_compression"]),
            "meshopt compressed; decompress it first: npx @gltf-transform/cli copy IN.glb OUT.glb",
        ),
    ],
)
def test_a_wrong_part_is_named_by_its_json_pointer(where, change, message):
    with pytest.raises(FormatError, match=message) as caught:
        read_document("arm.glb", broken(change))
    assert caught.value.where == where


def prim(document):
    return document["meshes"][0]["primitives"][0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"solid cube", "neither a GLB nor"),
        (b"glTF\x02\0\0\0", "cut off: 8 bytes"),
        (struct.pack("<4sII", b"glTF", 1, 20) + bytes(8), "version 1"),
        (struct.pack("<4sII", b"glTF", 2, 99) + bytes(8), "says 99 bytes and has 20"),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 1000, 0), "says 1000 bytes"),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 0, 7), "does not begin with a JSON chunk"),
        (b"{", "damaged"),
        (b'{"asset": {"version": "2.0"}, "scene": NaN}', "damaged"),
        (b'{"a":' * 100_000, "nested too deeply"),
        (pack_glb(b"[]"), "must be an object"),
        (pack_glb(b"{}"), "required field 'asset'"),
    ],
)
def test_a_broken_container_is_one_clear_error(content, message):
    with pytest.raises(FormatError, match=message):
        read_document("broken.glb", content)


def test_a_byte_cut_anywhere_is_refused():
    content = made_arm().glb()
    for length in range(1, len(content), 97):
        with pytest.raises(FormatError):
            read_figure("cut.glb", content[:length])


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "/etc/passwd",
        "file:///etc/passwd",
        "http://x/y",
        "a\\b",
    ],
)
def test_no_file_outside_the_folder_is_read(tmp_path, uri):
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    folder = tmp_path / "inner"
    folder.mkdir()
    made = made_triangle()
    made.glb()
    made.json["buffers"][0]["uri"] = uri
    (folder / "t.gltf").write_text(json.dumps(made.json))
    with pytest.raises(FormatError) as caught:
        read_figure(folder / "t.gltf")
    assert caught.value.where == "/buffers/0/uri"


@pytest.mark.parametrize("uri", ["data:text/plain,abc", "data:;base64,@@@"])
def test_a_data_uri_must_be_base64(uri):
    made = made_triangle()
    made.glb()
    made.json["buffers"][0]["uri"] = uri
    with pytest.raises(FormatError, match="base64"):
        read_document("t.gltf", json.dumps(made.json).encode())


def test_oddities_are_announced(caplog):
    made = made_triangle()
    made.json["extensionsRequired"] = ["ACME_thing", "KHR_mesh_quantization"]
    made.json["images"] = [{"uri": "missing.png"}]
    made.json["nodes"][0]["weights"] = [1.0]
    with caplog.at_level(logging.WARNING):
        read_document("t.glb", made.glb() + b"more")
    assert [record.code for record in caplog.records] == [
        Code.GLTF_EXTENSION,
        Code.GLTF_CONTAINER,
        Code.GLTF_SCHEMA,
        Code.URI_MISSING,
    ]
    for part in ("ACME_thing", "4 bytes after the end", "missing.png", "/nodes/0/weights"):
        assert part in caplog.text


def test_a_byte_order_mark_is_ignored_aloud(caplog):
    content = json.dumps(Made().json).encode()
    read_document("t.gltf", b"\xef\xbb\xbf" + content)
    assert "byte order mark" in caplog.text


@pytest.mark.parametrize("version", [2, 2.0])
def test_a_version_that_is_a_number_is_mended_aloud(caplog, version):
    document = read_document("arm.glb", broken(lambda j: j["asset"].update(version=version)))
    assert document.copy_json()["asset"]["version"] == "2.0"
    assert "/asset/version: the version is the number 2" in caplog.text
    with pytest.raises(FormatError, match="glTF version '20'; only 2 is read"):
        read_document("arm.glb", broken(lambda j: j["asset"].update(version=20)))
