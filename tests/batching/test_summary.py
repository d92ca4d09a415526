import csv
import re

import msgspec

from bunraku.batching.jobs import Job
from bunraku.batching.records import Record
from bunraku.batching.summary import sort_worst_first, write_page, write_table


def make_record(name, state="done", confidence=0.0, **more):
    clips = [{"name": "a", "stretch_p99": 1.5, "foot_slide_m": 0, "penetration_fraction": 0}]
    report = {
        key: msgspec.Raw(msgspec.json.encode(value))
        for key, value in {"confidence": confidence, "clips": clips}.items()
    }
    job = Job(figure=f"/figures/{name}.obj")
    return Record(name=name, job=job, state=state, report=report if state == "done" else {}, **more)


RECORDS = [
    make_record("good", confidence=0.9),
    make_record("torn", state="bad input", error="error: torn.obj: <line 2>, cut off"),
    make_record("poor", confidence=0.2),
]


def test_the_worst_come_first():
    assert [record.name for record in sort_worst_first(RECORDS)] == ["torn", "poor", "good"]


def test_the_table_keeps_the_order_of_the_jobs(tmp_path):
    write_table(tmp_path / "results.csv", RECORDS)
    with (tmp_path / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["state"] for row in rows] == ["done", "bad input", "done"]
    assert rows[0]["confidence"] == "0.900"
    assert rows[0]["stretch_p99"] == "1.5"
    assert rows[0]["output"] == "results/good.glb"
    assert rows[1]["note"] == "error: torn.obj: <line 2>, cut off"
    assert rows[1]["output"] == rows[1]["confidence"] == ""


def test_the_page_has_a_picture_of_each_figure_that_moves(tmp_path):
    write_page(tmp_path / "index.html", RECORDS)
    page = (tmp_path / "index.html").read_text()
    assert "2 of 3 figures move" in page
    assert re.findall('src="(.*?)"', page) == ["results/poor.png", "results/good.png"]
    assert "&lt;line 2&gt;" in page
    assert "http" not in page  # nothing comes from elsewhere
