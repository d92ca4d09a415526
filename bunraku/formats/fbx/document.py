"""An FBX file as the glTF that it becomes: metres, Y up; one reader for all that follows."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from bunraku import limits
from bunraku.errors import NOTE, Code, announce
from bunraku.formats.fbx.clips import Motion, read_motions
from bunraku.formats.fbx.geometry import (
    Binding,
    Surface,
    check_bindings,
    read_binding,
    read_surface,
)
from bunraku.formats.fbx.placement import Parts, node_from_geometry, parent_of, place_still
from bunraku.formats.fbx.records import read_records
from bunraku.formats.fbx.scene import Scene, Thing, build_scene, metres_per_unit, world_from_file
from bunraku.formats.files import Location
from bunraku.formats.gltf.draft import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Draft
from bunraku.rotations import matrices_to_quaternions
from bunraku.types import FormatError

TEXT_MARK = b"; FBX"


def convert_to_glb(path: Location, content: bytes) -> bytes:
    """Write an FBX file anew as a GLB: nodes, surfaces, skins, clips and plain colours.

    Pivots and pre-rotations are multiplied out, curves are sampled at their keys, lengths are in
    metres and Y is up. Textures, blend shapes, cameras and lights are left out.

    Raises:
        FormatError: if the file is damaged, text, or older than FBX 7.
    """
    if content.startswith(TEXT_MARK):
        message = "is FBX written as text; save it as binary FBX, or as .glb"
        raise FormatError(path, "", message, code=Code.FBX_VERSION)
    scene = build_scene(path, read_records(path, content))
    return _Writer(scene).write()


class _Writer:
    """A glTF document while it grows out of a scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.turn, self.unit = world_from_file(scene), metres_per_unit(scene)
        self.models = list(scene.of("Model"))
        self.place = {model.number: place for place, model in enumerate(self.models)}
        self.parents = {model.number: parent_of(scene, model) for model in self.models}
        self.draft = Draft({"asset": {"version": "2.0", "generator": "bunraku"}}, bytearray())
        self.materials: dict[int, int] = {}
        self.read: dict[int, tuple[Surface | None, Binding | None]] = {}  # geometries, by number
        self.skins: dict[int, int] = {}  # by the number of the geometry, however many show it
        self.meshes: dict[int, dict[tuple[bytes, tuple[int, ...]], int]] = {}  # by number and look
        self.vertices = self.repeated = 0

    def write(self) -> bytes:
        """Add everything, and give the file."""
        self._add_nodes()
        for model in self.models:
            above = self.parents[model.number]
            if above is not None:
                children = self.draft.json["nodes"][self.place[above]].setdefault("children", [])
                children.append(self.place[model.number])
        roots = [self.place[model.number] for model in self.models if self._is_root(model.number)]
        self.draft.json["scene"] = self.draft.append("scenes", {"nodes": roots} if roots else {})
        check_bindings(self.scene)
        shown = [(model, each) for model in self.models for each in self._geometries(model)]
        if len(shown) > limits.PIECES:
            message = f"{len(shown)} meshes are shown, at most {limits.PIECES} are read; join them"
            raise FormatError(self.scene.path, "", message, code=Code.LIMIT_TOTAL)
        for model, geometry in shown:
            self._show(model, geometry)
        for motion in read_motions(self.scene):
            self._add_clip(motion)
        self._announce_rest()
        return self.draft.encode()

    def _is_root(self, number: int) -> bool:
        return self.parents[number] is None

    def _metric(self, number: int, parts: Parts) -> Parts:
        """Bring translation, rotation and scale of a node to metres; of a root, to Y up."""
        moved, rotations, scales = parts
        with np.errstate(all="ignore"):
            moved = moved * self.unit
            if self._is_root(number):
                moved, rotations = moved @ self.turn.T, self.turn @ rotations
        if not all(np.isfinite(part).all() for part in (moved, rotations, scales)):
            message = "is placed by numbers that are not finite or too large; apply transforms"
            where = self.scene.things[number].where
            raise FormatError(self.scene.path, where, message, code=Code.NODE_TRANSFORM)
        return moved, rotations, scales

    def _geometries(self, model: Thing) -> Iterator[Thing]:
        return self.scene.children(model, "Geometry", "Mesh")

    def _add_nodes(self) -> None:
        """Make a node for each model."""
        places = [self._metric(model.number, place_still(model)) for model in self.models]
        turns = [rotations for _, rotations, _ in places] or [np.zeros((0, 3, 3))]
        quaternions = matrices_to_quaternions(np.concatenate(turns)).tolist()
        for model, (moved, _, scales), rotation in zip(
            self.models, places, quaternions, strict=True
        ):
            node = {
                "name": model.name or f"node_{self.place[model.number]}",
                "translation": moved[0].tolist(),
                "rotation": rotation,
                "scale": scales[0].tolist(),
            }
            self.draft.append("nodes", node)

    def _show(self, model: Thing, geometry: Thing) -> None:
        """Show a geometry by the node of a model; a second one by a node below."""
        if geometry.number not in self.read:
            surface = read_surface(self.scene, geometry)
            binding = None if surface is None else read_binding(self.scene, geometry, surface)
            self.read[geometry.number] = surface, binding
        surface, binding = self.read[geometry.number]
        if surface is None:
            return
        mesh = self._add_mesh(model, geometry, surface, binding)
        node = self.draft.json["nodes"][self.place[model.number]]
        if "mesh" in node:
            below = self.draft.append("nodes", {"name": f"{model.name}_{mesh}"})
            node.setdefault("children", []).append(below)
            node = self.draft.json["nodes"][below]
        node["mesh"] = mesh
        if binding:
            if geometry.number not in self.skins:
                self.skins[geometry.number] = self._add_skin(binding)
            node["skin"] = self.skins[geometry.number]

    def _add_mesh(
        self, model: Thing, geometry: Thing, surface: Surface, binding: Binding | None
    ) -> int:
        """Add a geometry as a model shows it, unless another one shows it so."""
        looks = list(self.scene.children(model, "Material"))
        placed = node_from_geometry(self.scene, model)
        known = self.meshes.setdefault(geometry.number, {})
        key = placed.tobytes(), tuple(look.number for look in looks)
        if key in known:
            return known[key]
        self._count(len(surface.point_of), is_again=bool(known))
        points = (surface.points @ placed[:3, :3].T + placed[:3, 3]) * self.unit
        normals = None
        if surface.normals is not None and abs(np.linalg.det(placed[:3, :3])) > 1e-12:
            normals = surface.normals @ np.linalg.inv(placed[:3, :3])
        primitives = self._primitives(looks, surface, (points, normals), binding)
        mesh = {"name": model.name, "primitives": primitives}
        known[key] = self.draft.append("meshes", mesh)
        return known[key]

    def _count(self, vertices: int, *, is_again: bool) -> None:
        """Refuse more vertices than are read, before they are written."""
        self.vertices += vertices
        self.repeated += vertices * is_again
        message, code = "", Code.LIMIT_TOTAL
        if self.vertices > limits.VERTICES:
            message = f"more than {limits.VERTICES} vertices; decimate it first"
            code = Code.LIMIT_VERTICES
        elif self.repeated > limits.REPEATED:
            message = f"more than {limits.REPEATED} vertices are shown again; leave out the copies"
        if message:
            raise FormatError(self.scene.path, "", message, code=code)

    def _primitives(
        self,
        looks: list[Thing],
        surface: Surface,
        moved: tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "vertices 3"] | None],
        binding: Binding | None,
    ) -> list[dict[str, Any]]:
        """Add a primitive for each material; vertices and faces come sorted by material."""
        points, normals = moved
        parts = np.unique(surface.part_of)
        borders = np.searchsorted(surface.part_of, [*parts, parts[-1] + 1])
        face_borders = np.searchsorted(
            surface.part_of[surface.faces[:, 0]], [*parts, parts[-1] + 1]
        )
        primitives = []
        for number, part in enumerate(parts.tolist()):
            start, end = borders[number : number + 2]
            rows = surface.point_of[start:end]
            attributes = {"POSITION": self._add_vectors(points[rows], "VEC3", bounded=True)}
            if normals is not None and (unit := _unit(normals[start:end])) is not None:
                attributes["NORMAL"] = self._add_vectors(unit, "VEC3")
            if surface.uvs is not None:
                flipped = surface.uvs[start:end] * [1, -1] + [0, 1]
                attributes["TEXCOORD_0"] = self._add_vectors(flipped, "VEC2")
            if binding:
                attributes |= self._add_weights(binding, rows)
            inside = surface.faces[slice(*face_borders[number : number + 2])]
            corners = (inside - start).reshape(-1, 1)
            indices = self.draft.add_array(
                corners.astype("<u4"), "SCALAR", target=ELEMENT_ARRAY_BUFFER
            )
            primitive: dict[str, Any] = {"attributes": attributes, "indices": indices}
            if part < len(looks):
                primitive["material"] = self._material(looks[part])
            primitives.append(primitive)
        return primitives

    def _add_vectors(
        self, rows: Float[np.ndarray, "rows width"], kind: str, *, bounded: bool = False
    ) -> int:
        """Add an array of float32."""
        single = _single(rows)
        accessor = self.draft.add_array(single, kind, target=ARRAY_BUFFER)
        if bounded:
            self.draft.add_bounds(accessor, single)
        return accessor

    def _add_weights(self, binding: Binding, rows: np.ndarray) -> dict[str, int]:
        """Add as many sets of four influences as any vertex needs."""
        weights = binding.weights[rows]
        needed = 1 if not (weights[:, 4:] != 0).any() else 2
        attributes = {}
        for number in range(needed):
            columns = slice(4 * number, 4 * number + 4)
            joints = binding.joints[rows, columns].astype("<u2")
            share = _single(weights[:, columns])
            attributes[f"JOINTS_{number}"] = self.draft.add_array(
                joints, "VEC4", target=ARRAY_BUFFER
            )
            attributes[f"WEIGHTS_{number}"] = self.draft.add_array(
                share, "VEC4", target=ARRAY_BUFFER
            )
        return attributes

    def _add_skin(self, binding: Binding) -> int:
        """Add the bones of a geometry, and where they were when it was bound."""
        matrices = np.stack(binding.bone_from_node)
        matrices[:, :3, 3] *= self.unit
        columns = _single(matrices.transpose(0, 2, 1).reshape(-1, 16))
        joints = [self.place[bone] for bone in binding.bones]
        accessor = self.draft.add_array(columns, "MAT4")
        return self.draft.append("skins", {"joints": joints, "inverseBindMatrices": accessor})

    def _material(self, thing: Thing) -> int:
        """Add a material's colour, once; FBX has it linear, as glTF wants it."""
        if thing.number not in self.materials:
            colour = np.clip(np.nan_to_num(thing.vector("DiffuseColor", 0.8)), 0.0, 1.0)
            opacity = float(np.clip(np.nan_to_num(thing.number_of("Opacity", 1.0)), 0.0, 1.0))
            base = [*colour.tolist(), opacity]
            surface = {"baseColorFactor": base, "metallicFactor": 0.0, "roughnessFactor": 0.9}
            look: dict[str, Any] = {"name": thing.name, "pbrMetallicRoughness": surface}
            if opacity < 1:
                look["alphaMode"] = "BLEND"
            self.materials[thing.number] = self.draft.append("materials", look)
        return self.materials[thing.number]

    def _add_clip(self, motion: Motion) -> None:
        """Add a clip: three channels for each node that it moves."""
        times = motion.times.astype("<f4")
        frames = np.flatnonzero(np.diff(times, prepend=-1.0) > 0)
        source = self.draft.add_array(times[frames, None], "SCALAR")
        self.draft.add_bounds(source, times[frames])
        clip: dict[str, Any] = {"name": motion.name, "channels": [], "samplers": []}
        for number, parts in motion.moved.items():
            moved, rotations, scales = self._metric(number, parts)
            tracks = (
                ("translation", moved, "VEC3"),
                ("rotation", matrices_to_quaternions(rotations), "VEC4"),
                ("scale", scales, "VEC3"),
            )
            for path, values, kind in tracks:
                output = self.draft.add_array(_single(values[frames]), kind)
                target = {"node": self.place[number], "path": path}
                clip["channels"].append({"sampler": len(clip["samplers"]), "target": target})
                clip["samplers"].append({"input": source, "output": output})
        self.draft.append("animations", clip)

    def _announce_rest(self) -> None:
        """Tell what is in the file and not read."""
        kinds = {
            "textures": list(self.scene.of("Texture")),
            "blend shapes": list(self.scene.of("Deformer", "BlendShape")),
        }
        for what, found in kinds.items():
            if found:
                message = f"{len(found)} {what} are left out"
                announce(self.scene.path, message, code=Code.FBX_LEFT_OUT, level=NOTE)


def _single(values: Float[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Give numbers as glTF stores them; those that are too large are as large as may be."""
    return np.clip(values, -limits.COORDINATE, limits.COORDINATE).astype("<f4")


def _unit(normals: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 3"] | None:
    """Scale normals to length 1; nothing if one has no direction."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / lengths if (np.isfinite(lengths) & (lengths > 1e-12)).all() else None
