"""How far to trust a moved figure, in numbers: what `--report` writes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku import __version__
from bunraku.evaluate import metrics
from bunraku.evaluate.families import play_at
from bunraku.graphs import mesh_edges
from bunraku.meshes import connected_parts, weld
from bunraku.routes.from_avatar import AvatarTransfer
from bunraku.routes.from_depth import Capture, DepthTransfer
from bunraku.routes.from_rig import RigTransfer
from bunraku.skinning import clip_transforms, forward_kinematics, play_clip
from bunraku.types import Character, Clip, Mesh, Skin

Transfer = RigTransfer | DepthTransfer


@dataclass(frozen=True)
class ClipReport:
    """One moving clip, measured on a few of its frames, edges and vertices."""

    name: str
    seconds: float
    frames: int
    stretch_p99: float
    foot_slide_m: float  # metres per second of contact
    penetration_fraction: float
    foot_slide_source_m: float  # the source's own, at the scale at which the figure travels
    penetration_source_fraction: float | None  # None where the source is seen from one side only


def report_transfer(
    figure_path: str,
    performance: Mapping[str, object],
    source: Character,
    transfer: RigTransfer,
    *,
    total_seconds: float,
) -> dict[str, object]:
    """Gather what the route found.

    Args:
        figure_path: the figure's file as the user named it.
        performance: what is known of the source's file.
        source: the performing character.
        transfer: what the route gave.
        total_seconds: from the start of the command, reading included.
    """
    return {
        "bunraku": __version__,
        "route": "from_rig",
        "figure": describe_figure(figure_path, transfer.character.mesh),
        "performance": {**performance, "joints": len(source.skeleton.names)},
        "seconds": {"total": total_seconds, **transfer.seconds},
        "confidence": transfer.confidence,
        "warnings": list(transfer.warnings),
        "map": {"mirrored": transfer.mirrored, "score": transfer.score},
        "skin": describe_skin(transfer.character.skin),
        "clips": [asdict(clip) for clip in describe_clips(source, transfer)],
    }


def report_avatar_transfer(
    figure_path: str, avatar_path: str, transfer: AvatarTransfer, *, total_seconds: float
) -> dict[str, object]:
    """Gather what the poses of an avatar made of a figure.

    Args:
        figure_path: the figure's file as the user named it.
        avatar_path: the avatar's at rest, likewise.
        transfer: what the route gave.
        total_seconds: from the start of the command, reading included.
    """
    moved, clip = transfer.character, transfer.character.clips[0]
    sample, ends = sample_edges(moved)
    frames = play_clip(sample, clip)
    avatar = describe_figure(avatar_path, transfer.performer.mesh)
    return {
        "bunraku": __version__,
        "route": "from_avatar",
        "figure": describe_figure(figure_path, moved.mesh),
        "performance": {**avatar, "kind": transfer.avatar.kind, "poses": len(clip.times)},
        "seconds": {"total": total_seconds, **transfer.seconds},
        "confidence": transfer.confidence,
        "warnings": list(transfer.warnings),
        "map": {"mirrored": False, "score": transfer.confidence, "by": transfer.chosen},
        "agreement": {"avatar": transfer.avatar.agreement, "figure": transfer.figure.agreement},
        "skin": describe_skin(moved.skin),
        "clips": [
            {
                "name": clip.name,
                "seconds": float(clip.times[-1] - clip.times[0]),
                "frames": len(clip.times),
                "stretch_p99": metrics.stretch(frames, sample.mesh.vertices, ends),
            }
        ],
    }


def describe_figure(path: str, mesh: Mesh) -> dict[str, object]:
    """Say which figure was moved; its height is in the file's unit."""
    return {
        "path": path,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "parts": count_parts(mesh),
        "height": metrics.figure_height(mesh.vertices),
    }


def describe_skin(skin: Skin) -> dict[str, object]:
    """Say how many joints move a vertex at most, and how many vertices none moves."""
    return {
        "influences_max": int((skin.weights > 0).sum(axis=1).max(initial=0)),
        "unweighted_vertices": int((skin.weights.sum(axis=1) == 0).sum()),
    }


def describe_clips(source: Character, transfer: Transfer) -> Iterator[ClipReport]:
    """Measure every clip that was carried over."""
    moved = transfer.character
    clips = {clip.name: clip for clip in source.clips}
    sample, ends = sample_edges(moved)
    own = tuple(clips.get(carried.name, carried) for carried in moved.clips)
    entered = _penetration(moved, moved.clips, transfer.target_proxy.mesh)
    before = np.full(len(own), np.nan)  # of a performer seen from one side nobody knows
    if isinstance(transfer, RigTransfer):
        before = _penetration(source, own, transfer.source_proxy.mesh)
    for clip, carried, ours, theirs in zip(own, moved.clips, entered, before, strict=True):
        frames = play_at(sample, carried, np.linspace(0, 1, 8))
        yield ClipReport(
            carried.name,
            float(carried.times[-1] - carried.times[0]),
            len(carried.times),
            metrics.stretch(frames, sample.mesh.vertices, ends),
            slide_of_clip(source, moved, clip, carried),
            float(ours),
            transfer.plan.scale * slide_of_clip(source, source, clip, clip),
            None if np.isnan(theirs) else float(theirs),
        )


