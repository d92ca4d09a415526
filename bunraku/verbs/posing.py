"""Avatars as performances: an avatar at rest and posed lets a figure take its poses."""

import logging
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bunraku import builtin
from bunraku.errors import NOTE, Code, announce, collecting_doubts
from bunraku.evaluate.pose import Paper
from bunraku.evaluate.report import report_avatar_transfer
from bunraku.formats import is_depth_folder, looks_back
from bunraku.formats.files import Location, read_bytes
from bunraku.formats.sniffing import sniff
from bunraku.graphs import mesh_edges
from bunraku.neural.avatars import CLIP
from bunraku.neural.parts import Reader
from bunraku.routes.from_avatar import AvatarTransfer, animate_from_avatar
from bunraku.skinning import play_clip
from bunraku.types import Character, Figure, FormatError, Mesh
from bunraku.verbs.failing import about
from bunraku.verbs.figures import as_front

logger = logging.getLogger(__name__)
MESHES = (".glb", ".gltf", ".vrm", ".fbx", ".obj", ".ply", ".stl", ".off")
REST = "rest"  # name of the file of an avatar at rest, in a folder of its own
RATE = 24.0  # poses a second
TORN = (
    3.0  # times its length at rest; edges of a pose in another vertex order are longer or shorter
)


@dataclass(frozen=True, eq=False)
class Posed:
    """A figure in an avatar's poses, and how it came about; `bunraku.write` puts it into files."""

    figure: Figure  # as it was found
    avatar: str  # the avatar's file at rest, as given
    transfer: AvatarTransfer  # every stage of the route
    total_seconds: float  # reading included

    @property
    def character(self) -> Character:
        """The figure as found, with the avatar's parts as its joints; its clip are the poses."""
        return self.transfer.character

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the route found doubtful, in plain words."""
        return self.transfer.warnings

    @property
    def confidence(self) -> float:
        """How far to trust the result, 0 to 1."""
        return self.transfer.confidence

    @cached_property
    def surfaces(self) -> tuple[Mesh, ...]:
        """The figure in every pose: the surface alone, in metres, Y up."""
        frames = play_clip(self.character, self.character.clips[0])
        return tuple(Mesh(vertices, self.character.mesh.faces) for vertices in frames)

    @cached_property
    def report(self) -> dict[str, object]:
        """How far to trust the result, in numbers: what `--report` writes."""
        return report_avatar_transfer(
            self.figure.path, self.avatar, self.transfer, total_seconds=self.total_seconds
        )


def pose(
    figure: Location | Figure | Mesh,
    rest: Location | Mesh,
    posed: Sequence[Location | Mesh],
    *,
    rate: float = RATE,
    network: Location | None = None,
    seed: int = 0,
    up: str | None = None,
    facing: str | None = None,
    force: bool = False,
) -> Posed:
    """Put a figure into the poses of an avatar: a body at rest and posed, without any rig.

    Args:
        figure: what is to move, at rest: a file, or what `read` gave, or a Mesh.
        rest: the avatar at rest, a person or a quadruped, in about the figure's rest pose.
        posed: the same avatar posed, vertex by vertex; several poses make a clip. Files of a format
            that does not say which axis is up have the one that is up in the file at rest.
        rate: poses a second, in that clip.
        network: a file that `bunraku train shape` wrote; the built-in network without.
        seed: of the samples that the network reads.
        up: the axis of the figure's file that is up, y or z, if its format does not say.
        facing: the axis along which the figure looks, such as -y.
        force: give the result even if the figure is hardly understood.

    Raises:
        FormatError: if a file cannot be read, a pose has other vertices than the avatar at rest,
            or PyTorch is not installed.
        MatchError: if avatar or figure cannot be understood well enough.
    """
    began = time.perf_counter()
    found = as_front(figure, up=up, facing=facing)
    if not posed:
        raise FormatError("--posed", "", "no pose is given; name a file", code=Code.OPTION)
    if not 0 < rate < 1000:
        raise FormatError("--rate", "", f"is {rate}; wanted 1 to 1000", code=Code.OPTION)
    resting = _read_resting(rest)
    poses = _head_as_rest(resting, posed, np.stack([_read_pose(resting, one) for one in posed]))
    name, avatar = resting.path, resting.mesh
    with about(found.path), collecting_doubts() as doubts:
        transfer = animate_from_avatar(
            load_reader(network, seed), avatar, poses, found.mesh, rate=rate, force=force
        )
    transfer = replace(transfer, warnings=(*transfer.warnings, *doubts))
    for message in transfer.warnings:
        announce(found.path, message, code=Code.MATCH_DOUBTFUL)
    return Posed(found, name, transfer, time.perf_counter() - began)


def is_avatar_folder(folder: Location) -> bool:
    """Tell whether a folder holds an avatar: a mesh called `rest`, and no depth video."""
    place = Path(folder)
    return place.is_dir() and not is_depth_folder(place) and bool(_meshes(place)[0])


def avatar_files(folder: Location) -> tuple[Path, list[Path]]:
    """Name an avatar's files: at rest, and its poses in the order of their names.

    Numbers in names count as numbers: pose-2 comes before pose-10.

    Raises:
        FormatError: if there are no poses, or more than one file is called `rest`.
    """
    place = Path(folder)
    rest, posed = _meshes(place)
    if len(rest) != 1:
        message = f"holds {len(rest)} meshes called {REST}; call the avatar at rest so, and only it"
        raise FormatError(place, "", message, code=Code.AVATAR_POSED)
    if not posed:
        message = f"holds {rest[0].name} and no poses; put the posed meshes beside it"
        raise FormatError(place, "", message, code=Code.AVATAR_POSED)
    return rest[0], posed


def check_avatar(
    folder: Location, clips: Sequence[str] | None, landmarks: object, *, contacts: bool
) -> None:
    """Refuse clips that poses do not have, and landmarks; say that no feet are planted anyway.

    Raises:
        FormatError: about the folder or the landmarks.
    """
    for name in clips or ():
        if name != CLIP:
            message = f"has no clip {name!r}; an avatar's poses are one clip, {CLIP!r}"
            raise FormatError(folder, "", message, code=Code.CLIP_MISSING)
    if landmarks is not None:
        message = "name joints, which an avatar without a rig does not have; leave them out"
        where = landmarks if isinstance(landmarks, str | Path) else "landmarks"
        raise FormatError(where, "", message, code=Code.LANDMARKS)
    if not contacts:
        message = "an avatar's poses plant no feet, with contacts or without"
        announce(folder, message, code=Code.OPTION, level=NOTE)


def _meshes(place: Path) -> tuple[list[Path], list[Path]]:
    """List a folder's mesh files: those called rest, and the others."""
    files = [path for path in place.iterdir() if path.suffix.lower() in MESHES]

    def by_number(path: Path) -> list[tuple[bool, int, str]]:
        words = re.split(r"(\d+)", path.name.lower())
        return [(w.isdecimal(), int(w) if w.isdecimal() else 0, w) for w in words]

    rest = [path for path in files if path.stem.lower() == REST]
    return rest, sorted((p for p in files if p not in rest), key=by_number)


