"""Clips of an FBX file: curves of angles and lengths, turned into keys of whole transforms."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from bunraku import limits
from bunraku.errors import Code, announce
from bunraku.formats.fbx.placement import Parts, place_node
from bunraku.formats.fbx.records import damaged, unpack
from bunraku.formats.fbx.scene import TICKS, Scene, Thing, frame_rate
from bunraku.types import FormatError

PATHS = {"Lcl Translation": 0.0, "Lcl Rotation": 0.0, "Lcl Scaling": 1.0}
CONSTANT, CUBIC = 0x2, 0x8  # how a key goes on to the next one; else in a straight line
Ticks = Int[np.ndarray, " keys"]


@dataclass(frozen=True, eq=False)
class Curve:
    """One number over time."""

    ticks: Ticks
    values: Float[np.ndarray, " keys"]
    flags: Int[np.ndarray, " keys"]
    slopes: Float[np.ndarray, "keys 2"]  # a second: leaving this key, arriving at the next


@dataclass(frozen=True, eq=False)
class Motion:
    """A clip: its times, and what each node that it moves does below its parent."""

    name: str
    times: Float[np.ndarray, " frames"]
    moved: dict[int, Parts] = field(default_factory=dict)  # by the node's number


def read_motions(scene: Scene) -> Iterator[Motion]:
    """Read every clip that moves a node, one after the other; all are counted before the first.

    Raises:
        FormatError: if a curve is damaged, or clips have more frames than are read.
    """
    chosen: list[tuple[Thing, Thing]] = []
    read, times, total = dict[int, Curve | None](), dict[int, tuple[Ticks, int]](), 0
    for stack in scene.of("AnimationStack"):
        layers = [one for one in scene.children(stack, "AnimationLayer") if _moves(scene, one)]
        if len(layers) > 1:
            message = f"{len(layers)} animation layers; only the first is read, bake them into one"
            announce(scene.path, message, code=Code.FBX_LEFT_OUT, where=stack.where)
        for layer in layers[:1]:
            if layer.number not in times:
                curves = _gather_curves(scene, layer, read)
                times[layer.number] = _sample_times(scene, stack, curves), len(curves)
            ticks, nodes = times[layer.number]
            total += len(ticks) * nodes
            if len(ticks):
                chosen.append((stack, layer))
            if total > limits.JOINT_FRAMES:
                message = f"frames times nodes of all clips are over {limits.JOINT_FRAMES}"
                message += "; cut the clips"
                raise FormatError(scene.path, stack.where, message, code=Code.LIMIT_FRAMES)
    for stack, layer in chosen:
        curves = _gather_curves(scene, layer, read)
        yield _bake(scene, stack, curves, ticks=times[layer.number][0])


Track = Curve | float  # a number that stands still needs no curve
Gathered = dict[int, dict[tuple[str, int], Track]]  # by node, property and axis


def _targets(scene: Scene, group: Thing) -> Iterator[tuple[int, str]]:
    """Give the nodes that a curve node moves, and by which property."""
    for number, name in scene.above.get(group.number, ()):
        if name in PATHS and number in scene.things and scene.things[number].kind == "Model":
            yield number, name


def _moves(scene: Scene, layer: Thing) -> bool:
    """Say whether a layer has a curve that moves a node."""
    return any(
        next(_targets(scene, group), None) and next(scene.children(group, "AnimationCurve"), None)
        for group in scene.children(layer, "AnimationCurveNode")
    )


def _gather_curves(scene: Scene, layer: Thing, read: dict[int, Curve | None]) -> Gathered:
    """Find the curves of a layer that move nodes; `read` keeps what was read, by number.

    An axis without a curve stands where its curve node says, or else as the node rests.
    """
    found: Gathered = {}
    for group in scene.children(layer, "AnimationCurveNode"):
        curves = _curves_of(scene, group, read)
        for node, path in _targets(scene, group):
            rest = scene.things[node].vector(path, PATHS[path]).tolist()
            for axis in range(3):
                still = group.number_of(f"d|{'XYZ'[axis]}", rest[axis])
                if axis in curves:
                    found.setdefault(node, {})[path, axis] = curves[axis]
                elif still != rest[axis]:
                    found.setdefault(node, {}).setdefault((path, axis), still)
    return found


def _curves_of(scene: Scene, group: Thing, read: dict[int, Curve | None]) -> dict[int, Curve]:
    """Read the curves of a curve node that have keys, by axis."""
    curves = {}
    for number, name in scene.below.get(group.number, ()):
        thing = scene.things.get(number)
        axis = name[-1:]
        if thing is None or thing.kind != "AnimationCurve" or axis not in ("X", "Y", "Z"):
            continue
        if number not in read:
            read[number] = _read_curve(scene, thing)
        curve = read[number]
        if curve is not None:
            curves["XYZ".index(axis)] = curve
    return curves


def _read_curve(scene: Scene, thing: Thing) -> Curve | None:
    """Read a curve; nothing if it has no keys."""
    arrays = {}
    for name in ("KeyTime", "KeyValueFloat", "KeyAttrFlags", "KeyAttrDataFloat", "KeyAttrRefCount"):
        record = thing.record.first(name)
        where = f"{thing.where} {name}"
        value = record.values[0] if record and record.values else None
        arrays[name] = np.zeros(0) if value is None else unpack(scene.path, where, value)
    ticks, values = arrays["KeyTime"].astype(np.int64), arrays["KeyValueFloat"].astype(np.float64)
    if not len(ticks):
        return None
    if len(ticks) != len(values) or not (np.abs(values) < limits.COORDINATE).all():
        message = f"{len(values)} values for {len(ticks)} keys, or some are not finite"
        raise FormatError(
            scene.path, thing.where, f"{message}; bake the clip again", code=Code.CLIP_VALUES
        )
    if (np.diff(ticks) < 0).any() or max(abs(int(ticks[0])), abs(int(ticks[-1]))) > 1 << 60:
        message = "key times do not rise, or lie outside what is read; bake the clip again"
        raise FormatError(scene.path, thing.where, message, code=Code.CLIP_TIMES)
    counts = arrays["KeyAttrRefCount"].astype(np.int64)
    flags, slopes = np.zeros(len(ticks), np.int64), np.zeros((len(ticks), 2))
    shaped = arrays["KeyAttrDataFloat"].astype(np.float64)
    fits = len(counts) == len(arrays["KeyAttrFlags"]) and 4 * len(counts) == len(shaped)
    small = (counts > 0) & (counts <= len(ticks))  # so that their sum cannot wrap around
    if fits and small.all() and counts.sum() == len(ticks):
        flags = np.repeat(arrays["KeyAttrFlags"].astype(np.int64), counts)
        slopes = np.repeat(np.nan_to_num(shaped.reshape(-1, 4)[:, :2]), counts, axis=0)
    return Curve(ticks, values, flags, slopes)


def evaluate(curve: Curve, ticks: Ticks) -> Float[np.ndarray, " frames"]:
    """Give a curve's value at each time: steps, straight lines or cubic ones (Hermite)."""
    last = len(curve.ticks) - 1
    if not last:
        return np.full(len(ticks), curve.values[0])
    here = np.clip(np.searchsorted(curve.ticks, ticks, side="right") - 1, 0, last - 1)
    span = np.maximum(curve.ticks[here + 1] - curve.ticks[here], 1)
    u = np.clip((ticks - curve.ticks[here]) / span, 0.0, 1.0)
    low, high = curve.values[here], curve.values[here + 1]
    values = low + u * (high - low)
    seconds = span / TICKS
    leaving, arriving = (curve.slopes[here, side] * seconds for side in (0, 1))
    cubic = (1 - u) ** 2 * ((1 + 2 * u) * low + u * leaving)
    cubic += u**2 * ((3 - 2 * u) * high - (1 - u) * arriving)
    flags = curve.flags[here]
    values = np.where(flags & CUBIC, cubic, values)
    return np.where((flags & CONSTANT).astype(bool) & (u < 1), low, values)


