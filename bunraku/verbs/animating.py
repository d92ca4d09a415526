"""Animate, rig and repose a figure: what the commands of the same names do, as functions.

result = animate("hero.obj", "knight.glb", ["Walk"])
write("hero.glb", result)
"""

import os
import time
from collections.abc import Sequence
from dataclasses import replace

from bunraku.errors import Code, announce, collecting_doubts
from bunraku.formats.files import Location
from bunraku.retargeting import retarget_clip
from bunraku.routes.from_rig import RigTransfer, animate_from_rig
from bunraku.types import Character, Clip, Figure, Mesh
from bunraku.verbs.failing import about
from bunraku.verbs.figures import as_figure
from bunraku.verbs.filming import capture, check_film, move_by_film
from bunraku.verbs.performing import (
    BUILT_IN,
    Landmarks,
    choose_clips,
    place_landmarks,
    read_landmarks,
    read_performer,
)
from bunraku.verbs.posing import Posed, avatar_files, check_avatar, is_avatar_folder, pose
from bunraku.verbs.results import Result


def animate(
    figure: Location | Figure | Mesh,
    performance: Location | Character | None = None,
    clips: Sequence[str] | None = None,
    *,
    landmarks: Location | Landmarks | None = None,
    contacts: bool = True,
    seed: int = 0,
    up: str | None = None,
    facing: str | None = None,
    force: bool = False,
) -> Result | Posed:
    """Give a figure a skeleton, a skin and the clips of a performance.

    Args:
        figure: what is to move: a file (.glb .gltf .vrm .fbx .obj .ply .stl .off), or what `read`
            gave, or bare arrays in a Mesh, in metres, Y up, facing +Z.
        performance: a rigged character with clips (.glb .gltf .vrm .fbx), a motion (.bvh) that
            moves the built-in human, a folder of depth frames, a folder of an avatar at rest and
            posed (`pose` says what that is), or a Character; None for the built-in human and its
            clips.
        clips: names of the clips to carry over; all of them, if none is named.
        landmarks: never needed: {"joint": (x, y, z), ...}, or a JSON file of it: where some of the
            performance's joints are, in the coordinates of the figure's file.
        contacts: keep planted feet planted; else they go where the copied turns take them.
        seed: of the random choices.
        up: the axis of the figure's file that is up, y or z, if its format does not say.
        facing: the axis along which the figure looks, such as -y.
        force: give the result even if the match is poor.

    Returns:
        the moving figure, with every stage of the route; what `pose` gives, if an avatar performs.

    Raises:
        FormatError: if a file cannot be read, or a clip or joint does not exist.
        MatchError: if the figure cannot be matched to the performance well enough.
    """
    began = time.perf_counter()
    if isinstance(performance, str | os.PathLike) and is_avatar_folder(performance):
        check_avatar(performance, clips, landmarks, contacts=contacts)
        rest, posed = avatar_files(performance)
        return pose(figure, rest, posed, seed=seed, up=up, facing=facing, force=force)
    found = as_figure(figure, up=up, facing=facing)
    if isinstance(performance, str | os.PathLike) and os.path.isdir(performance):
        check_film(performance, clips, landmarks)
        film = capture(performance)
        with about(found.path):
            moved = move_by_film(film, found, seed=seed, force=force)
        mover = moved.followed.performer
        return Result(found, mover, film.path, moved, time.perf_counter() - began, film)
    performer, name = _as_performer(performance)
    chosen = choose_clips(performer, clips, name)
    transfer = _match(performer, found, chosen, landmarks=landmarks, seed=seed, force=force)
    if not contacts:
        transfer = free_feet(transfer, chosen)
    return Result(found, performer, name, transfer, time.perf_counter() - began)


def rig(
    figure: Location | Figure | Mesh,
    performance: Location | Character | None = None,
    *,
    landmarks: Location | Landmarks | None = None,
    seed: int = 0,
    up: str | None = None,
    facing: str | None = None,
    force: bool = False,
) -> Result:
    """Give a figure a skeleton and a skin in its own pose, without clips; see `animate`."""
    began = time.perf_counter()
    found = as_figure(figure, up=up, facing=facing)
    performer, name = _as_performer(performance)
    transfer = _match(performer, found, (), landmarks=landmarks, seed=seed, force=force)
    return Result(found, performer, name, transfer, time.perf_counter() - began)


def repose(
    figure: Location | Figure | Mesh,
    performance: Location | Character | None = None,
    *,
    landmarks: Location | Landmarks | None = None,
    seed: int = 0,
    up: str | None = None,
    facing: str | None = None,
    force: bool = False,
) -> Mesh:
    """Put a figure in the rest pose of a character: the surface alone, Y up; see `animate`.

    The same as `rig(...).at_rest`, where the skeleton, the confidence and the stages are too.
    """
    return rig(
        figure,
        performance,
        landmarks=landmarks,
        seed=seed,
        up=up,
        facing=facing,
        force=force,
    ).at_rest


def free_feet(transfer: RigTransfer, clips: Sequence[Clip]) -> RigTransfer:
    """Carry the clips over again, with feet that go where the copied turns take them."""
    free = replace(transfer.plan, legs=())
    carried = tuple(retarget_clip(clip, free) for clip in clips)
    return replace(transfer, character=replace(transfer.character, clips=carried))


def _as_performer(performance: Location | Character | None) -> tuple[Character, str]:
    """Read a performer, unless it is one; give its name too."""
    if isinstance(performance, Character):
        return performance, "character"
    return read_performer(performance), BUILT_IN if performance is None else str(performance)


def _match(
    performer: Character,
    found: Figure,
    clips: Sequence[Clip],
    *,
    landmarks: Location | Landmarks | None,
    seed: int,
    force: bool,
) -> RigTransfer:
    """Run the route, and announce what it found doubtful."""
    placed = place_landmarks(read_landmarks(landmarks, performer), found)
    with about(found.path), collecting_doubts() as doubts:
        transfer = animate_from_rig(
            performer, found.mesh, clips=clips, seed=seed, force=force, landmarks=placed
        )
    transfer = replace(transfer, warnings=(*transfer.warnings, *doubts))
    for message in transfer.warnings:
        announce(found.path, message, code=Code.MATCH_DOUBTFUL)
    return transfer
