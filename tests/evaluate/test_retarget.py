from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from bunraku.evaluate import families, retarget
from bunraku.evaluate.baselines import nearest_vertex, own_rig
from bunraku.evaluate.results import measure_all, read_rows
from bunraku.types import Character, FormatError


@dataclass(frozen=True)
class Found:
    """As much of a route's result as the table reads."""

    character: Character
    confidence: float = 0.9


@pytest.fixture
def family(tmp_path, monkeypatch, stick, tall_stick):
    """A folder of two sticks and a file that is no character."""
    known = {"short": stick, "tall": tall_stick}
    for name in (*known, "broken"):
        path = tmp_path / "sticks" / f"{name}.glb"
        path.parent.mkdir(exist_ok=True)
        path.touch()

    def read(path):
        if path.stem not in known:
            raise FormatError(path, "", "not a character; export it again")
        return known[path.stem]

    monkeypatch.setattr(families, "read_character", read)
    return tmp_path


@pytest.fixture
def naive(monkeypatch):
    """Let the baseline stand in for the route."""

    def animate(source, figure, *, clips, seed, force):
        return Found(nearest_vertex(source, figure, clips))

    monkeypatch.setattr(retarget, "animate_from_rig", animate)


def test_every_ordered_pair_is_measured_at_rest_and_frozen(family):
    tasks = list(retarget.find_tasks(family, clip_count=2))
    assert [task.key() for task in tasks] == [
        ("sticks", source, target, pose, ("bend", "wave"))
        for source, target in (("short", "tall"), ("tall", "short"))
        for pose in ("rest", "nod")
    ]


def test_pairs_are_chosen_by_part_of_their_name(family):
    tasks = retarget.find_tasks(family, pairs=["Tall>"])
    assert {task.source.name for task in tasks} == {"tall"}


def test_scores_of_a_stick_at_rest(family, naive):
    """Worked out by hand: the baseline is exact here, a static figure is not."""
    task = next(retarget.find_tasks(family, pairs=["short>tall"], clip_count=1))
    row = retarget.measure(task, frame_count=5)
    # bodies of other width: the tall stick's own clips walk as far as the short one's
    assert row.scores["own rig"].pmd_in_place == pytest.approx(0.0, abs=1e-9)
    assert row.scores["own rig"].pmd == pytest.approx(5.0)
    assert row.scores["ours"] == row.scores["nearest vertex"]
    assert row.scores["static"].pmd_in_place > 5.0
    assert row.joints == pytest.approx(0.0, abs=1e-9)
    assert row.weights == pytest.approx(0.0, abs=1e-9)
    assert row.confidence == 0.9


def test_the_truth_of_a_frozen_figure_is_its_own_clip(family, monkeypatch, tall_stick):
    def know_the_answer(source, figure, *, clips, seed, force):
        assert np.ptp(figure.vertices[:, 0]) > np.ptp(tall_stick.mesh.vertices[:, 0])
        return Found(own_rig(source, tall_stick, clips))

    monkeypatch.setattr(retarget, "animate_from_rig", know_the_answer)
    task = list(retarget.find_tasks(family, pairs=["short>tall"], clip_count=2))[1]
    row = retarget.measure(task)
    assert row.pose == "nod"
    assert row.scores["ours"].pmd_in_place == pytest.approx(0.0, abs=1e-9)
    assert row.scores["nearest vertex"].pmd_in_place > 1.0
    # this answer is bound at rest: the frozen figure has walked .1 m of its 2 m
    assert row.joints == pytest.approx(5.0)


def test_a_target_without_clips_is_compared_by_joint_name(family, naive, tall_stick, monkeypatch):
    known = {"short": families.read_character(family / "short.glb")}
    silent = replace(tall_stick, clips=())
    monkeypatch.setattr(families, "read_character", lambda path: known.get(path.stem, silent))
    tasks = list(retarget.find_tasks(family, pairs=["short>tall"], clip_count=1))
    for task in tasks:
        assert retarget.measure(task).scores["own rig"].pmd == pytest.approx(0.0, abs=1e-9)
    assert [task.frozen for task in tasks] == [None, "wave"]


def test_a_figure_the_route_fails_on_is_counted(family, monkeypatch):
    def refuse(source, figure, *, clips, seed, force):
        raise ValueError("nothing to hold on to")

    monkeypatch.setattr(retarget, "animate_from_rig", refuse)
    row = retarget.measure(next(retarget.find_tasks(family)))
    assert row.failure == "nothing to hold on to"
    assert "ours" not in row.scores
    table = retarget.tabulate([row])
    assert next(iter(table.columns[1].cells)) == "1 (1 failed)"


def test_rows_survive_the_state_file(family, naive, tmp_path):
    state = tmp_path / "rows.jsonl"
    tasks = list(retarget.find_tasks(family, clip_count=1))
    rows = list(measure_all(tasks, partial(retarget.measure), retarget.Row, state=state))
    assert list(read_rows(state, retarget.Row).values()) == rows


def test_the_table_has_a_line_for_each_family_and_the_whole(family, naive):
    rows = [retarget.measure(task) for task in retarget.find_tasks(family, clip_count=1)]
    table = retarget.tabulate(rows)
    names = ["sticks rest", "sticks frozen", "all rest", "all frozen", "all"]
    assert list(table.columns[0].cells) == names


def test_clips_are_alike_where_the_own_rig_does_much_better_than_the_baseline():
    def row(own: float) -> retarget.Row:
        scores = {
            "own rig": retarget.Scores(own, own, 1.0),
            "nearest vertex": retarget.Scores(8.0, 8.0, 1.0),
        }
        return retarget.Row("family", "a", "b", "rest", ("walk",), scores)

    assert retarget.clips_are_alike(row(2.0)) and not retarget.clips_are_alike(row(2.1))
    columns = retarget.tabulate([row(2.0), row(2.1)]).columns
    assert "of these, clips alike: rest" in list(columns[0].cells)
    assert list(columns[1].cells) == ["2", "2", "1", "2"]
