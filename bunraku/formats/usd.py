"""Write a character as USD: UsdSkel skeleton, skin and clips, in metres, Y up.

The extra `usd` brings Pixar's library, which makes the files.

Reference:
    Pixar 2018, "UsdSkel: Schemas In-Depth".
"""

import tempfile
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from bunraku.errors import Code
from bunraku.formats.gltf.figure import FigureDocument
from bunraku.formats.gltf.looks import Look, Paint, read_looks
from bunraku.formats.packages import pack
from bunraku.skinning import keep_influences
from bunraku.types import NO_PARENT, Character, Clip, Figure, FormatError, Mesh, Skeleton

USD_SUFFIXES = (".usda", ".usdc", ".usdz")
RATE = 30.0  # time codes a second
INFLUENCES = 4  # joints of a vertex, as in the GLB
ROOT, SKELETON = "/Figure", "/Figure/Skeleton"
PICTURES = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg"}


def import_usd(path: object) -> Any:
    """Give Pixar's library.

    Raises:
        FormatError: about the file that wants it, if the extra is missing.
    """
    try:
        for part in ("Gf", "Sdf", "Tf", "Usd", "UsdGeom", "UsdShade", "UsdSkel", "Vt"):
            import_module(f"pxr.{part}")
        return import_module("pxr")
    except ImportError as error:
        message = "USD needs the extra: pip install 'bunraku[usd]'"
        raise FormatError(path, "", message, code=Code.EXTRA_MISSING) from error


def encode_usd(figure: Figure, character: Character, *, suffix: str) -> bytes:
    """Write a figure with its skeleton, skin and clips as a USD file.

    Each material of the figure is a mesh of its own in its base colour; pictures come along in
    packages (.usdz) alone, for the other kinds hold no files. A stage has one time line: the
    first clip plays, and the variant set `clip` chooses another. The format stores scales of
    joints in half precision.

    Args:
        figure: as it was read.
        character: its mesh has the figure's vertices, in order.
        suffix: one of USD_SUFFIXES: text, binary, or a package.

    Returns:
        the bytes of the file, the same for the same input.

    Raises:
        FormatError: if the extra is missing.
    """
    pxr = import_usd(figure.path)
    stage = pxr.Usd.Stage.CreateInMemory()
    _begin(pxr, stage, character.clips)
    _add_skeleton(pxr, stage, character)
    _add_clips(pxr, stage, character)
    files: dict[str, bytes] = {}
    materials: dict[Paint, Any] = {}
    for number, look in enumerate(_list_looks(figure, character.mesh)):
        surface = _add_surface(pxr, stage, f"{ROOT}/Surface{number}", character, look=look)
        if look.paint not in materials:
            kind = next((k for m, k in PICTURES.items() if look.paint.picture.startswith(m)), "")
            picture = f"picture{len(materials)}{kind}" if kind and suffix == ".usdz" else ""
            if picture:
                files[picture] = look.paint.picture
            place = f"{ROOT}/Materials/Material{len(materials)}"
            materials[look.paint] = _add_material(pxr, stage, place, look.paint, picture=picture)
        binding = pxr.UsdShade.MaterialBindingAPI.Apply(surface.GetPrim())
        binding.Bind(materials[look.paint])
    if suffix == ".usdz":
        return pack({"figure.usdc": _export(stage, ".usdc"), **files})
    return _export(stage, suffix)


def _list_looks(figure: Figure, mesh: Mesh) -> list[Look]:
    """List the parts of a figure that are shown; a cloud of points is one."""
    found = figure.document
    if not len(mesh.faces) or not isinstance(found, FigureDocument):
        return [Look(mesh.faces, 0)]
    return [look for look in read_looks(found) if len(look.faces)]


def _begin(pxr: Any, stage: Any, clips: tuple[Clip, ...]) -> None:
    """Say what the numbers of a stage mean, and add its root."""
    pxr.UsdGeom.SetStageUpAxis(stage, pxr.UsdGeom.Tokens.y)
    pxr.UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(RATE)
    stage.SetFramesPerSecond(RATE)
    for clip in clips[:1]:
        stage.SetStartTimeCode(RATE * float(clip.times[0]))
        stage.SetEndTimeCode(RATE * float(clip.times[-1]))
    stage.SetDefaultPrim(pxr.UsdSkel.Root.Define(stage, ROOT).GetPrim())


