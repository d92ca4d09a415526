import importlib.util
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name):
    """Import an example by its file and run it."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main()


def test_the_realistic_figure_walks_without_tearing(capsys):
    assert 1.0 < run("animate_a_mesh") < 1.6
    assert "confidence" in capsys.readouterr().out


def test_intrinsic_extrinsic_transfer_beats_functions():
    """The paper's finding (Table 1), on our own body."""
    errors = run("carry_weights")
    assert errors["IE barycentric"] <= errors["IE nearest"] < 0.1
    assert errors["IE nearest"] < errors["function"]
    assert errors["function"] == pytest.approx(0.2, abs=0.2)
