from dataclasses import dataclass

import pytest

from bunraku.evaluate.results import group_by_family, make_table, measure_all, read_rows, sample
from bunraku.types import FormatError


@dataclass(frozen=True)
class Line:
    name: str
    value: float = 0.0

    def key(self):
        return (self.name,)


def explode(task):
    raise AssertionError(f"{task} was measured again")


def test_a_second_run_measures_nothing_again(tmp_path):
    state = tmp_path / "rows.jsonl"
    tasks = [Line("a"), Line("b")]
    first = list(measure_all(tasks, lambda t: Line(t.name, 0.1 + 0.2), Line, state=state))
    assert list(measure_all(tasks, explode, Line, state=state)) == first


def test_a_row_torn_by_a_crash_is_measured_again(tmp_path):
    state = tmp_path / "rows.jsonl"
    list(measure_all([Line("a"), Line("b")], lambda t: t, Line, state=state))
    state.write_bytes(state.read_bytes()[:-3])
    assert set(read_rows(state, Line)) == {("a",)}
    list(measure_all([Line("a"), Line("b")], lambda t: Line(t.name, 2.0), Line, state=state))
    assert [row.value for row in read_rows(state, Line).values()] == [0.0, 2.0]


def test_rows_of_another_table_are_refused(tmp_path):
    state = tmp_path / "rows.jsonl"
    state.write_bytes(b'{"family": "a"}\n')
    with pytest.raises(FormatError, match="holds other rows than this table's"):
        read_rows(state, Line)


def test_without_a_state_file_everything_is_measured():
    with pytest.raises(AssertionError, match="was measured again"):
        list(measure_all([Line("a")], explode, Line))


def test_a_sample_takes_from_every_group():
    groups = [[Line(f"a{i}") for i in range(9)], [Line("b1")]]
    names = [task.name for task in sample(groups, 4)]
    assert "b1" in names
    assert len(set(names)) == 4
    assert names == [task.name for task in sample(groups, 4)]
    assert [task.name for task in sample(groups, None)] == [f"a{i}" for i in range(9)] + ["b1"]


def test_tasks_are_grouped_by_the_first_part_of_their_keys():
    tasks = [Line("a"), Line("b"), Line("a", 2.0)]
    assert group_by_family(tasks) == [[Line("a"), Line("a", 2.0)], [Line("b")]]


def test_numbers_are_printed_to_three_digits():
    table = make_table("title", ["name", "value"], [["a", 0.123456]])
    assert list(table.columns[1].cells) == ["0.123"]
