"""Blender moves what we write as we do, whatever preset it was written for."""

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bunraku import builtin
from bunraku.formats import read_figure, write_character, write_mesh, write_usd
from bunraku.skinning import play_clip
from bunraku.verbs.engines import ENGINES, prepare_for

SCRIPT = Path(__file__).with_name("pose_in_blender.py")


@pytest.fixture(scope="module")
def blender():
    """Run the script beside this file with a Python that has bpy."""
    python = os.environ.get("BUNRAKU_BPY")
    if not python:
        pytest.skip("no Blender: name a Python that has bpy in the variable BUNRAKU_BPY")

    def pose(*job):
        done = subprocess.run(
            [python, str(SCRIPT)], input=json.dumps(job), capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr[-2000:]
        (line,) = [line for line in done.stdout.splitlines() if line.startswith("answer ")]
        return json.loads(line.removeprefix("answer "))

    return pose


@pytest.mark.parametrize("engine", ENGINES)
def test_blender_puts_every_vertex_where_we_do(blender, engine, tmp_path):
    human = builtin.human()
    walk = next(clip for clip in human.clips if clip.name == "walk")
    character = prepare_for(replace(human, clips=(walk,)), engine)
    write_mesh(tmp_path / "human.ply", human.mesh)
    figure = read_figure(tmp_path / "human.ply")
    write_character(tmp_path / "walk.glb", figure, character)
    frames = np.array([0, 15, 40])
    times = walk.times[frames].tolist()
    found = blender(str(tmp_path / "walk.glb"), character.clips[0].name, times)
    assert set(found["bones"]) == set(character.skeleton.names)
    ours = play_clip(human, walk, frames)
    size = np.ptp(human.mesh.vertices, axis=0).max()
    assert np.abs(np.array(found["places"]) - ours).max() < 1e-3 * size


def test_blender_puts_the_vertices_of_usd_where_we_do(blender, tmp_path):
    pytest.importorskip("pxr", reason="no USD: pip install 'bunraku[usd]'")
    human = builtin.human()
    walk = next(clip for clip in human.clips if clip.name == "walk")
    character = replace(human, clips=(walk,))
    write_mesh(tmp_path / "human.ply", human.mesh)
    write_usd(tmp_path / "walk.usdz", read_figure(tmp_path / "human.ply"), character)
    frames = np.array([0, 15, 40])
    times = walk.times[frames].tolist()
    found = blender(str(tmp_path / "walk.usdz"), "walk", times)
    assert len(found["bones"]) == len(human.skeleton.names)
    ours = play_clip(human, walk, frames)
    size = np.ptp(human.mesh.vertices, axis=0).max()
    assert np.abs(np.array(found["places"]) - ours).max() < 1e-3 * size
