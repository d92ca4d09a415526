"""The main job on real characters: stripped of its rig, each is moved by the built-in human."""

import os
from pathlib import Path

import numpy as np
import pytest

from bunraku import builtin
from bunraku.evaluate.families import play_at
from bunraku.formats import read_character, read_figure, write_character
from bunraku.routes.from_rig import animate_from_rig
from bunraku.types import FormatError

FOLDERS = ("humanoids", "stylised")
SAMPLE = 2  # characters, unless BUNRAKU_THOROUGH is set


def find_characters(data: Path) -> list[Path]:
    """List the files with a rig and a surface, or a few of them from everywhere."""
    paths = [
        path
        for kind in FOLDERS
        for path in sorted((data / kind).rglob("*"))
        if path.suffix in {".glb", ".gltf", ".vrm"}
    ]
    if os.environ.get("BUNRAKU_THOROUGH"):
        return paths
    return [paths[i] for i in np.linspace(0, len(paths) - 1, SAMPLE + 2).astype(int)[1:-1]]


@pytest.mark.filterwarnings("default")
def test_every_character_is_moved_by_the_human(data, tmp_path):
    human = builtin.human()
    walk = next(clip for clip in human.clips if clip.name == "walk")
    moved = []
    for path in find_characters(data):
        try:
            found = read_figure(path)
        except FormatError as error:
            assert "no mesh" in error.message or "no faces" in error.message, error
            continue
        transfer = animate_from_rig(human, found.mesh, clips=[walk], force=True)
        write_character(tmp_path / "out.glb", found, transfer.character)
        written = read_character(tmp_path / "out.glb")
        np.testing.assert_allclose(written.mesh.vertices, found.mesh.vertices, atol=1e-4)
        frames = play_at(written, written.clips[0], np.array([0.2, 0.7]))
        assert np.isfinite(frames).all()
        height = np.ptp(found.mesh.vertices, axis=0).max()
        apart = np.abs(frames - found.mesh.vertices).max() / height
        assert 0.02 < apart < 3, f"{path} moved by {apart} of its size"
        moved.append(path.name)
    assert len(moved) >= SAMPLE
