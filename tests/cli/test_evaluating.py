import json
from types import SimpleNamespace

import numpy as np
import pytest

from bunraku.cli import run
from bunraku.cli.evaluating import find_data, finish
from bunraku.evaluate import retarget
from bunraku.evaluate.baselines import nearest_vertex
from bunraku.evaluate.results import make_table
from bunraku.formats import write_character
from bunraku.types import Figure, FormatError
from tests.evaluate.conftest import make_stick


def test_data_is_given_or_found(tmp_path, monkeypatch):
    assert find_data(tmp_path) == tmp_path
    (tmp_path / "weights").mkdir()
    monkeypatch.setenv("BUNRAKU_DATA", str(tmp_path))
    assert find_data(None) == tmp_path
    assert find_data(None, within="weights") == tmp_path / "weights"
    with pytest.raises(FormatError, match="is no folder of evaluation data; give one with --data"):
        find_data(tmp_path / "nowhere")


def test_a_folder_without_characters_is_an_error(tmp_path, capsys):
    assert run(["evaluate", "retarget", "--data", str(tmp_path)]) == 2
    assert "holds no characters that share a clip" in capsys.readouterr().err
    state = ["--state", str(tmp_path / "missing" / "rows.jsonl")]
    assert run(["evaluate", "retarget", "--data", str(tmp_path), *state]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_tables_are_printed_whole_and_rows_written(tmp_path, capsys):
    columns = [f"a rather long column {i}" for i in range(9)]
    finish([make_table("title", columns, [["x", *range(8)]])], [{"a": 1}], tmp_path / "rows.json")
    assert "a rather long column 8" in capsys.readouterr().out
    assert (tmp_path / "rows.json").read_text() == '[\n  {\n    "a": 1\n  }\n]\n'


def test_retarget_prints_rows_and_tables_and_resumes(tmp_path, monkeypatch, capsys):
    for name, height in (("short", 1.0), ("tall", 2.0)):
        stick = make_stick(height, width=0.1 * height, prefix="Armature|")
        (tmp_path / "sticks").mkdir(exist_ok=True)
        figure = Figure(name, stick.mesh, np.zeros(len(stick.mesh.vertices), np.int64))
        write_character(tmp_path / "sticks" / f"{name}.glb", figure, stick)

    def animate(source, figure, *, clips, seed, force):
        return SimpleNamespace(character=nearest_vertex(source, figure, clips), confidence=0.5)

    monkeypatch.setattr(retarget, "animate_from_rig", animate)
    command = ["evaluate", "retarget", "--data", str(tmp_path), "--state", str(tmp_path / "rows")]
    assert run([*command, "--json", str(tmp_path / "rows.json")]) == 0
    shown = capsys.readouterr().out
    assert "4/4 sticks tall>short " in shown
    assert "sticks rest" in shown
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert [row["pose"] == "rest" for row in rows] == [True, False, True, False]
    assert rows[0]["scores"]["ours"] == rows[0]["scores"]["nearest vertex"]
    monkeypatch.setattr(retarget, "animate_from_rig", None)  # nothing may be measured again
    assert run(command) == 0
    assert run([*command, "--limit", "1"]) == 0
    assert "1/1 " in capsys.readouterr().out
