from bunraku.cli import run, showing


def test_a_file_cannot_hold_the_demo(tmp_path, capsys):
    (tmp_path / "demo").write_text("a file")
    assert run(["demo", "-o", str(tmp_path / "demo")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_report_becomes_one_line():
    clip = {"stretch_p99": 1.2, "foot_slide_m": 0.1, "penetration_fraction": 0.0}
    report = {
        "figure": {"vertices": 9, "parts": 2},
        "clips": [clip, {**clip, "stretch_p99": 1.5}],
        "seconds": {"total": 3.0},
        "confidence": 0.9,
    }
    assert showing.summarise(report) == ["9", "2", "2", 3.0, 0.9, 1.5, 0.1, 0.0]