def _add_skeleton(pxr: Any, stage: Any, character: Character) -> None:
    """Add the joints: where they were when the skin was made, and their rest pose."""
    skeleton = pxr.UsdSkel.Skeleton.Define(stage, SKELETON)
    skeleton.CreateJointsAttr(joint_paths(pxr, character.skeleton))
    skeleton.CreateJointNamesAttr(list(character.skeleton.names))
    world_from_joint = np.linalg.inv(character.skin.inverse_bind)
    skeleton.CreateBindTransformsAttr(_as_matrices(pxr, world_from_joint))
    skeleton.CreateRestTransformsAttr(_as_matrices(pxr, character.skeleton.rest))


def joint_paths(pxr: Any, skeleton: Skeleton) -> list[str]:
    """Name each joint by the way down to it, in words that the format allows, all different."""
    paths = list[str]()
    for name, parent in zip(skeleton.names, skeleton.parents.tolist(), strict=True):
        above = "" if parent == NO_PARENT else f"{paths[parent]}/"
        paths.append(_choose_name(pxr, above, name, paths))
    return paths


def _choose_name(pxr: Any, above: str, name: str, taken: Iterable[str]) -> str:
    """Make a name that the format allows, and that nothing in the same place has."""
    base = f"{above}{pxr.Tf.MakeValidIdentifier(name)}"
    free, number = base, 1
    while free in taken:
        number += 1
        free = f"{base}_{number}"
    return free


def _add_clips(pxr: Any, stage: Any, character: Character) -> None:
    """Add the clips below the skeleton; of several, a variant each plays one, first the first."""
    skeleton = stage.GetPrimAtPath(SKELETON)
    binding = pxr.UsdSkel.BindingAPI.Apply(skeleton)
    joints = pxr.UsdSkel.Skeleton(skeleton).GetJointsAttr().Get()
    places = dict[str, str]()
    for clip in character.clips:
        name = _choose_name(pxr, "", clip.name, places)
        places[name] = f"{SKELETON}/{name}"
        _add_clip(pxr, stage, places[name], clip, joints=joints)
    if len(places) == 1:
        binding.CreateAnimationSourceRel().SetTargets(list(places.values()))
    elif places:
        variants = stage.GetPrimAtPath(ROOT).GetVariantSets().AddVariantSet("clip")
        for name, place in places.items():
            variants.AddVariant(name)
            variants.SetVariantSelection(name)
            with variants.GetVariantEditContext():
                binding.CreateAnimationSourceRel().SetTargets([place])
        variants.SetVariantSelection(next(iter(places)))


def _add_clip(pxr: Any, stage: Any, place: str, clip: Clip, *, joints: Any) -> None:
    """Add a clip: translations, rotations and scales of all joints at each of its times."""
    animation = pxr.UsdSkel.Animation.Define(stage, place)
    animation.CreateJointsAttr(joints)
    translations = animation.CreateTranslationsAttr()
    rotations = animation.CreateRotationsAttr()
    scales = animation.CreateScalesAttr()
    is_scaled = np.abs(clip.scales - clip.scales[0]).max() > 0
    for frame, time in enumerate((RATE * clip.times).tolist()):
        places = np.ascontiguousarray(clip.translations[frame], np.float32)
        translations.Set(pxr.Vt.Vec3fArray.FromNumpy(places), time)
        turns = np.ascontiguousarray(clip.rotations[frame], np.float32)
        rotations.Set(pxr.Vt.QuatfArray.FromNumpy(turns), time)
        if is_scaled or frame == 0:
            sizes = np.ascontiguousarray(clip.scales[frame], np.float16)
            scales.Set(pxr.Vt.Vec3hArray.FromNumpy(sizes), time)


