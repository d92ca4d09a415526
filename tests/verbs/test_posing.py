import json

import numpy as np
import pytest

import bunraku
from bunraku import builtin
from bunraku.errors import Code
from bunraku.neural.bodies import pose_body
from bunraku.neural.corpus import draw_sculpted
from bunraku.neural.variation import chain_turns
from bunraku.rotations import vectors_to_matrices
from bunraku.skinning import play_clip
from bunraku.types import FormatError, MatchError, Mesh
from bunraku.verbs import posing, training
from bunraku.verbs.figures import as_front


@pytest.fixture(scope="module")
def avatar():
    return draw_sculpted("rounded", np.random.default_rng(3))


@pytest.fixture(scope="module")
def poses(avatar):
    own = np.random.default_rng(5).normal(0, 0.3, (2, len(avatar.joints), 3))
    turned = pose_body(avatar, chain_turns(avatar.anatomy, vectors_to_matrices(own)))
    return [Mesh(vertices, avatar.mesh.faces) for vertices in turned]


@pytest.fixture(scope="module")
def posed(avatar, poses):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    figure = draw_sculpted("rounded", np.random.default_rng(8))
    return bunraku.pose(figure.mesh, avatar.mesh, poses, force=True)


def test_a_figure_takes_poses_and_plays_them_as_a_clip(posed):
    character = posed.character
    assert len(character.clips[0].times) == 2 and len(posed.surfaces) == 2
    frames = play_clip(character, character.clips[0])
    assert np.isfinite(frames).all()
    assert np.abs(frames[0] - character.mesh.vertices).max() > 0.05
    assert posed.report["route"] == "from_avatar" and 0 <= posed.confidence <= 1


def test_it_is_written_as_a_rigged_file_and_as_surfaces(posed, tmp_path):
    bunraku.write(tmp_path / "out.glb", posed)
    again = bunraku.read_performer(tmp_path / "out.glb")
    assert len(again.clips) == 1 and len(again.skeleton.names) == 20
    bunraku.write(tmp_path / "out.obj", posed)
    assert sorted(path.name for path in tmp_path.glob("*.obj")) == ["out-001.obj", "out-002.obj"]
    surface = bunraku.read(tmp_path / "out-002.obj").mesh
    assert np.allclose(surface.vertices, posed.surfaces[1].vertices, atol=1e-5)
    bunraku.write(tmp_path / "out.json", posed)


PITCH = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # on its face; and from Y up to Z up


def write_objs(folder, *meshes):
    """Write meshes to files that do not say which axis is up."""
    folder.mkdir()
    places = [folder / f"{number}.obj" for number in range(len(meshes))]
    for place, mesh in zip(places, meshes, strict=True):
        bunraku.write(place, mesh)
    return places


def turn(mesh):
    return Mesh(mesh.vertices @ PITCH.T, mesh.faces)


def test_an_avatar_that_is_laid_down_lays_the_figure_down(avatar, tmp_path):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    figure = draw_sculpted("rounded", np.random.default_rng(8)).mesh
    rest, down = write_objs(tmp_path / "objs", avatar.mesh, turn(avatar.mesh))
    laid = bunraku.pose(figure, rest, [down], force=True).surfaces[0]
    size = np.ptp(figure.vertices, axis=0)
    assert np.allclose(np.ptp(laid.vertices, axis=0), size[[0, 2, 1]], rtol=0.1)


def test_the_axis_that_is_up_at_rest_is_up_in_every_pose(avatar, cube, tmp_path, monkeypatch):
    given = []

    def keep(read, rest, poses, figure, **options):
        given.append((rest.vertices, *poses))
        raise MatchError("enough is known")

    monkeypatch.setattr(posing, "load_reader", lambda network, seed: None)
    monkeypatch.setattr(posing, "animate_from_avatar", keep)
    upright, down = avatar.mesh, turn(avatar.mesh)
    told = upright, down, upright
    for folder, meshes in (("y", told), ("z", tuple(map(turn, told)))):
        rest, *poses = write_objs(tmp_path / folder, *meshes)
        with pytest.raises(MatchError):
            bunraku.pose(cube, rest, poses)
    assert np.allclose(given[0], given[1], atol=1e-6)
    assert np.allclose(given[0], [mesh.vertices for mesh in told], atol=1e-6)


