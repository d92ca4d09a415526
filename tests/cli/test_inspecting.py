from dataclasses import replace

import pytest

from bunraku.cli.inspecting import print_inspection, tabulate
from bunraku.formats.inspection import ClipSummary, Fault, Inspection


@pytest.fixture
def knight():
    clips = tuple(ClipSummary(f"Walk{i}", 1.5, 46) for i in range(14))
    return Inspection(
        "knight.glb",
        "character",
        "gltf",
        12_345,
        meshes=1,
        pieces=2,
        vertices=1200,
        welded_vertices=1000,
        faces=1996,
        parts=1,
        closed=True,
        high=(0.5, 1.8, 0.25),
        skins=(23,),
        joints=23,
        bind="own",
        clips=clips,
        extensions_used=("VRM",),
        extensions_required=("VRM",),
        faults=(Fault("MESH_ZERO_AREA", "", "3 faces have no area", "warning"),),
    )


def test_a_person_reads_a_table(knight):
    rows = list(tabulate(knight))
    told = dict(reversed(rows))
    assert told["file"] == "knight.glb: character, gltf, 12,345 bytes"
    assert told["vertices"] == "1,200 (1,000 welded)"
    assert told["surface"] == "closed"
    assert told["bounds"] == "x 0 to 0.5, y 0 to 1.8, z 0 to 0.25"
    assert told["bind pose"] == "another than the nodes'"
    assert told["clip"] == "Walk0: 1.5 s, 46 frames"
    assert told["extension"] == "VRM (required)"
    assert told["warning"] == "3 faces have no area [MESH_ZERO_AREA]"
    assert sum(name == "clip" for name, _ in rows) == 12
    assert rows[-1][1] == "... 2 more clips: --json"


def test_an_open_surface_says_how_open(knight):
    torn = replace(knight, closed=False, boundary_edges=7, non_manifold_edges=2)
    assert dict(tabulate(torn))["surface"] == "open: 7 boundary edges, 2 of three faces or more"


def test_a_motion_is_told_and_its_name_cannot_steer_a_terminal(tmp_path, capsys):
    path = tmp_path / "a\x1b[2Jrm.bvh"
    path.write_text(
        "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
        "End Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"
    )
    print_inspection(path, as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert "a?[2Jrm" in lines[0]
    assert lines[-1] == "clip            a?[2Jrm: 0 s, 1 frames"
    assert lines[1] == "joints          2"
    assert lines[2] == "bind pose       the recording's rest pose"
