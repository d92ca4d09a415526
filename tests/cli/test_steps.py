import pytest

from bunraku.cli import steps
from bunraku.types import FormatError


def test_outputs_are_checked_without_leaving_anything(tmp_path):
    steps.check_output(tmp_path / "new.glb", [".glb"], inputs=[None])
    steps.check_output(None, [".glb"], inputs=[])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FormatError, match=r"must end in \.glb or \.obj"):
        steps.check_output(tmp_path / "new.ply", [".glb", ".obj"], inputs=[])
    with pytest.raises(FormatError, match="is also read"):
        steps.check_output(tmp_path / "a.glb", [".glb"], inputs=[tmp_path / "x" / ".." / "a.glb"])
    with pytest.raises(FormatError, match="cannot be written"):
        steps.check_output(tmp_path / "x" / "a.glb", [".glb"], inputs=[])
