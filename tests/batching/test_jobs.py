import pytest

from bunraku.batching.jobs import Job, name_result, read_jobs
from bunraku.types import FormatError


def write(folder, text):
    path = folder / "jobs.csv"
    path.write_text(text)
    return path


def test_a_line_is_a_job(tmp_path):
    header = "figure, performance ,clips,seed,force,up\n"
    path = write(tmp_path, header + 'hero.obj,dance.bvh,"walk; run",3,Yes,z\n\n/far/cat.glb,,,,,\n')
    hero, cat = read_jobs(path)
    assert hero == Job(
        figure=str(tmp_path / "hero.obj"),
        performance=str(tmp_path / "dance.bvh"),
        clips=("walk", "run"),
        seed=3,
        force=True,
        up="z",
    )
    assert cat == Job(figure="/far/cat.glb")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("figure,colour\na,b\n", "line 1: unknown column 'colour'; there are figure, performance"),
        ("performance\na\n", "line 1: has no column 'figure'"),
        ("figure\n", "line 2: there are no jobs"),
        ("figure,seed\na,1\nb,one\n", "line 3: seed: Expected int"),
        ("figure,force\na,maybe\n", "line 2: force: 'maybe' is neither yes nor no"),
        ("figure,seed\n,1\n", "line 2: names no figure"),
        ("figure,seed\na,1,2\n", "line 2: has more cells than line 1"),
    ],
)
def test_errors_name_the_line(tmp_path, text, words):
    with pytest.raises(FormatError, match=rf"jobs\.csv: {words}"):
        read_jobs(write(tmp_path, text))


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "jobs.csv"
    path.write_bytes(b"figure\n\xff\xfe")
    with pytest.raises(FormatError, match="is no UTF-8 text"):
        read_jobs(path)


def test_names_follow_content_not_place(tmp_path):
    one, other = tmp_path / "a hero.obj", tmp_path / "other"
    other.mkdir()
    one.write_text("v 0 0 0\n")
    (other / one.name).write_text("v 0 0 0\n")
    name = name_result(Job(figure=str(one)))
    assert name.startswith("a_hero-")
    assert name == name_result(Job(figure=str(other / one.name)))
    assert name != name_result(Job(figure=str(one), seed=1))
    assert name != name_result(Job(figure=str(one), performance=str(one)))
    one.write_text("v 0 0 1\n")
    assert name != name_result(Job(figure=str(one)))


@pytest.mark.parametrize(
    ("figure", "text", "beside"),
    [
        ("a.gltf", '{"buffers": [{"uri": "a.bin"}], "images": [{"uri": "data:,x"}]}', "a.bin"),
        ("a.obj", "mtllib a.mtl\nv 0 0 0\n", "a.mtl"),
    ],
)
def test_names_follow_files_beside_the_figure_too(tmp_path, figure, text, beside):
    (tmp_path / figure).write_text(text)
    job = Job(figure=str(tmp_path / figure))
    names = {name_result(job)}
    for content in ("old", "new"):
        (tmp_path / beside).write_text(content)
        names.add(name_result(job))
    assert len(names) == 3


def test_a_missing_file_has_a_name_until_it_comes(tmp_path):
    job = Job(figure=str(tmp_path / "late.obj"))
    before = name_result(job)
    assert before == name_result(job)
    (tmp_path / "late.obj").write_text("v 0 0 0\n")
    assert before != name_result(job)


def test_names_follow_every_frame_of_a_depth_video(tmp_path):
    (tmp_path / "hero.obj").write_text("v 0 0 0\n")
    (tmp_path / "film" / "mask").mkdir(parents=True)
    for name in ("0000.png", "intrinsics.json", "mask/0000.png"):
        (tmp_path / "film" / name).write_bytes(b"old")
    job = Job(figure=str(tmp_path / "hero.obj"), performance=str(tmp_path / "film"))
    names = {name_result(job)}
    for name in ("0000.png", "intrinsics.json", "mask/0000.png"):
        (tmp_path / "film" / name).write_bytes(b"new")
        names.add(name_result(job))
    assert len(names) == 4
