"""USD out, read back by Pixar's own library."""

import io
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import bunraku
from bunraku import builtin
from bunraku.cli import run
from bunraku.errors import Code
from bunraku.formats import read_figure
from bunraku.formats.packages import ALIGNMENT, pack
from bunraku.formats.usd import RATE, encode_usd, joint_paths
from bunraku.skinning import keep_influences, play_clip
from bunraku.types import Figure, FormatError, Mesh, Skeleton

pxr = pytest.importorskip("pxr", reason="no USD: pip install 'bunraku[usd]'")
usd_modules = [pytest.importorskip(f"pxr.{name}") for name in ("Usd", "UsdGeom", "UsdSkel", "Vt")]
Usd, UsdGeom, UsdSkel, Vt = usd_modules


@pytest.fixture(scope="module")
def human():
    """The built-in human with four joints a vertex, as it is written, and two clips."""
    human = builtin.human()
    skin = replace(human.skin, weights=keep_influences(human.skin.weights, 4))
    clips = tuple(clip for clip in human.clips if clip.name in ("walk", "kick"))
    return replace(human, skin=skin, clips=clips)


def as_figure(mesh):
    return Figure("figure.ply", mesh, np.zeros(len(mesh.vertices), np.int64))


def write(folder, character, figure=None, suffix=".usdc"):
    path = folder / f"written{suffix}"
    path.write_bytes(encode_usd(figure or as_figure(character.mesh), character, suffix=suffix))
    return path


def choose(stage, clip):
    """Let a stage play a clip."""
    variants = stage.GetDefaultPrim().GetVariantSet("clip")
    if variants.GetVariantNames():
        assert variants.SetVariantSelection(clip)


def bind(stage):
    """The library's own view of skeleton and surfaces."""
    root, cache = UsdSkel.Root(stage.GetDefaultPrim()), UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    return cache.GetSkelQuery(binding.GetSkeleton()), list(binding.GetSkinningTargets())


