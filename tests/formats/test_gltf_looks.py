import pytest

from bunraku.formats import read_figure
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.looks import WHITE, read_looks
from tests.formats.made_gltf import made_triangle


def read_paints(folder, *materials):
    """The paints of one triangle for each material."""
    made = made_triangle()
    (plain,) = made.json["meshes"][0]["primitives"]
    made.json["materials"] = [{"pbrMetallicRoughness": material} for material in materials]
    made.json["meshes"][0]["primitives"] = [
        plain | {"material": index} for index in range(len(materials))
    ]
    made.add("textures", source=0)
    made.add("images", bufferView=made.view(b"picture"), mimeType="image/png")
    (folder / "a.glb").write_bytes(made.glb())
    return [look.paint for look in read_looks(read_figure(folder / "a.glb").document)]


@pytest.mark.parametrize("value", [10**400, 1e300, -1e39])
def test_colours_beyond_single_precision_are_white(tmp_path, value):
    first, second = read_paints(
        tmp_path, {"baseColorFactor": [value, 0, 0, 1]}, {"baseColorFactor": [0.5, 0, 0, 1]}
    )
    assert first.colour == WHITE
    assert second.colour == (0.5, 0, 0, 1)


def test_the_document_is_decoded_once_for_all_materials(tmp_path, monkeypatch):
    copies = []
    copy = Document.copy_json
    monkeypatch.setattr(Document, "copy_json", lambda self: copies.append(1) or copy(self))
    paints = read_paints(tmp_path, *[{"baseColorTexture": {"index": 0}}] * 3)
    assert [paint.picture for paint in paints] == [b"picture"] * 3
    assert len(copies) == 1
