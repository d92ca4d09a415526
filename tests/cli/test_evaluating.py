import pytest

from bunraku.cli.evaluating import find_data, finish
from bunraku.evaluate.results import make_table
from bunraku.types import FormatError


def test_data_is_given_or_found(tmp_path, monkeypatch):
    assert find_data(tmp_path) == tmp_path
    (tmp_path / "weights").mkdir()
    monkeypatch.setenv("BUNRAKU_DATA", str(tmp_path))
    assert find_data(None) == tmp_path
    assert find_data(None, within="weights") == tmp_path / "weights"
    with pytest.raises(FormatError, match="is no folder of evaluation data; give one with --data"):
        find_data(tmp_path / "nowhere")


def test_tables_are_printed_whole_and_rows_written(tmp_path, capsys):
    columns = [f"a rather long column {i}" for i in range(9)]
    finish([make_table("title", columns, [["x", *range(8)]])], [{"a": 1}], tmp_path / "rows.json")
    assert "a rather long column 8" in capsys.readouterr().out
    assert (tmp_path / "rows.json").read_text() == '[\n  {\n    "a": 1\n  }\n]\n'