def refuse(figure, rest, posed, match, code):
    with pytest.raises(FormatError, match=match) as caught:
        bunraku.pose(figure, rest, posed)
    assert caught.value.code is code


def test_a_pose_with_other_vertices_is_refused(avatar, cube):
    other = Mesh(avatar.mesh.vertices[:-1], avatar.mesh.faces[:0])
    refuse(cube, avatar.mesh, [other], "same vertex order", Code.AVATAR_POSED)


def test_a_pose_with_shuffled_vertices_is_refused(avatar, cube, rng):
    shuffled = Mesh(rng.permutation(avatar.mesh.vertices), avatar.mesh.faces)
    refuse(cube, avatar.mesh, [shuffled], "another order", Code.AVATAR_POSED)


def test_a_pose_in_another_unit_is_refused(avatar, cube):
    large = Mesh(100 * avatar.mesh.vertices, avatar.mesh.faces)
    refuse(cube, avatar.mesh, [large], "100 times as large", Code.AVATAR_POSED)


def test_no_pose_at_all_is_refused(avatar, cube):
    refuse(cube, avatar.mesh, [], "no pose", Code.OPTION)


def test_without_torch_it_says_how_to_install_it(avatar, cube, monkeypatch):
    monkeypatch.setattr(posing, "find_spec", lambda name: None)
    refuse(cube, avatar.mesh, [avatar.mesh], r"bunraku\[neural\]", Code.EXTRA_MISSING)


def test_a_file_that_is_no_network_is_refused(avatar, cube, tmp_path):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    good, listed = builtin.shape_network(), b'{"__metadata__":[]}'
    notes = [b"no dictionary", bytes([len(listed)]) + b"\0" * 7 + listed]
    for content in (b"nonsense", b"\x02\0\0\0\0\0\0\0{}", b"\xff" * 64, good[:-9], *notes):
        path = tmp_path / "network.safetensors"
        path.write_bytes(content)
        with pytest.raises(FormatError, match="no shape network") as caught:
            bunraku.pose(cube, avatar.mesh, [avatar.mesh], network=path)
        assert caught.value.code is Code.NETWORK


def test_a_network_of_impossible_numbers_is_refused(avatar, cube, tmp_path):
    torch = pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    from bunraku.neural.checkpoints import read_tensors, write_tensors

    notes, tensors = read_tensors(builtin.shape_network())
    spoilt = {**tensors, "kind.bias": torch.full((2,), torch.nan)}
    endless, uneven = ({**notes, "width": width} for width in ("1000000000", "130"))
    path = tmp_path / "network.safetensors"
    for told, stored in ((notes, spoilt), (endless, tensors), (uneven, tensors)):
        path.write_bytes(write_tensors(stored, told))
        with pytest.raises(FormatError, match="no shape network"):
            bunraku.pose(cube, avatar.mesh, [avatar.mesh], network=path)


