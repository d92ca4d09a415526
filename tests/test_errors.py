import ast
import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import bunraku
from bunraku.cli.failures import printing_warnings
from bunraku.errors import NOTE, Code, announce, collecting_doubts, doubt
from scripts.list_errors import PAGE, write_page

SOURCES = sorted(Path(bunraku.__file__).parent.rglob("*.py"))
RAISING = {"FormatError", "fault", "trouble", "warn", "announce"}


def calls(path: Path) -> list[ast.Call]:
    """Find where a file raises or announces a fault."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name in RAISING:
                found.append(node)
    return found


def test_the_page_lists_every_code():
    assert PAGE.read_text() == write_page(), "run python scripts/list_errors.py"


def test_names_and_meanings_are_there_once():
    assert len({code.value for code in Code}) == len(Code.__members__)
    for code in Code:
        assert code.name == code.name.upper()
        assert "|" not in code.value


def test_every_code_is_used():
    text = "".join(path.read_text() for path in SOURCES if path.name != "errors.py")
    assert [code.name for code in Code if f"Code.{code.name}" not in text] == []


@pytest.mark.parametrize(
    "path",
    [path for path in SOURCES if path.parent.name in ("formats", "gltf", "fbx")],
    ids=lambda path: path.name,
)
def test_readers_and_writers_give_every_fault_a_code(path):
    for call in calls(path):
        assert any(keyword.arg == "code" for keyword in call.keywords), f"line {call.lineno}"


def test_an_announcement_carries_its_parts(caplog):
    with caplog.at_level(NOTE):
        announce("a.obj", "is thin", code=Code.MESH_FLAT, where="line 3", level=NOTE)
    (record,) = caplog.records
    assert record.getMessage() == "a.obj: line 3: is thin"
    assert (record.code, record.where, record.found) == (Code.MESH_FLAT, "line 3", "is thin")
    assert logging.INFO < record.levelno < logging.WARNING


def test_doubts_are_collected_once_and_named_by_who_prints_them(capsys):
    with printing_warnings(Path("a.obj")), collecting_doubts() as doubts:
        doubt("travel is a guess")
        doubt("travel is a guess")
        announce("a.obj", "fits poorly", code=Code.MATCH_DOUBTFUL)
    assert doubts == ["travel is a guess"]
    first, second = capsys.readouterr().err.splitlines()
    assert first == "warning: a.obj: travel is a guess [MATCH_DOUBTFUL]"
    assert second == "warning: a.obj: fits poorly [MATCH_DOUBTFUL]"


def test_doubts_are_collected_by_the_thread_that_has_them_and_where_logging_is_quiet():
    both = threading.Barrier(2)

    def collect(name: str) -> list[str]:
        with collecting_doubts() as doubts:
            both.wait(10)
            doubt(name)
            both.wait(10)
        return doubts

    logging.disable()
    try:
        with ThreadPoolExecutor(2) as pool:
            assert list(pool.map(collect, ["left", "right"])) == [["left"], ["right"]]
    finally:
        logging.disable(logging.NOTSET)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_no_warning_goes_without_a_code(path):
    text = path.read_text()
    if path.parent.name not in ("evaluate", "bunraku") or path.name == "standing.py":
        assert "logger.warning(" not in text
