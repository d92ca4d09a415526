from pathlib import Path

import numpy as np
import pytest

from bunraku.evaluate.capture import Row, Task, compare, describe, measure, moves, spread, tabulate
from bunraku.evaluate.families import Member
from bunraku.evaluate.metrics import local_pose_error, reconstruction_error
from bunraku.rotations import vectors_to_matrices


def test_errors_by_hand(rng):
    truth = rng.normal(size=(4, 30, 3))
    assert reconstruction_error(truth + np.array([0.0, 3.0, 4.0]), truth) == pytest.approx(5.0)
    turned = truth @ vectors_to_matrices(np.array([0.3, 1.0, 0.2])).T + [1.0, 2.0, 3.0]
    assert local_pose_error(turned, truth) == pytest.approx(0.0, abs=1e-9)
    one = truth.copy()
    one[2, 5] += [0.0, 0.0, 2.0]
    assert reconstruction_error(one, truth) == pytest.approx(2 / np.sqrt(120))


def test_a_frozen_figure_is_compared_beside_ours(film):
    still = np.broadcast_to(film.places[0], film.places.shape)
    static = compare(still, film, "static")
    assert static["static"] > static["local_static"] > 0
    assert compare(film.places + np.array([5.0, 0, 0]), film, "")["error"] == pytest.approx(
        0.0, abs=1e-9
    )


def test_clips_that_do_not_move_are_no_tasks_and_walks_come_first(creature):
    assert moves(creature.clips[0])
    assert spread(["attack", "gallop", "idle", "walk"], 1) == ["walk"]
    assert spread(["idle"], 1) == ["idle"]


def test_a_row_knows_its_ratio_and_a_table_its_failures():
    good = Row(
        "f",
        "a",
        "walk",
        "side",
        9,
        error=0.05,
        static=0.2,
        local=0.04,
        local_static=0.1,
        tracking=0.01,
        tracking_seen=0.01,
        tracking_static=0.1,
        embedded=1.0,
        seconds=3.0,
    )
    bad = Row(
        "f", "b", "walk", "side", 9, error=0.3, static=0.2, local=0.1, local_static=0.1, warned=True
    )
    failed = Row("f", "c", "walk", "side", failure="no subject")
    assert good.ratio == pytest.approx(0.25) and failed.ratio is None
    assert "ratio 0.25" in describe(good) and "FAILED: no subject" in describe(failed)
    table = tabulate([good, bad, failed])
    cells = {str(c.header): list(c.cells) for c in table.columns}
    assert cells["clips"][0] == "3 (1 failed)"
    assert (cells["> 1"][0], cells["of these warned"][0]) == ("1", "1")
    assert cells["RE/frozen"][0] == f"{(0.25 + 1.5 + 1) / 3:.3g}"


def test_the_creature_is_measured_end_to_end(creature):
    task = Task("made", Member(Path("creature"), creature), creature.clips[0], "wave", "front", 10)
    row = measure(task)
    assert not row.failure and row.frames == 10
    assert row.tracking_seen < 0.03
    assert row.ratio < 0.6
    assert row.embedded > 0.9
