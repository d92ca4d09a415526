import os
import signal
import subprocess
import sys
import time

import pytest

from bunraku.formats import files
from bunraku.formats.files import check_place, read_beside, read_bytes, write_atomically
from bunraku.types import FormatError

KILLS = 100  # moments at which a writer is killed


def test_what_is_written_is_read(tmp_path):
    write_atomically(tmp_path / "a.bin", b"abc")
    assert read_bytes(tmp_path / "a.bin") == b"abc"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_a_small_file_is_read_with_little_memory(tmp_path):
    """As in a job of a batch, whose memory is limited."""
    (tmp_path / "a.bin").write_bytes(b"abc")
    code = "import resource; from bunraku.formats.files import read_bytes; "
    code += "resource.setrlimit(resource.RLIMIT_DATA, (1 << 29, 1 << 29)); "
    code += f"print(read_bytes({str(tmp_path / 'a.bin')!r}))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout == "b'abc'\n", run.stderr


def test_a_file_that_grows_is_not_read(tmp_path, monkeypatch):
    (tmp_path / "a.bin").write_bytes(b"abc")

    def before(handle):
        seen = os.stat(handle)
        (tmp_path / "a.bin").write_bytes(b"abcdef")
        return seen

    monkeypatch.setattr(files.os, "fstat", before)
    with pytest.raises(FormatError, match="grew while it was read"):
        read_bytes(tmp_path / "a.bin")


def test_a_new_file_has_the_mode_that_open_gives(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_atomically(tmp_path / "written", b"")
    assert (tmp_path / "written").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    (tmp_path / "a.bin").write_bytes(b"old")

    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(FormatError, match=r"a\.bin: cannot be written \(No space left on device"):
        write_atomically(tmp_path / "a.bin", b"new")
    assert os.listdir(tmp_path) == ["a.bin"]
    assert (tmp_path / "a.bin").read_bytes() == b"old"


@pytest.mark.parametrize("nameless", [True, False])
@pytest.mark.parametrize("old", [b"", b"old"])
def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch, nameless, old):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    if old:
        (tmp_path / "a.bin").write_bytes(old)
    if not nameless:
        monkeypatch.setattr(files, "_open_nameless", lambda folder: None)
    monkeypatch.setattr(files.os, "replace", interrupt)
    monkeypatch.setattr(files.os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "a.bin", b"new")
    monkeypatch.undo()
    assert os.listdir(tmp_path) == (["a.bin"] if old else [])
    assert not old or (tmp_path / "a.bin").read_bytes() == old


@pytest.mark.parametrize("nameless", [True, False])
def test_old_and_new_files_are_written_whole(tmp_path, monkeypatch, nameless):
    if not nameless:
        monkeypatch.setattr(files, "_open_nameless", lambda folder: None)
    for content in (b"first", b"second"):
        write_atomically(tmp_path / "a.bin", content)
        assert (tmp_path / "a.bin").read_bytes() == content
    check_place(tmp_path / "b.bin")
    assert os.listdir(tmp_path) == ["a.bin"]


def test_a_link_is_written_through(tmp_path):
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    write_atomically(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"new"


def test_unwritable_places_are_named(tmp_path):
    (tmp_path / "file").write_bytes(b"x")
    os.mkfifo(tmp_path / "pipe")
    for place, message in (
        (tmp_path, "is a folder; name a file to write"),
        (tmp_path / "no" / "a.glb", "its folder does not exist"),
        (tmp_path / "file" / "a.glb", "its folder is a file"),
        (tmp_path / "pipe", "is a device or pipe"),
        (str(tmp_path / "nul") + "\0", "cannot be a file name"),
    ):
        with pytest.raises(FormatError, match=message):
            write_atomically(place, b"x")


def test_unreadable_places_are_named(tmp_path):
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "large").write_bytes(b"12345")
    for place, message in (
        (tmp_path / "none", "does not exist"),
        (tmp_path, "is a folder"),
        (tmp_path / "empty", r"is empty \(0 bytes\)"),
        (tmp_path / "large", "has 5 bytes, more than the 4 allowed"),
        ("/dev/zero", "is a device or pipe"),
        ("a\0b", "cannot be a file name"),
    ):
        with pytest.raises(FormatError, match=message):
            read_bytes(place, limit=4)


def test_a_file_beside_is_found_by_its_escaped_name(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "my map.png").write_bytes(b"png")
    assert read_beside(tmp_path / "a.obj", "maps/my%20map.png") == b"png"


@pytest.mark.parametrize(
    "uri",
    [
        "../secret",
        "%2e%2e/secret",
        "/etc/hostname",
        "file:///etc/hostname",
        "http://example.org/a",
        "maps\\a.png",
        "a\0b",
        "a\nb",
        "link",
    ],
)
def test_nothing_outside_the_folder_is_read(tmp_path, uri):
    (tmp_path / "secret").write_bytes(b"secret")
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link").symlink_to("../secret")
    with pytest.raises(FormatError, match="only a relative path inside its folder is read"):
        read_beside(inside / "a.obj", uri, where="line 3")


def test_a_missing_file_beside_is_told_of_the_file_that_names_it(tmp_path):
    with pytest.raises(FormatError, match=r"a\.obj: line 3: refers to 'b\.mtl', which is missing"):
        read_beside(tmp_path / "a.obj", "b.mtl", where="line 3")
    (tmp_path / "b.mtl").write_bytes(b"")
    with pytest.raises(FormatError, match=r"a\.obj: refers to 'b\.mtl', which is empty"):
        read_beside(tmp_path / "a.obj", "b.mtl")
    with pytest.raises(FormatError, match="refers to 'aaaa"):
        read_beside(tmp_path / "a.obj", "a" * 5000)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_hundred_kills_tear_lose_and_leave_nothing(tmp_path, rng):
    """A child writes file after file and is killed at a random moment, over and over."""
    for number in range(KILLS):
        folder = tmp_path / str(number)
        folder.mkdir()
        child = os.fork()
        if child == 0:
            try:
                for count in range(10**9):
                    write_atomically(folder / f"{count}.bin", bytes([count % 7 + 1]) * 300_000)
            finally:
                os._exit(1)
        while not (folder / "0.bin").exists():  # on a busy machine it may not have begun
            time.sleep(0.001)
        time.sleep(rng.uniform(0.0, 0.05))
        os.kill(child, signal.SIGKILL)
        assert os.waitpid(child, 0)[1] == signal.SIGKILL
        for path in folder.iterdir():
            assert path.name == f"{int(path.stem)}.bin", "a left-over file"
            whole = bytes([int(path.stem) % 7 + 1]) * 300_000
            assert path.read_bytes() == whole, "a torn file"
    assert sum(1 for _ in tmp_path.glob("*/*.bin")) >= KILLS