def _penetration(
    character: Character, clips: Sequence[Clip], proxy: Mesh
) -> Float[np.ndarray, " clips"]:
    """Measure penetration on two frames of every clip, by the character's proxy."""
    if not clips:
        return np.zeros(0)
    solid, phases = wear_skin(character, proxy), np.array([0.3, 0.7])
    posed = np.concatenate([play_at(solid, clip, phases) for clip in clips])
    found = metrics.penetration_fractions(posed, solid.mesh.vertices, solid.mesh.faces)
    return found.reshape(-1, len(phases)).mean(axis=1)


def count_parts(mesh: Mesh) -> int:
    """Count the connected parts of a mesh once vertices at equal positions are merged."""
    vertices, faces, _ = weld(mesh.vertices, mesh.faces)
    return len(np.unique(connected_parts(faces, len(vertices))[np.unique(faces)]))


def sample_edges(
    character: Character, *, count: int = 3000
) -> tuple[Character, Int[np.ndarray, "edges 2"]]:
    """Take edges of evenly spread faces; give what of the character they need, and their ends."""
    faces = character.mesh.faces
    spread = np.linspace(0, len(faces) - 1, min(count // 3, len(faces))).astype(np.int64)
    ends = mesh_edges(faces[spread])
    used, places = np.unique(ends, return_inverse=True)
    skin = Skin(character.skin.weights[used], character.skin.inverse_bind)
    points = Mesh(character.mesh.vertices[used], np.zeros((0, 3), np.int64))
    return Character(points, character.skeleton, skin), places.reshape(-1, 2)


def wear_skin(character: Character, mesh: Mesh) -> Character:
    """Give a mesh in a character's place the weights of the character's nearest vertices."""
    nearest = KDTree(character.mesh.vertices).query(mesh.vertices)[1]
    skin = Skin(character.skin.weights[nearest], character.skin.inverse_bind)
    return Character(mesh, character.skeleton, skin)


def find_feet(character: Character, *, low: float = 0.12) -> Int[np.ndarray, " feet"]:
    """Find the joints that touch the ground: low in the bind pose, and with skin of their own."""
    vertices = character.mesh.vertices
    joints = np.linalg.inv(character.skin.inverse_bind)[:, :3, 3]
    above = (joints[:, 1] - vertices[:, 1].min()) / metrics.figure_height(vertices)
    share = character.skin.weights.sum(axis=0) / len(vertices)
    return np.flatnonzero((above < low) & (share > 1e-3))


def slide_of_clip(source: Character, moved: Character, clip: Clip, carried: Clip) -> float:
    """Give how fast planted feet slide, in metres per second; contacts are the source's.

    Args:
        source: the character whose clip it was.
        moved: the figure, which has the source's joints.
        clip: as the source plays it.
        carried: as the figure plays it, frame by frame.
    """
    feet = find_feet(source)
    height = metrics.figure_height(source.mesh.vertices)
    planted = metrics.foot_contacts(joint_paths(source, clip)[:, feet], clip.times, height)
    return metrics.foot_slide(joint_paths(moved, carried)[:, feet], planted, carried.times)


def joint_paths(character: Character, clip: Clip) -> Float[np.ndarray, "frames joints 3"]:
    """Follow every joint through a clip, in metres."""
    world = forward_kinematics(character.skeleton.parents, clip_transforms(clip))
    return world[..., :3, 3].copy()


def report_capture(path: str, capture: Capture, *, total_seconds: float) -> dict[str, object]:
    """Gather what a depth video gave: how well it was followed, and what was seen.

    Args:
        path: the video's folder as the user named it.
        capture: what the route gave.
        total_seconds: from the start of the command, reading included.
    """
    seen, bones = capture.track.visible, capture.bones.owners
    names = capture.character.skeleton.names
    shares = [
        float(seen[:, bones == bone].mean()) if (bones == bone).any() else 0.0
        for bone in range(len(names))
    ]
    return {
        "bunraku": __version__,
        "route": "from_depth",
        "performance": {
            "path": path,
            "frames": len(capture.times),
            "reference_frame": capture.track.reference,
            "diagonal": capture.diagonal,
            "joints": len(names),
        },
        "seconds": {"total": total_seconds, **capture.seconds},
        "warnings": list(capture.warnings),
        "tracking_error_m": [float(error) for error in capture.track.residuals],
        "seen": dict(zip(names, shares, strict=True)),
    }


def report_depth_transfer(
    figure_path: str,
    performance: str,
    capture: Capture,
    transfer: DepthTransfer,
    *,
    total_seconds: float,
) -> dict[str, object]:
    """Gather what a depth video made of a figure.

    Args:
        figure_path: the figure's file as the user named it.
        performance: the video's folder, likewise.
        capture: what was captured of it.
        transfer: what the route gave.
        total_seconds: from the start of the command, reading included.
    """
    told = report_capture(performance, capture, total_seconds=total_seconds)
    names, matched = capture.character.skeleton.names, transfer.embedding.matched.tolist()
    mover = transfer.followed
    return told | {
        "figure": describe_figure(figure_path, transfer.character.mesh),
        "seconds": {"total": total_seconds, **capture.seconds, **transfer.seconds},
        "confidence": transfer.confidence,
        "warnings": [*capture.warnings, *transfer.warnings],
        "map": {"mirrored": False, "score": transfer.embedding.misfit},
        "matched": dict(zip(names, matched, strict=True)),
        "skin": describe_skin(transfer.character.skin),
        "followed": "figure" if mover.whole else "seen side",
        "depth_error_m": mover.errors.tolist(),
        "clips": [asdict(clip) for clip in describe_clips(mover.performer, transfer)],
    }