def test_training_writes_weights_and_goes_on_after_a_stop(tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    from bunraku.neural.corpus import Size

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    size = Size(people=0, outfits=0, sculpted=2, quadrupeds=2)
    whole, halves = tmp_path / "a" / "whole.safetensors", tmp_path / "halves.safetensors"
    training.train_shape(whole, steps=2, size=size)
    line = training.train_shape(halves, steps=2, size=size, minutes=1e-9)
    assert "step 1 of 2" in line and not halves.exists()
    training.train_shape(halves, steps=2, size=size, resume=True)
    assert halves.read_bytes() == whole.read_bytes()


def test_resuming_what_was_never_begun_is_refused(tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    from bunraku.neural.corpus import Size

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(FormatError, match="checkpoint"):
        size = Size(people=0, outfits=0, sculpted=1, quadrupeds=1)
        training.train_shape(tmp_path / "none.safetensors", resume=True, size=size)


@pytest.fixture
def train(tmp_path, monkeypatch):
    """Train in a folder, on a few bodies."""
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    from bunraku.neural.corpus import Size

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def run(steps=3, bodies=1, **options):
        size = Size(people=0, outfits=0, sculpted=bodies, quadrupeds=1)
        return training.train_shape(tmp_path / "net.safetensors", steps=steps, size=size, **options)

    return run


def test_resuming_goes_no_further_than_until(train, tmp_path):
    weights = tmp_path / "net.safetensors"
    assert "step 1 of 3" in train(minutes=1e-9)
    assert "trained 2 steps" in train(until=2, resume=True)
    first = weights.read_bytes()
    weights.unlink()
    assert "trained 2 steps" in train(until=2, resume=True) and weights.read_bytes() == first
    with pytest.raises(FormatError, match="step 2 already, past --until 1"):
        train(until=1, resume=True)


@pytest.mark.parametrize(
    "option", [{"until": 0}, {"until": 4}, {"steps": 0}, {"minutes": 0.0}, {"minutes": np.nan}]
)
def test_numbers_out_of_range_are_refused(train, option):
    with pytest.raises(FormatError, match="wanted") as caught:
        train(**option)
    assert caught.value.code is Code.OPTION


def test_training_anew_does_not_lose_a_checkpoint(train, tmp_path):
    train(minutes=1e-9)
    with pytest.raises(FormatError, match="go on with --resume") as caught:
        train()
    assert caught.value.code is Code.OUT_PLACE
    with pytest.raises(FormatError, match="not of this course; name another file") as caught:
        train(steps=2)
    assert caught.value.code is Code.OUT_PLACE
    (tmp_path / "net.checkpoint").unlink()
    assert "trained 2 steps" in train(steps=2)


def test_a_checkpoint_of_another_corpus_is_refused(train):
    train(minutes=1e-9)
    with pytest.raises(FormatError, match="not of corpus"):
        train(bodies=2, resume=True)


def test_a_damaged_checkpoint_is_refused_in_one_line(train, tmp_path):
    train(minutes=1e-9)
    place = tmp_path / "net.checkpoint"
    good = place.read_bytes()
    for content in (b"garbage", good[:-5], good[:40], builtin.shape_network()):
        place.write_bytes(content)
        with pytest.raises(FormatError) as caught:
            train(resume=True)
        assert caught.value.code is Code.NETWORK and "\n" not in str(caught.value)


def write_avatar(folder, avatar, poses):
    folder.mkdir()
    bunraku.write(folder / "rest.obj", avatar.mesh)
    for i, mesh in zip((2, 10), poses, strict=True):
        bunraku.write(folder / f"pose-{i}.obj", mesh)
    return folder


def test_an_avatar_in_a_folder_is_a_performance(avatar, poses, tmp_path):
    """`animate` finds the route from what performs; poses come in the order of their numbers."""
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    folder = write_avatar(tmp_path / "avatar", avatar, poses)
    rest, posed = posing.avatar_files(folder)
    assert rest.name == "rest.obj" and [p.name for p in posed] == ["pose-2.obj", "pose-10.obj"]
    figure = draw_sculpted("rounded", np.random.default_rng(8)).mesh
    moved = bunraku.animate(figure, folder, force=True)
    assert isinstance(moved, posing.Posed) and len(moved.character.clips[0].times) == 2
    same = bunraku.pose(figure, rest, posed, force=True)
    assert np.array_equal(moved.surfaces[1].vertices, same.surfaces[1].vertices)
    bunraku.write(tmp_path / "out.glb", moved)
    with pytest.raises(FormatError, match="has no clip 'Walk'"):
        bunraku.animate(figure, folder, ["Walk"])


def test_an_avatar_has_one_clip_and_no_joints(avatar, poses, cube, tmp_path, caplog):
    folder = write_avatar(tmp_path / "avatar", avatar, poses)
    with pytest.raises(FormatError, match="'capture'; an avatar's poses are one clip, 'pose'"):
        bunraku.animate(cube, folder, ["capture"])
    with pytest.raises(FormatError, match="which an avatar without a rig does not have"):
        bunraku.animate(cube, folder, ["pose"], landmarks={"tail": (0.0, 0.0, 0.0)})
    with caplog.at_level("INFO"):
        posing.check_avatar(folder, ["pose"], None, contacts=False)
    assert "plant no feet" in caplog.text


def test_folders_that_are_no_avatar_say_why(avatar, poses, tmp_path):
    folder = write_avatar(tmp_path / "avatar", avatar, poses)
    for path in folder.glob("pose-*"):
        path.unlink()
    with pytest.raises(FormatError, match="no poses"):
        posing.avatar_files(folder)
    (folder / "rest.ply").write_bytes((folder / "rest.obj").read_bytes())
    assert posing.is_avatar_folder(folder)
    with pytest.raises(FormatError, match="2 meshes called rest"):
        posing.avatar_files(folder)
    (folder / "rest.ply").unlink()
    (folder / "rest.obj").rename(folder / "still.obj")
    assert not posing.is_avatar_folder(folder)


@pytest.fixture(scope="module")
def plain_and_back(tmp_path_factory):
    """A figure as plain glTF, and as VRM 0, which looks along -Z by definition."""
    tmp_path = tmp_path_factory.mktemp("looking")
    rigged = bunraku.rig(builtin.figure_paths()["stylised"], force=True)
    bunraku.write(tmp_path / "plain.glb", rigged)
    plain = (tmp_path / "plain.glb").read_bytes()
    length = int.from_bytes(plain[12:16], "little")
    document = json.loads(plain[20 : 20 + length])
    document.setdefault("extensionsUsed", []).append("VRM")
    document.setdefault("extensions", {})["VRM"] = {"specVersion": "0.0"}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunk = len(text).to_bytes(4, "little") + b"JSON" + text + plain[20 + length :]
    whole = plain[:8] + (12 + len(chunk)).to_bytes(4, "little") + chunk
    (tmp_path / "back.vrm").write_bytes(whole)
    return tmp_path / "plain.glb", tmp_path / "back.vrm"


def test_a_figure_that_looks_back_is_turned_for_those_who_know_left_from_right(plain_and_back):
    front, back = (as_front(place) for place in plain_and_back)
    turned = bunraku.read(plain_and_back[1], facing="-z")
    assert np.allclose(back.mesh.vertices, front.mesh.vertices * [-1.0, 1.0, -1.0])
    kept = as_front(plain_and_back[1], facing="+z")
    assert np.allclose(kept.mesh.vertices, front.mesh.vertices)
    for figure in (bunraku.read(plain_and_back[1]), turned):  # turned once, and no more
        again = as_front(figure)
        assert np.allclose(again.mesh.vertices, back.mesh.vertices)
        assert np.allclose(again.world_from_file, turned.world_from_file)
        assert np.allclose(again.document.world_from_mesh, turned.document.world_from_mesh)


def test_poses_that_say_no_heading_have_that_of_a_rest_that_looks_back(
    plain_and_back, cube, tmp_path, monkeypatch
):
    """Files in the rest's own axes and files already turned are read alike, turns included."""
    given = []

    def keep(read, rest, poses, figure, **options):
        given.append((rest.vertices, *poses))
        raise MatchError("enough is known")

    monkeypatch.setattr(posing, "load_reader", lambda network, seed: None)
    monkeypatch.setattr(posing, "animate_from_avatar", keep)
    raw, half = bunraku.read(plain_and_back[1]).mesh, np.array([-1.0, 1.0, -1.0])
    spun = [Mesh(v, raw.faces) for v in (raw.vertices, raw.vertices, raw.vertices * half)]
    round_ = [Mesh(mesh.vertices * half, raw.faces) for mesh in spun]
    for name, meshes in (("raw", spun), ("round", round_)):
        for poses in (meshes, write_objs(tmp_path / name, *meshes)):
            with pytest.raises(MatchError):
                bunraku.pose(cube, plain_and_back[1], poses)
    rest = raw.vertices * half
    wanted = np.stack([rest, rest, rest, raw.vertices])
    assert np.allclose(given[1], wanted, atol=1e-6) and np.allclose(given[3], wanted, atol=1e-6)
    assert np.allclose(given[2], wanted, atol=1e-6)  # arrays are taken as they are
    assert np.allclose(given[0][1:], [mesh.vertices for mesh in spun], atol=1e-6)


def test_another_axis_up_leaves_the_heading_to_custom(plain_and_back):
    plain, back = (as_front(place, up="z").mesh.vertices for place in plain_and_back)
    assert np.allclose(plain, back)
