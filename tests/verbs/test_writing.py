from dataclasses import replace

import pytest

from bunraku import builtin
from bunraku.types import FormatError
from bunraku.verbs import writing


def test_reports_are_json_for_people(tmp_path):
    writing.write_report(tmp_path / "report.json", {"clips": [], "confidence": 0.5})
    text = (tmp_path / "report.json").read_text()
    assert text == '{\n  "clips": [],\n  "confidence": 0.5\n}\n'


def test_one_motion_has_the_name_that_was_given(tmp_path):
    human = builtin.human()
    alone = replace(human, clips=human.clips[:1])
    assert writing.write_motions(tmp_path / "hero.bvh", alone) == [tmp_path / "hero.bvh"]
    assert (tmp_path / "hero.bvh").read_text().startswith("HIERARCHY\nROOT hips")


def test_several_motions_have_files_of_their_own(tmp_path):
    human = builtin.human()
    odd = replace(human.clips[1], name="walk | slow/1")
    written = writing.write_motions(
        tmp_path / "hero.bvh", replace(human, clips=(human.clips[0], odd))
    )
    assert [path.name for path in written] == ["hero-idle.bvh", "hero-walk_slow_1.bvh"]
    assert sorted(tmp_path.iterdir()) == sorted(written)


def test_no_motion_is_an_error(tmp_path):
    with pytest.raises(FormatError, match="would be empty"):
        writing.write_motions(tmp_path / "a.bvh", replace(builtin.human(), clips=()))
