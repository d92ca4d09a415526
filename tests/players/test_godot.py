"""Godot imports what we write, plays its loops as loops, and puts every joint where we do."""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bunraku import builtin
from bunraku.formats import read_figure, write_character, write_mesh
from bunraku.skinning import linear_blend_skinning, play_clip
from bunraku.verbs.engines import prepare_for

EXACT = """[remap]
importer="scene"
[params]
animation/fps=30
animation/optimizer/enabled=false
"""  # the importer's own settings keep 15 frames a second, and drop what changes little
SCRIPT = Path(__file__).with_name("pose_in_godot.gd")


@pytest.fixture(scope="module")
def godot():
    """The headless server of Godot 3, as Debian packages it."""
    program = os.environ.get("BUNRAKU_GODOT") or shutil.which("godot3-server")
    if program is None:
        pytest.skip("no Godot: install godot3-server, or name it in the variable BUNRAKU_GODOT")
    return program


def ask(godot, folder, job):
    """Let Godot import the folder's figure.glb, then pose it."""
    (folder / "project.godot").write_text('config_version=4\n[application]\nconfig/name="a"\n')
    (folder / "figure.glb.import").write_text(EXACT)
    shutil.copy(SCRIPT, folder / "pose.gd")
    outside = {"HOME": str(folder), "BUNRAKU_JOB": json.dumps(job)}
    for what in (["--editor", "--quit"], ["-s", "pose.gd"]):
        done = subprocess.run(
            [godot, "--path", str(folder), *what],
            env=os.environ | outside,
            capture_output=True,
            text=True,
            timeout=120,
        )
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("answer ")]
    return json.loads(line.removeprefix("answer "))


def test_godot_puts_every_joint_where_we_do(godot, tmp_path):
    human = builtin.human()
    walk = next(clip for clip in human.clips if clip.name == "walk")
    character = prepare_for(replace(human, clips=(walk,)), "godot")
    write_mesh(tmp_path / "human.ply", human.mesh)
    write_character(tmp_path / "figure.glb", read_figure(tmp_path / "human.ply"), character)
    (clip,), frames = character.clips, np.array([0, 15, 40])
    assert clip.name == "walk-loop"
    found = ask(godot, tmp_path, {"clip": clip.name, "times": walk.times[frames].tolist()})
    assert found["loops"]
    names = [name.replace("_", "") for name in found["names"]]  # Godot 3 says left_hand
    order = [names.index(name.lower()) for name in character.skeleton.names]
    motion = np.array(found["poses"])[:, order] @ character.skin.inverse_bind
    theirs = linear_blend_skinning(character.mesh.vertices, character.skin.weights, motion)
    size = np.ptp(human.mesh.vertices, axis=0).max()
    apart = np.abs(theirs - play_clip(character, clip, frames)).max(axis=(1, 2))
    assert apart.max() < 1e-3 * size
    assert np.abs(theirs[1] - theirs[0]).max() > 0.05 * size
