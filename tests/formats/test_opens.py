"""No file makes a reader open another one outside its own folder: every open is watched."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bunraku
from tests.corpus.test_corpus import SHARED, shared_rows
from tests.formats.made_gltf import made_triangle

ROOT = Path(bunraku.__file__).parents[1]
HOSTILE = re.compile(r"uri_|dotdot|traversal|zip_slip|pickle|seq_object")
WATCH = """
import os, sys
from pathlib import Path
from bunraku.cli import run
from bunraku.formats import read_character, read_depth, read_figure, read_motion

opened = []
sys.addaudithook(lambda event, args: opened.append(args[0]) if event == "open" else None)
for name in sys.argv[1:]:
    opened.clear()
    run(["inspect", "--", name])
    for read in (read_figure, read_character, read_motion, read_depth):
        try:
            read(name)
        except ValueError:
            pass
    for path in {path for path in opened if isinstance(path, str | bytes)}:
        print("OPENED", name, os.path.realpath(os.fsdecode(path)), sep="\\t")
"""
OWN = (
    sys.prefix,
    str(Path(sys.prefix).resolve()),
    sys.base_prefix,
    str(ROOT / "bunraku"),
    "/proc/self",
    "/usr/share",
    "/etc/local",
)


def opened_by(names: list[Path]) -> dict[str, set[str]]:
    """Read files in a process of its own; give every path that was opened for each."""
    command = [sys.executable, "-c", WATCH, *map(str, names)]
    shown = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    opened: dict[str, set[str]] = {str(name): set() for name in names}
    for line in shown.splitlines():
        if line.startswith("OPENED\t"):
            _, name, path = line.split("\t")
            opened[name].add(path)
    return opened


def strays(name: str, opened: set[str]) -> set[str]:
    """Choose the paths that are neither in the file's folder nor Python's or our own."""
    folder = Path(name).resolve()
    folder = folder if folder.is_dir() else folder.parent
    return {
        path
        for path in opened
        if not path.startswith(OWN) and not Path(path).is_relative_to(folder)
    }


@pytest.fixture
def asset(tmp_path):
    """A folder with a secret beside it, and a link that leads there."""
    (tmp_path / "secret.bin").write_bytes(made_triangle().binary)
    folder = tmp_path / "asset"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "up").symlink_to(tmp_path)
    (folder / "inside.bin").write_bytes(made_triangle().binary)
    return folder


def test_no_uri_leads_out_of_the_folder(asset, tmp_path):
    secret = tmp_path / "secret.bin"
    uris = ["../secret.bin", "%2e%2e/secret.bin", "..%2fsecret.bin", "x/../../secret.bin"]
    uris += [str(secret), secret.as_uri(), "link.bin", "up/secret.bin", "..\\secret.bin"]
    uris += ["/etc/passwd", "file:///etc/passwd", "/dev/zero", "./inside.bin/../../secret.bin"]
    names = []
    for number, uri in enumerate([*uris, "inside.bin"]):
        made = made_triangle()
        made.glb()  # writes the buffer's length
        made.json["buffers"][0]["uri"] = uri
        made.json["images"] = [{"uri": uri}]
        names.append(asset / f"{number}.gltf")
        names[-1].write_text(json.dumps(made.json))
        names.append(asset / f"{number}.obj")
        names[-1].write_text(f"mtllib {uri}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        (asset / f"{number}.mtl").write_text(f"newmtl a\nmap_Kd {uri}\n")
        names.append(asset / f"texture{number}.obj")
        names[-1].write_text(f"mtllib {number}.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    opened = opened_by(names)
    for name, paths in opened.items():
        assert str(Path(name).resolve()) in paths  # the watch works
        assert strays(name, paths) == set()
    assert all(
        any(path.endswith("inside.bin") for path in opened[str(name)]) for name in names[-3:]
    )


@pytest.mark.skipif(not shared_rows(), reason="no adversarial corpus: set BUNRAKU_CORPUS")
def test_no_hostile_file_leads_out_of_its_folder():
    rows = [row["path"] for row in shared_rows() if HOSTILE.search(row["path"])]
    assert len(rows) > 20
    for name, paths in opened_by([SHARED / row for row in rows]).items():
        assert strays(name, paths) == set()
