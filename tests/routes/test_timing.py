import logging

from bunraku.routes.timing import Stopwatch


def test_stages_are_kept_in_order_and_add_up(caplog):
    watch = Stopwatch()
    with caplog.at_level(logging.INFO):
        for stage in ("proxy", "map", "proxy"):
            watch.begin(stage)
    seconds = watch.end()
    assert list(seconds) == ["proxy", "map"]
    assert min(seconds.values()) >= 0
    assert [record.message for record in caplog.records] == ["proxy", "map", "proxy"]


def test_after_the_end_no_stage_runs_on():
    watch = Stopwatch()
    watch.begin("proxy")
    before = dict(watch.end())
    assert watch.end() == before