def _read_resting(place: Location | Mesh) -> Figure:
    """Read an avatar at rest, unless it is one."""
    if isinstance(place, Mesh):
        return Figure("avatar", place, np.zeros(len(place.vertices), np.int64))
    with about(str(place)):
        return replace(as_front(place), path=str(place))


def _read_as_rest(resting: Figure, place: Location) -> Mesh:
    """Read a pose with the axis up that is up at rest, for a pose itself may lie or stand on hands.

    Formats that say which axis is up are believed.
    """
    up = "z" if resting.world_from_file[1, 2] > 0.5 else "y"
    with about(str(place)):
        says = sniff(place, read_bytes(place)) in ("gltf", "fbx")
        return as_front(place, up=None if says else up).mesh


def _head_as_rest(
    resting: Figure, posed: Sequence[Location | Mesh], poses: Float[np.ndarray, "poses v 3"]
) -> Float[np.ndarray, "poses v 3"]:
    """Turn poses round if the rest was turned (VRM 0) and they are nearer to it then.

    Asked of all files whose format says no heading together, for one tool made them, and a body in
    a clip may turn its back.
    """
    if not looks_back(resting):
        return poses
    mute = [not isinstance(one, Mesh) and Path(one).suffix.lower() != ".vrm" for one in posed]
    rest, found = (v - v.mean(axis=-2, keepdims=True) for v in (resting.mesh.vertices, poses[mute]))
    half = np.array([-1.0, 1.0, -1.0])
    if np.square(found * half - rest).sum() >= np.square(found - rest).sum():
        return poses
    logger.info("%s: poses look along -Z, as the avatar at rest does", resting.path)
    return np.where(np.array(mute)[:, None, None], poses * half, poses)


