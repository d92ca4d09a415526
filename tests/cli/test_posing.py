import numpy as np
import pytest

import bunraku
from bunraku.cli import run
from bunraku.cli.posing import spread_values
from bunraku.neural.corpus import draw_sculpted
from bunraku.types import Mesh


def test_several_poses_may_follow_one_option():
    given = ["pose", "hero.obj", "--rest", "a.obj", "--posed", "b.obj", "c.obj", "-o", "out.glb"]
    wanted = ["pose", "hero.obj", "--rest", "a.obj", "--posed", "b.obj", "--posed", "c.obj"]
    assert spread_values(given) == [*wanted, "-o", "out.glb"]


def test_a_figure_after_the_poses_is_a_figure():
    given = ["pose", "--rest", "a.obj", "--posed", "b.obj", "hero.obj", "-o", "out.glb"]
    assert spread_values(given) == given


def test_other_commands_are_left_alone():
    assert spread_values(["animate", "a", "--posed", "b", "c"]) == [
        "animate",
        "a",
        "--posed",
        "b",
        "c",
    ]
    assert spread_values([]) == []


@pytest.fixture
def files(tmp_path):
    rng = np.random.default_rng(3)
    avatar, figure = draw_sculpted("rounded", rng), draw_sculpted("rounded", rng)
    bunraku.write(tmp_path / "rest.obj", avatar.mesh)
    bunraku.write(tmp_path / "hero.obj", figure.mesh)
    bent = avatar.mesh.vertices * [1.0, 0.98, 1.0]
    bunraku.write(tmp_path / "bent.obj", Mesh(bent, avatar.mesh.faces))
    return tmp_path


def test_a_figure_is_posed_from_files(files, capsys):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    poses = ["--posed", str(files / "bent.obj"), str(files / "rest.obj")]
    out, report = files / "out.glb", files / "out.json"
    arguments = ["pose", str(files / "hero.obj"), "--rest", str(files / "rest.obj"), *poses]
    assert run([*arguments, "-o", str(out), "--report", str(report), "--force"]) == 0
    assert len(bunraku.read_performer(out).clips[0].times) == 2 and report.exists()


def test_a_pose_of_another_mesh_ends_in_one_line(files, capsys):
    arguments = ["pose", str(files / "hero.obj"), "--rest", str(files / "rest.obj")]
    assert run([*arguments, "--posed", str(files / "hero.obj"), "-o", str(files / "o.glb")]) == 2
    line = capsys.readouterr().err.strip()
    assert line.startswith("error: ") and "[AVATAR_POSED]" in line and len(line) <= 300
    assert "\n" not in line and not (files / "o.glb").exists()


@pytest.mark.parametrize("read", ["hero", "rest", "bent"])
def test_no_pose_of_several_is_written_over_an_input(files, capsys, read):
    names = {name: files / f"{name}.obj" for name in ("hero", "rest", "bent")}
    names[read] = names[read].rename(files / "out-002.obj")
    before = names[read].read_bytes()
    arguments = ["pose", str(names["hero"]), "--rest", str(names["rest"])]
    arguments += ["--posed", str(names["bent"]), str(names["bent"]), "-o", str(files / "out.obj")]
    assert run([*arguments, "--force"]) == 2
    line = capsys.readouterr().err.strip()
    assert "out-002.obj: is also read" in line and "\n" not in line
    assert names[read].read_bytes() == before and not (files / "out-001.obj").exists()


def test_animate_takes_a_folder_of_an_avatar_and_writes_over_none_of_it(files, capsys):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    folder = files / "avatar"
    folder.mkdir()
    (files / "rest.obj").rename(folder / "rest.obj")
    pose = bunraku.read(files / "bent.obj").mesh
    bunraku.write(folder / "bent.glb", pose)
    kept = (folder / "bent.glb").read_bytes()
    arguments = ["animate", str(files / "hero.obj"), "--with", str(folder)]
    assert run([*arguments, "-o", str(folder / "bent.glb")]) == 2
    assert "bent.glb: is also read" in capsys.readouterr().err
    assert (folder / "bent.glb").read_bytes() == kept
    (folder / "bent.glb").unlink()
    assert run([*arguments, "-o", str(files / "out.glb")]) == 2
    line = capsys.readouterr().err.strip()
    assert "no poses" in line and "[AVATAR_POSED]" in line and "\n" not in line


def test_training_and_its_rows_end_in_one_line_if_they_cannot_be(tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
    out, broken = str(tmp_path / "net.safetensors"), tmp_path / "broken.safetensors"
    broken.write_bytes(b"nothing")
    cases = {
        "wanted one of person, quadruped": ["train", "deform", "-o", out, "--kind", "fish"],
        "net.checkpoint": ["train", "deform", "-o", out, "--kind", "quadruped", "--resume"],
        "holds no networks of the paper's form": [
            *("evaluate", "pose", "--data", str(tmp_path), "--deform", str(broken))
        ],
    }
    for wanted, arguments in cases.items():
        assert run(arguments) == 2
        line = capsys.readouterr().err.strip()
        assert line.startswith("error: ") and wanted in line
        assert "\n" not in line and len(line) <= 300
