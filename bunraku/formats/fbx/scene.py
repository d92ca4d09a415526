"""The objects of an FBX file, how they hang together, and their properties."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from bunraku import limits
from bunraku.errors import Code, announce
from bunraku.formats.fbx.records import Record, damaged
from bunraku.formats.files import Location
from bunraku.types import FormatError

TICKS = 46_186_158_000  # of FBX time, a second
FRAME_RATES = {
    **{1: 120.0, 2: 100.0, 3: 60.0, 4: 50.0, 5: 48.0, 6: 30.0, 7: 30.0, 8: 30000 / 1001},
    **{9: 30000 / 1001, 10: 25.0, 11: 24.0, 12: 1000.0, 13: 24000 / 1001, 15: 96.0, 16: 72.0},
    17: 60000 / 1001,
}
Properties = dict[str, tuple[Any, ...]]


def first_number(properties: Properties, name: str, default: float) -> float:
    """Give a property of one finite number, or else the default."""
    value = (properties.get(name) or (default,))[0]
    sound = isinstance(value, int | float) and abs(value) < limits.COORDINATE
    return float(value) if sound else default


@dataclass(frozen=True, eq=False)
class Thing:
    """An object: a model (node), geometry, deformer, curve, ..."""

    number: int
    kind: str  # Model, Geometry, Deformer, AnimationCurve, ...
    name: str
    subkind: str  # Mesh, LimbNode, Skin, Cluster, ...
    record: Record
    properties: Properties

    @property
    def where(self) -> str:
        """Name the object in messages."""
        return f"{self.kind} {self.name[:40]!r}"

    def vector(self, name: str, default: float = 0.0) -> Float[np.ndarray, "3"]:
        """Give a property of three numbers."""
        values = self.properties.get(name, ())
        numbers = [value for value in values[:3] if isinstance(value, int | float)]
        return np.array(numbers if len(numbers) == 3 else [default] * 3, np.float64)

    def number_of(self, name: str, default: float = 0.0) -> float:
        """Give a property of one number; what is none counts as not given."""
        return first_number(self.properties, name, default)


@dataclass(frozen=True, eq=False)
class Scene:
    """All objects by number, and what is connected to what."""

    path: Location
    things: dict[int, Thing]
    below: dict[int, list[tuple[int, str]]] = field(default_factory=dict)  # and by which property
    above: dict[int, list[tuple[int, str]]] = field(default_factory=dict)
    settings: Properties = field(default_factory=dict)

    def of(self, kind: str, subkind: str = "") -> Iterator[Thing]:
        """Give the objects of a kind, in order."""
        found = (thing for thing in self.things.values() if thing.kind == kind)
        return (thing for thing in found if not subkind or thing.subkind == subkind)

    @cached_property
    def material_count(self) -> int:
        """Count the materials, once."""
        return sum(1 for _ in self.of("Material"))

    def children(self, thing: Thing, kind: str, subkind: str = "") -> Iterator[Thing]:
        """Give the objects of a kind that are connected below one, each once."""
        for number in dict.fromkeys(number for number, _ in self.below.get(thing.number, ())):
            found = self.things.get(number)
            if found and found.kind == kind and (not subkind or found.subkind == subkind):
                yield found

    def setting(self, name: str, default: float) -> float:
        """Give a number of the file's settings; what is none counts as not given."""
        return first_number(self.settings, name, default)


def build_scene(path: Location, root: Record) -> Scene:
    """Collect the objects and connections of a file.

    Raises:
        FormatError: if there are none, or more nodes than are read.
    """
    objects = root.first("Objects")
    if objects is None or not objects.inside:
        raise FormatError(path, "", "holds no objects; export it again", code=Code.MESH_EMPTY)
    defaults = _read_defaults(root)
    things: dict[int, Thing] = {}
    for record in objects.inside:
        number, name, subkind = (*record.values, 0, "", "")[:3]
        if not isinstance(number, int) or not isinstance(name, str):
            continue  # of no use without a number: nothing can be connected to it
        shared = defaults.get(record.name, {})
        own = shared | read_properties(record.first("Properties70"))
        plain = name.split("\0", 1)[0]
        things[number] = Thing(number, record.name, plain, str(subkind), record, own)
    models = sum(thing.kind == "Model" for thing in things.values())
    if models > limits.NODES:
        message = f"{models} nodes, at most {limits.NODES} are read; flatten the scene"
        raise FormatError(path, "", message, code=Code.LIMIT_NODES)
    settings = root.first("GlobalSettings")
    own = read_properties(settings.first("Properties70") if settings else None)
    scene = Scene(path, things, settings=own)
    for record in ((connections := root.first("Connections")) and connections.inside) or ():
        kind, child, parent, name = (*record.values, "", 0, 0, "")[:4]
        if kind in ("OO", "OP") and isinstance(child, int) and isinstance(parent, int):
            name = name if kind == "OP" and isinstance(name, str) else ""
            scene.below.setdefault(parent, []).append((child, name))
            scene.above.setdefault(child, []).append((parent, name))
    return scene


def read_properties(record: Record | None) -> Properties:
    """Read a table of properties: name and values."""
    lines = record.all("P") if record else ()
    return {str(line.values[0]): line.values[4:] for line in lines if len(line.values) > 4}


def _read_defaults(root: Record) -> dict[str, Properties]:
    """Read what objects of each kind have where they say nothing else."""
    found: dict[str, Properties] = {}
    definitions = root.first("Definitions")
    for kind in definitions.all("ObjectType") if definitions else ():
        template = kind.first("PropertyTemplate")
        if template and kind.values:
            found[str(kind.values[0])] = read_properties(template.first("Properties70"))
    return found


def world_from_file(scene: Scene) -> Float[np.ndarray, "3 3"]:
    """Give the rotation to Y up, facing +Z.

    Raises:
        FormatError: if the settings name one axis twice.
    """
    rows = np.zeros((3, 3))
    for row, (name, default) in enumerate((("Coord", 0.0), ("Up", 1.0), ("Front", 2.0))):
        axis = int(scene.setting(f"{name}Axis", default))
        sign = scene.setting(f"{name}AxisSign", 1.0)
        if axis in (0, 1, 2):
            rows[row, axis] = 1.0 if sign >= 0 else -1.0
    volume = np.linalg.det(rows)
    if abs(volume) < 0.5:
        raise damaged(scene.path, "GlobalSettings", "the axes are not three different ones")
    if volume < 0:
        message = "the axes are left-handed; the one across is turned around"
        announce(scene.path, message, code=Code.FBX_LEFT_OUT, where="GlobalSettings")
        rows[0] *= -1.0
    return rows


def metres_per_unit(scene: Scene) -> float:
    """Give the length of a unit; files count it in centimetres.

    Raises:
        FormatError: if it is no length.
    """
    centimetres = scene.setting("UnitScaleFactor", 1.0)
    if not 1e-6 < centimetres < 1e9:
        message = f"UnitScaleFactor is {centimetres:g}, wanted centimetres above 0"
        raise damaged(scene.path, "GlobalSettings", message)
    return centimetres / 100.0


def frame_rate(scene: Scene) -> float:
    """Give the frames a second that the file was made at."""
    mode = int(scene.setting("TimeMode", 0.0))
    own = scene.setting("CustomFrameRate", 0.0)
    if mode == 14 and 1.0 <= own <= 1000.0:
        return own
    return FRAME_RATES.get(mode, 30.0)