def _read_pose(resting: Figure, place: Location | Mesh) -> Float[np.ndarray, "v 3"]:
    """Read one pose, and make sure that its vertices are the avatar's."""
    avatar, avatar_name = resting.mesh, resting.path
    name, mesh = "avatar", place
    if not isinstance(mesh, Mesh):
        name, mesh = str(place), _read_as_rest(resting, mesh)
    code = Code.AVATAR_POSED
    if len(mesh.vertices) != len(avatar.vertices):
        raise FormatError(
            name,
            "",
            f"has {len(mesh.vertices)} vertices, but the avatar at rest ({Path(avatar_name).name}) "
            f"has {len(avatar.vertices)}; export both from one mesh, in the same vertex order",
            code=code,
        )
    if not len(avatar.faces):
        return mesh.vertices
    ends = mesh_edges(avatar.faces)
    before, after = (
        np.linalg.norm(v[ends[:, 0]] - v[ends[:, 1]], axis=1)
        for v in (avatar.vertices, mesh.vertices)
    )
    real = before > 1e-9 * max(float(before.max(initial=0.0)), 1e-30)
    ratio = after[real] / before[real]
    typical = float(np.median(ratio)) if len(ratio) else 1.0
    scale = float(np.ptp(mesh.vertices, axis=0).max() / np.ptp(avatar.vertices, axis=0).max())
    torn = (ratio > TORN * scale) | (ratio < scale / TORN)
    if len(ratio) and torn.mean() > 0.3:
        message = (
            f"tears {torn.mean():.0%} of the edges of the avatar at rest: its vertices are in "
            "another order, or of another mesh; export both from one mesh"
        )
        raise FormatError(name, "", message, code=code)
    if not 1 / TORN < typical < TORN:
        message = (
            f"is {typical:.3g} times as large as the avatar at rest; export both in the same unit"
        )
        raise FormatError(name, "", message, code=code)
    return mesh.vertices


def load_reader(network: Location | None, seed: int, *, purpose: str = "bunraku pose") -> Reader:
    """Load the network, the built-in one unless another is named.

    Raises:
        FormatError: if PyTorch is not there, or the file holds no such network.
    """
    need_torch(purpose)
    from bunraku.neural import understanding

    if network is None:
        return understanding.load_reader(builtin.shape_network(), seed=seed)
    try:
        return understanding.load_reader(read_bytes(network), seed=seed)
    except FormatError:
        raise
    except ValueError as error:
        message = "holds no shape network; make one with bunraku train shape"
        raise FormatError(network, "", message, code=Code.NETWORK) from error


def load_paper(paths: Sequence[Location], *, purpose: str) -> dict[str, Paper]:
    """Load the paper's form from files of `bunraku train deform`, by kind.

    Raises:
        FormatError: if PyTorch is not there, or a file holds no such networks.
    """
    need_torch(purpose)
    from bunraku.neural.implicit.form import answer
    from bunraku.neural.implicit.training import load_form

    forms: dict[str, Paper] = {}
    for path in paths:
        stored = read_bytes(path)
        try:
            form = load_form(stored)
        except ValueError as error:
            message = "holds no networks of the paper's form; make them with bunraku train deform"
            raise FormatError(path, "", message, code=Code.NETWORK) from error
        forms[form.kind] = partial(answer, form)
    return forms


def need_torch(purpose: str) -> None:
    """Say how to install PyTorch, if it is not there.

    Raises:
        FormatError: if it is not there.
    """
    if find_spec("torch") is None or find_spec("safetensors") is None:
        message = 'needs PyTorch, which is not installed: pip install "bunraku[neural]"'
        raise FormatError(purpose, "", message, code=Code.EXTRA_MISSING)
