import numpy as np
import pytest

from bunraku.formats.gltf.accessors import read_floats, read_integers
from bunraku.formats.gltf.document import read_document
from bunraku.types import FormatError
from tests.formats.made_gltf import Made


def opened(made):
    return read_document("made.glb", made.glb())


@pytest.mark.parametrize("store", ["i1", "u1", "i2", "u2", "u4", "f4"])
def test_every_component_type(store):
    made = Made()
    values = np.arange(12).reshape(4, 3)
    index = made.array(values, "VEC3", store=store)
    np.testing.assert_array_equal(read_floats(opened(made), index, 3), values)


@pytest.mark.parametrize(
    ("store", "raw", "meaning"),
    [
        ("u1", [0, 255, 51], [0.0, 1.0, 0.2]),
        ("i1", [-128, -127, 127], [-1.0, -1.0, 1.0]),
        ("u2", [0, 65535, 13107], [0.0, 1.0, 0.2]),
        ("i2", [-32768, 0, 32767], [-1.0, 0.0, 1.0]),
    ],
)
def test_normalised_integers_are_shares(store, raw, meaning):
    made = Made()
    index = made.array(np.reshape(raw, (3, 1)), "SCALAR", store=store, normalized=True)
    np.testing.assert_allclose(read_floats(opened(made), index, 1)[:, 0], meaning, atol=1e-12)


def test_interleaved_values_are_picked_by_stride():
    made = Made()
    table = np.arange(20, dtype="<f4").reshape(4, 5)
    view = made.view(table.tobytes(), byteStride=20)
    index = made.add(
        "accessors", bufferView=view, byteOffset=8, componentType=5126, count=4, type="VEC2"
    )
    np.testing.assert_array_equal(read_floats(opened(made), index, 2), table[:, 2:4])


@pytest.mark.parametrize("with_base", [True, False])
def test_sparse_values_replace_those_of_the_base(with_base):
    made = Made()
    base = np.arange(15, dtype=float).reshape(5, 3) if with_base else np.zeros((5, 3))
    sparse = {
        "count": 2,
        "indices": {
            "bufferView": made.view(np.array([1, 4], "<u2").tobytes()),
            "componentType": 5123,
        },
        "values": {"bufferView": made.view(np.full((2, 3), 7, "<f4").tobytes())},
    }
    if with_base:
        index = made.array(base, "VEC3", sparse=sparse)
    else:
        index = made.add("accessors", componentType=5126, count=5, type="VEC3", sparse=sparse)
    base[[1, 4]] = 7
    np.testing.assert_array_equal(read_floats(opened(made), index, 3), base)


@pytest.mark.parametrize(
    ("change", "where", "message"),
    [
        ({"count": 9}, "/accessors/0/sparse/count", "9 elements differ, of 5"),
        ({"count": 4}, "/accessors/0/sparse/indices", "needs 8 bytes"),
        ({"values": {"bufferView": 0}}, "/accessors/0/sparse/values", "needs 24 bytes"),
    ],
)
def test_sparse_parts_must_fit(change, where, message):
    made = Made()
    sparse = {
        "count": 2,
        "indices": {
            "bufferView": made.view(np.array([1, 4], "<u2").tobytes()),
            "componentType": 5123,
        },
        "values": {"bufferView": made.view(np.zeros((2, 3), "<f4").tobytes())},
    } | change
    made.add("accessors", componentType=5126, count=5, type="VEC3", sparse=sparse)
    with pytest.raises(FormatError, match=message) as caught:
        opened(made)
    assert caught.value.where == where


def test_sparse_index_out_of_range():
    made = Made()
    sparse = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\x09\0\0\0"), "componentType": 5121},
        "values": {"bufferView": made.view(bytes(12))},
    }
    made.add("accessors", componentType=5126, count=5, type="VEC3", sparse=sparse)
    with pytest.raises(FormatError, match="index 9 of 5"):
        read_floats(opened(made), 0, 3)


def test_a_bomb_of_zeros_is_refused_before_it_is_made():
    made = Made()
    made.add("accessors", componentType=5126, count=4_000_000_000, type="VEC3")
    with pytest.raises(FormatError, match="4000000000 elements without any data"):
        opened(made)


def test_elements_must_not_overlap():
    made = Made()
    view = made.view(bytes(100), byteStride=4)
    made.add("accessors", bufferView=view, componentType=5126, count=2, type="VEC3")
    with pytest.raises(FormatError, match="elements of 12 bytes, 4 bytes apart"):
        opened(made)


def test_type_and_component_must_be_what_is_wanted():
    made = Made()
    floats = made.array(np.zeros((2, 2)), "VEC2")
    with pytest.raises(FormatError, match="must be VEC3, not VEC2"):
        read_floats(opened(made), floats, 3)
    with pytest.raises(FormatError, match="unsigned integers"):
        read_integers(opened(made), floats, 2)


def test_matrix_columns_count_their_padding():
    made = Made()
    view = made.view(bytes(12))
    made.add("accessors", bufferView=view, componentType=5121, count=1, type="MAT3")
    opened(made)  # three columns of three bytes, each padded to four
    made.json["accessors"][0]["count"] = 2
    with pytest.raises(FormatError, match="needs 24 bytes"):
        opened(made)