def _bake(scene: Scene, stack: Thing, curves: Gathered, *, ticks: Ticks) -> Motion:
    """Sample all curves of a clip."""
    motion = Motion(stack.name, (ticks - ticks[0]) / TICKS)
    for number, own in curves.items():
        node, columns = scene.things[number], []
        for path, default in PATHS.items():
            values = np.tile(node.vector(path, default), (len(ticks), 1))
            for axis in range(3):
                track = own.get((path, axis))
                if isinstance(track, Curve):
                    values[:, axis] = evaluate(track, ticks)
                elif track is not None:
                    values[:, axis] = track
            columns.append(values)
        motion.moved[number] = place_node(node, *columns)
    return motion


def _sample_times(scene: Scene, stack: Thing, curves: Gathered) -> Ticks:
    """Choose the times of a clip's frames: every key, and the file's frames in long gaps."""
    tracks = {id(track): track for own in curves.values() for track in own.values()}
    ticks = [track.ticks for track in tracks.values() if isinstance(track, Curve)]
    keys = np.unique(np.concatenate([np.zeros(0, np.int64), *ticks]))
    step = round(TICKS / frame_rate(scene))
    gaps = np.diff(keys)
    inner = np.where(2 * gaps > 3 * step, -(-gaps // step) - 1, 0)
    if len(keys) + int(inner.sum()) > limits.FRAMES:
        message = f"more than {limits.FRAMES} frames; cut the clip"
        raise FormatError(scene.path, stack.where, message, code=Code.LIMIT_FRAMES)
    number = np.arange(int(inner.sum())) - np.repeat(np.cumsum(inner) - inner, inner) + 1
    between = np.repeat(keys[:-1], inner) + number * step
    if len(np.unique(np.concatenate([keys, between]))) != len(keys) + len(between):
        raise damaged(scene.path, stack.where, "key times overlap")
    return np.sort(np.concatenate([keys, between]))