def _add_surface(pxr: Any, stage: Any, place: str, character: Character, *, look: Look) -> Any:
    """Add the triangles of one look with their own vertices, bound to the skeleton."""
    used, corners = np.unique(look.faces, return_inverse=True)
    if len(look.faces):
        surface = pxr.UsdGeom.Mesh.Define(stage, place)
        counts = np.full(len(look.faces), 3, np.int32)
        surface.CreateFaceVertexCountsAttr(pxr.Vt.IntArray.FromNumpy(counts))
        indices = corners.reshape(-1).astype(np.int32)
        surface.CreateFaceVertexIndicesAttr(pxr.Vt.IntArray.FromNumpy(indices))
        surface.CreateSubdivisionSchemeAttr(pxr.UsdGeom.Tokens.none)
        surface.CreateDoubleSidedAttr(True)
    else:
        used = np.arange(len(character.mesh.vertices))
        surface = pxr.UsdGeom.Points.Define(stage, place)
    vertices = character.mesh.vertices[used].astype(np.float32)
    surface.CreatePointsAttr(pxr.Vt.Vec3fArray.FromNumpy(vertices))
    box = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    surface.CreateExtentAttr(pxr.Vt.Vec3fArray.FromNumpy(box))
    if look.normals is not None:
        normals = look.normals[used - look.first].astype(np.float32)
        surface.CreateNormalsAttr(pxr.Vt.Vec3fArray.FromNumpy(normals))
        surface.SetNormalsInterpolation(pxr.UsdGeom.Tokens.vertex)
    if look.uvs is not None:
        kind = pxr.Sdf.ValueTypeNames.TexCoord2fArray
        uvs = look.uvs[used - look.first].astype(np.float32)
        primvars = pxr.UsdGeom.PrimvarsAPI(surface)
        primvar = primvars.CreatePrimvar("st", kind, pxr.UsdGeom.Tokens.vertex)
        primvar.Set(pxr.Vt.Vec2fArray.FromNumpy(uvs))
    _bind(pxr, stage, surface, character.skin.weights[used])
    return surface


def _bind(
    pxr: Any, stage: Any, surface: Any, weights: Float[np.ndarray, "vertices joints"]
) -> None:
    """Give a surface its joints and weights."""
    kept = keep_influences(weights, INFLUENCES)
    count = min(INFLUENCES, weights.shape[1])
    joints = np.argsort(-kept, axis=1, kind="stable")[:, :count]
    shares = np.take_along_axis(kept, joints, axis=1)
    joints = np.where(shares > 0, joints, 0)
    binding = pxr.UsdSkel.BindingAPI.Apply(surface.GetPrim())
    binding.CreateSkeletonRel().SetTargets([SKELETON])
    binding.CreateGeomBindTransformAttr(pxr.Gf.Matrix4d(1.0))
    numbers = pxr.Vt.IntArray.FromNumpy(joints.reshape(-1).astype(np.int32))
    binding.CreateJointIndicesPrimvar(False, count).Set(numbers)
    parts = pxr.Vt.FloatArray.FromNumpy(shares.reshape(-1).astype(np.float32))
    binding.CreateJointWeightsPrimvar(False, count).Set(parts)


def _add_material(pxr: Any, stage: Any, place: str, paint: Paint, *, picture: str) -> Any:
    """Add a material of one colour, or with the picture of that name."""
    kinds = pxr.Sdf.ValueTypeNames
    material = pxr.UsdShade.Material.Define(stage, place)
    surface = pxr.UsdShade.Shader.Define(stage, f"{place}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", kinds.Float).Set(0.8)
    surface.CreateInput("opacity", kinds.Float).Set(paint.colour[3])
    colour = surface.CreateInput("diffuseColor", kinds.Color3f)
    if picture:
        reader = pxr.UsdShade.Shader.Define(stage, f"{place}/Places")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", kinds.String).Set("st")
        texture = pxr.UsdShade.Shader.Define(stage, f"{place}/Picture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", kinds.Asset).Set(pxr.Sdf.AssetPath(picture))
        texture.CreateInput("sourceColorSpace", kinds.Token).Set("sRGB")
        texture.CreateInput("scale", kinds.Float4).Set(pxr.Gf.Vec4f(*paint.colour))
        for side in ("wrapS", "wrapT"):
            texture.CreateInput(side, kinds.Token).Set("repeat")
        found = reader.CreateOutput("result", kinds.Float2)
        texture.CreateInput("st", kinds.Float2).ConnectToSource(found)
        colour.ConnectToSource(texture.CreateOutput("rgb", kinds.Float3))
    else:
        colour.Set(pxr.Gf.Vec3f(*paint.colour[:3]))
    output = surface.CreateOutput("surface", kinds.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    return material


def _as_matrices(pxr: Any, transforms: Float[np.ndarray, "joints 4 4"]) -> Any:
    """Turn matrices for columns into the format's, which are for rows."""
    return pxr.Vt.Matrix4dArray.FromNumpy(np.ascontiguousarray(transforms.swapaxes(-1, -2)))


def _export(stage: Any, suffix: str) -> bytes:
    """Give the bytes of a stage as text or in binary."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"figure{suffix}"
        stage.GetRootLayer().Export(str(path))
        return path.read_bytes()
