from bunraku.verbs import writing


def test_reports_are_json_for_people(tmp_path):
    writing.write_report(tmp_path / "report.json", {"clips": [], "confidence": 0.5})
    text = (tmp_path / "report.json").read_text()
    assert text == '{\n  "clips": [],\n  "confidence": 0.5\n}\n'
