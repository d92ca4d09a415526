from pathlib import Path

import pytest

import bunraku
from bunraku.types import Mesh


@pytest.fixture(scope="module")
def folder(tmp_path_factory, creature) -> Path:
    """The creature as a performer and, stripped, as three figures of other sizes; and a bad one."""
    folder = tmp_path_factory.mktemp("library")
    wave = bunraku.animate(creature.mesh, creature)
    bunraku.write(folder / "performer.glb", wave)
    lines = ["figure,performance,clips"]
    for number, size in enumerate((1.0, 1.5, 2.0)):
        mesh = Mesh(size * creature.mesh.vertices, creature.mesh.faces)
        bunraku.write(folder / f"figure{number}.ply", mesh)
        lines.append(f"figure{number}.ply,performer.glb,Wave")
    (folder / "bad.obj").write_text("v 0 0 nan\n")
    lines.insert(2, "bad.obj,performer.glb,Wave")
    (folder / "jobs.csv").write_text("\n".join(lines) + "\n")
    return folder
