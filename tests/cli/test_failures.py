import logging
from pathlib import Path

import pytest
import typer

from bunraku.cli.failures import (
    WarningLines,
    about,
    describe_failure,
    printing_warnings,
    shorten,
)
from bunraku.errors import NOTE, Code, announce
from bunraku.types import FormatError, MatchError


def test_an_error_without_a_file_gets_one():
    with pytest.raises(FormatError, match=r"^hero\.obj: too few legs$"), about(Path("hero.obj")):
        raise ValueError("too few legs")


def test_an_error_with_a_file_keeps_it():
    with pytest.raises(FormatError, match=r"^other\.glb: /nodes/3: bad$"), about("hero.obj"):
        raise FormatError("other.glb", "/nodes/3", "bad")


def test_the_system_names_the_file_it_means():
    with pytest.raises(FormatError, match=r"^gone\.json: No such file"), about("hero.obj"):
        Path("gone.json").read_bytes()


def test_running_out_of_memory_is_the_figures_fault():
    with pytest.raises(FormatError, match=r"^hero\.obj: needs more memory"), about("hero.obj"):
        raise MemoryError


def test_exit_codes():
    empty = FormatError("a.glb", "", "is empty", code=Code.FILE_EMPTY)
    assert describe_failure(empty) == (2, "error: a.glb: is empty [FILE_EMPTY]")
    unknown = FormatError("a.glb", "", "is odd")
    assert describe_failure(unknown) == (2, "error: a.glb: is odd [INPUT]")
    assert describe_failure(MatchError("a.glb: no fit")) == (3, "error: a.glb: no fit [MATCH_POOR]")
    assert describe_failure(KeyboardInterrupt())[0] == 130
    assert describe_failure(BrokenPipeError()) == (0, "")
    code, line = describe_failure(typer.BadParameter("no such clip"))
    assert (code, line) == (2, "error: bunraku: Invalid value: no such clip. See bunraku --help")


def test_our_own_bugs_keep_their_traceback():
    with pytest.raises(AssertionError, match="cannot be"):
        describe_failure(AssertionError("cannot be"))


def test_long_lines_are_cut_in_the_middle():
    line = shorten("error: " + "x" * 500 + "\n how to fix it")
    assert len(line) == 300
    assert line.startswith("error: xxx")
    assert line.endswith("x how to fix it")
    assert " ... " in line


def test_a_warning_is_printed_once_with_its_file(capsys):
    logger = logging.getLogger("bunraku.test")
    handler = WarningLines(Path("hero.obj"), logging.WARNING)
    logger.addHandler(handler)
    try:
        for message in ("loose hat", "hero.obj: loose hat", "loose hat"):
            logger.warning(message)
        logger.info("registration")
    finally:
        logger.removeHandler(handler)
    assert capsys.readouterr().err == "warning: hero.obj: loose hat\n"


def test_a_warning_shows_its_code_and_notes_only_where_they_are_asked_for(capsys):
    path = Path("hero.obj")
    for level, count in ((logging.WARNING, 1), (NOTE, 2)):
        with printing_warnings(path, level=level):
            logging.getLogger("bunraku").setLevel(NOTE)
            announce(path, "open", code=Code.MESH_OPEN, where="/meshes/0", level=NOTE)
            announce(path, "thin", code=Code.MESH_FLAT)
        lines = capsys.readouterr().err.splitlines()
        assert lines[-1] == "warning: hero.obj: thin [MESH_FLAT]"
        assert len(lines) == count
    assert lines[0] == "warning: hero.obj: /meshes/0: open [MESH_OPEN]"
    logging.getLogger("bunraku").setLevel(logging.NOTSET)
