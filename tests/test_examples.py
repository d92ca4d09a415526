import importlib.util
from pathlib import Path

import pytest

from bunraku import builtin

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name):
    """Import an example by its file and run it."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main()


def test_a_file_gets_two_clips(capsys):
    clips = {clip.name: clip for clip in builtin.human().clips}
    seconds = clips["walk"].times[-1] + clips["wave"].times[-1]
    assert run("01_animate_a_file") == pytest.approx(seconds, abs=1e-5)
    assert "wave: 3.0 s" in capsys.readouterr().out


def test_every_stage_can_be_looked_at(capsys):
    assert 0.02 < run("02_look_at_stages") < 0.3
    assert "registration: strain 0." in capsys.readouterr().out


def test_the_realistic_figure_walks_without_tearing(capsys):
    assert 1.0 < run("03_animate_a_mesh") < 1.6
    assert "confidence" in capsys.readouterr().out


def test_many_figures_end_in_their_own_ways(capsys):
    assert run("04_many_figures") == ["done", "done", "bad input"]
    assert "missing.obj: bad input, confidence 0.00" in capsys.readouterr().out


def test_intrinsic_extrinsic_transfer_beats_functions():
    """The paper's finding (Table 1), on our own body."""
    errors = run("05_carry_weights")
    assert errors["IE barycentric"] <= errors["IE nearest"] < 0.1
    assert errors["IE nearest"] < errors["function"]
    assert errors["function"] == pytest.approx(0.2, abs=0.2)


def test_the_map_puts_the_head_on_top(capsys):
    assert 0.88 < run("06_see_the_map") < 0.96
    assert "leftFoot" in capsys.readouterr().out


def test_a_joint_that_moves_takes_its_skin_along(capsys):
    assert 0.02 < run("07_move_a_joint") < 0.2
    assert "vertices have other weights" in capsys.readouterr().out


def test_examples_are_short_and_none_is_forgotten():
    tested = Path(__file__).read_text()
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text().splitlines()) < 60
        assert f'run("{path.stem}")' in tested