def pose(stage, time):
    """All surfaces as the library skins them at a time in seconds."""
    skeleton, targets = bind(stage)
    transforms = skeleton.ComputeSkinningTransforms(RATE * time)
    moved = []
    for target in targets:
        rest = UsdGeom.PointBased(target.GetPrim()).GetPointsAttr().Get()
        points = Vt.Vec3fArray(rest)
        assert target.ComputeSkinnedPoints(transforms, points, RATE * time)
        moved.append(np.array(points))
    return np.concatenate(moved)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_posed_vertices_are_ours(suffix, human, tmp_path):
    stage = Usd.Stage.Open(str(write(tmp_path, human, suffix=suffix)))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    size = np.linalg.norm(np.ptp(human.mesh.vertices, axis=0))
    for clip in human.clips:
        choose(stage, clip.name)
        frames = np.array([0, len(clip.times) // 3, len(clip.times) - 1])
        ours = play_clip(human, clip, frames)
        assert np.abs(ours - human.mesh.vertices).max() > 0.1 * size
        for frame, expected in zip(frames, ours, strict=True):
            theirs = pose(stage, clip.times[frame])
            assert np.abs(theirs - expected).max() < 1e-4 * size


def test_skeleton_and_weights_come_back(human, tmp_path):
    stage = Usd.Stage.Open(str(write(tmp_path, human)))
    skeleton, (target,) = bind(stage)
    parents = skeleton.GetTopology().GetParentIndices()
    assert list(parents) == human.skeleton.parents.tolist()
    names = skeleton.GetSkeleton().GetJointNamesAttr().Get()
    assert tuple(names) == human.skeleton.names
    bind_poses = np.array(skeleton.GetJointWorldBindTransforms()).swapaxes(1, 2)
    np.testing.assert_allclose(
        bind_poses @ human.skin.inverse_bind, _identities(bind_poses), atol=1e-9
    )
    joints = np.array(target.GetJointIndicesPrimvar().Get()).reshape(-1, 4)
    shares = np.array(target.GetJointWeightsPrimvar().Get()).reshape(-1, 4)
    weights = np.zeros_like(human.skin.weights)
    np.add.at(weights, (np.arange(len(joints))[:, None], joints), shares)
    np.testing.assert_allclose(weights, human.skin.weights, atol=1e-6)


def _identities(like):
    return np.broadcast_to(np.eye(4), like.shape)


def test_joints_that_stretch_are_right_to_half_precision(human, tmp_path):
    clip = human.clips[0]
    stretched = replace(clip, scales=clip.scales * 1.037)
    character = replace(human, clips=(stretched,))
    stage = Usd.Stage.Open(str(write(tmp_path, character)))
    expected = play_clip(character, stretched, np.array([3]))[0]
    size = np.linalg.norm(np.ptp(expected, axis=0))
    assert np.abs(pose(stage, clip.times[3]) - expected).max() < 5e-3 * size


def test_a_single_clip_needs_no_variant(human, tmp_path):
    stage = Usd.Stage.Open(str(write(tmp_path, replace(human, clips=human.clips[:1]))))
    assert not stage.GetDefaultPrim().GetVariantSets().GetNames()
    assert stage.GetEndTimeCode() == pytest.approx(RATE * human.clips[0].times[-1])
    assert bind(stage)[0].GetAnimQuery()


def test_a_cloud_of_points_stays_one(human, tmp_path):
    cloud = Mesh(human.mesh.vertices, np.zeros((0, 3), np.int64))
    stage = Usd.Stage.Open(str(write(tmp_path, replace(human, mesh=cloud))))
    assert stage.GetPrimAtPath("/Figure/Surface0").GetTypeName() == "Points"
    choose(stage, "kick")
    clip = next(clip for clip in human.clips if clip.name == "kick")
    expected = play_clip(human, clip, np.array([9]))[0]
    np.testing.assert_allclose(pose(stage, clip.times[9]), expected, atol=1e-4)


def test_names_are_made_fit_and_different():
    rest = np.tile(np.eye(4), (4, 1, 1))
    skeleton = Skeleton(("1 hip", "arm.L", "arm L", "arm_L"), np.array([-1, 0, 0, 1]), rest)
    paths = joint_paths(pxr, skeleton)
    assert paths == ["__hip", "__hip/arm_L", "__hip/arm_L_2", "__hip/arm_L/arm_L"]


def test_validators_find_nothing(human, tmp_path):
    validation = pytest.importorskip("pxr.UsdValidation", reason="an older USD has no validators")
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    for suffix in (".usda", ".usdc", ".usdz"):
        stage = Usd.Stage.Open(str(write(tmp_path, human, suffix=suffix)))
        found = validation.ValidationContext(validators).Validate(stage)
        assert [fault.GetMessage() for fault in found] == []


def test_the_same_input_gives_the_same_bytes(human):
    for suffix in (".usda", ".usdc", ".usdz"):
        first, second = (encode_usd(as_figure(human.mesh), human, suffix=suffix) for _ in range(2))
        assert first == second


def test_packages_are_aligned_and_plain():
    package = pack({"figure.usdc": b"first" * 9, "picture0.png": b"second"})
    for content in (b"first", b"second"):
        assert package.index(content) % ALIGNMENT == 0


def textured_quad(folder):
    """A square in two materials, one of them with a picture."""
    content = io.BytesIO()
    Image.new("RGB", (2, 2), (200, 30, 20)).save(content, format="png")
    (folder / "red.png").write_bytes(content.getvalue())
    (folder / "quad.mtl").write_text("newmtl a\nmap_Kd red.png\nnewmtl b\nKd 0 0 1\n")
    lines = ["mtllib quad.mtl", "v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0"]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "usemtl a", "f 1/1 2/2 3/3", "usemtl b", "f 1 3 4"]
    (folder / "quad.obj").write_text("\n".join(lines))
    return read_figure(folder / "quad.obj")


def test_colours_pictures_and_uvs_come_along(tmp_path, human):
    figure = textured_quad(tmp_path)
    joints = np.zeros(len(figure.mesh.vertices), np.int64)
    skin = replace(human.skin, weights=np.eye(human.skin.weights.shape[1])[joints])
    character = replace(human, mesh=figure.mesh, skin=skin)
    path = write(tmp_path, character, figure, ".usdz")
    stage = Usd.Stage.Open(str(path))
    surfaces = [prim for prim in stage.Traverse() if prim.GetTypeName() == "Mesh"]
    assert len(surfaces) == 2
    from pxr import UsdShade

    looks = {}
    for prim in surfaces:
        material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].GetPath()
        picture = UsdShade.Shader.Get(stage, material.AppendChild("Picture"))
        plain = UsdShade.Shader.Get(stage, material.AppendChild("Surface"))
        looks[bool(picture)] = (prim, picture or plain)
    prim, picture = looks[True]
    named = picture.GetInput("file").Get()
    assert named.resolvedPath, "the picture is in the package"
    st = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st").Get()
    points = UsdGeom.Mesh(prim).GetPointsAttr().Get()
    np.testing.assert_allclose(np.array(st), np.array(points)[:, :2], atol=1e-6)
    assert tuple(looks[False][1].GetInput("diffuseColor").Get()) == pytest.approx((0, 0, 1))


def test_a_missing_extra_is_one_line(monkeypatch, human):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(FormatError, match=r"pip install 'bunraku\[usd\]'") as caught:
        encode_usd(as_figure(human.mesh), human, suffix=".usda")
    assert caught.value.code is Code.EXTRA_MISSING


def test_the_command_writes_usd(tmp_path, creature):
    bunraku.write(tmp_path / "performer.glb", bunraku.animate(creature.mesh, creature))
    bunraku.write(tmp_path / "figure.ply", Mesh(creature.mesh.vertices, creature.mesh.faces))
    out = tmp_path / "moving.usdz"
    figure, performer = tmp_path / "figure.ply", tmp_path / "performer.glb"
    assert run(["animate", str(figure), "--with", str(performer), "-o", str(out)]) == 0
    stage = Usd.Stage.Open(str(out))
    glb = tmp_path / "moving.glb"
    assert run(["animate", str(figure), "--with", str(performer), "-o", str(glb)]) == 0
    moved = bunraku.read_performer(glb)
    clip = moved.clips[0]
    expected = play_clip(moved, clip, np.array([5]))[0]
    assert np.abs(pose(stage, clip.times[5]) - expected).max() < 1e-4 * np.ptp(expected)
