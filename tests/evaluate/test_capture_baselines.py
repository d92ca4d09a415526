from pathlib import Path

import pytest

from bunraku.evaluate.capture import Task, measure, tabulate
from bunraku.evaluate.capture_baselines import METHODS, OURS, PAPER
from bunraku.evaluate.families import Member


@pytest.fixture(scope="module")
def rows(creature):
    member = Member(Path("creature"), creature)
    return {
        method: measure(Task("made", member, creature.clips[0], "wave", "front", 9, method))
        for method in METHODS
    }


def test_every_method_moves_the_creature_and_none_breaks(rows):
    for method, row in rows.items():
        assert not row.failure and row.method == method and row.key()[-1] == method
        assert row.whole is False or method == OURS
    assert rows["seen side alone"].ratio < 0.6
    assert rows["motion clusters (Le-Deng)"].error != rows["seen side alone"].error
    assert rows["spectral clusters (Zhang)"].error != rows["seen side alone"].error


def test_our_tracking_is_nearer_than_with_the_paper_s_settings(rows):
    assert not PAPER.both_ways and not PAPER.other_starts
    assert rows[OURS].tracking < rows["N-ICP of the paper"].tracking


def test_the_table_has_a_line_a_method_beside_ours(rows):
    table = tabulate(list(rows.values()))
    names = list(table.columns[0].cells)
    assert names[:2] == ["made", "all"]
    assert names[2:-1] == [f"all, {method}" for method in METHODS if method != OURS]
    assert set(table.columns[1].cells) - {""} == {"1"}
