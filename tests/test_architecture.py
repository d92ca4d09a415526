"""Imports point one way, and heavy packages stay where they belong."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import bunraku

ROOT = Path(bunraku.__file__).parent
NOUNS = {"types", "errors", "limits"}
ARITHMETIC = {"rotations", "skinning", "meshes", "spectral", "graphs"}
BORDERS = {"formats", "builtin"}  # see nouns and arithmetic; algorithms and routes never see them
LAYERS = [
    NOUNS,
    ARITHMETIC,
    BORDERS,
    {
        *{"proxy", "matching", "registration", "weights", "skeletons", "reposing"},
        *{"depth", "curves", "bones", "embedding", "standing", "retargeting", "humanoids"},
        "contacts",
        "adjusting",
    },
    {"neural"},
    {"routes"},
    {"evaluate"},
    {"verbs"},
    {"batching"},
    {"cli", "studio"},
]  # a module imports from its own layer and earlier ones
ROUTES = LAYERS.index({"routes"})
HEAVY = {"torch": {"neural"}, "typer": {"cli"}, "rich": {"cli", "evaluate"}, "anny": {"neural"}}
VERBS = {"__all__", *bunraku.__all__}  # of the package itself: for the highest layer alone
FILES = sorted(
    path for path in ROOT.rglob("*.py") if path.stem != "__init__" or path.parent != ROOT
)


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
            names |= {"bunraku.__all__" for alias in node.names if alias.name == "bunraku"}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, f"{path} imports by dots, which hides layers"
            names.add(node.module)
            if node.module == "bunraku":
                names |= {f"bunraku.{alias.name}" for alias in node.names}
    return names - {"bunraku"}


def top(path: Path) -> str:
    return path.relative_to(ROOT).with_suffix("").parts[0]


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", FILES, ids=name)
def test_imports_point_one_way(path):
    rank = {name: i for i, layer in enumerate(LAYERS) for name in layer}
    for imports in imported(path):
        package, _, rest = imports.partition(".")
        if rest in VERBS:
            assert rank[top(path)] == len(LAYERS) - 1, f"{top(path)} imports the whole package"
        elif package == "bunraku" and rest != "__version__":
            inner = rest.split(".")[0]
            assert rank[inner] <= rank[top(path)], f"{top(path)} imports {imports}"
            if top(path) in BORDERS:
                assert inner in {*NOUNS, *ARITHMETIC, top(path)}, f"{top(path)} imports {imports}"
            elif rank[top(path)] <= ROUTES:
                assert inner not in BORDERS, f"{top(path)} reads files itself: {imports}"


@pytest.mark.parametrize("path", FILES, ids=name)
def test_heavy_packages_stay_in_their_rooms(path):
    for imports in imported(path):
        package = imports.split(".")[0]
        assert top(path) in HEAVY.get(package, {top(path)}), f"{top(path)} imports {package}"


@pytest.mark.parametrize("path", FILES, ids=name)
def test_files_and_functions_stay_small(path):
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            documented = len((ast.get_docstring(node) or "").splitlines())
            size = node.end_lineno - node.lineno + 1 - documented
            assert size <= 60, f"{node.name} has {size} lines"


@pytest.mark.parametrize("path", sorted((ROOT / "routes").glob("from_*.py")), ids=name)
def test_routes_read_on_one_screen_or_two(path):
    assert len(path.read_text().splitlines()) < 120


@pytest.mark.parametrize("module", ["bunraku", "bunraku.cli"])
def test_the_program_starts_before_anything_is_computed(module):
    """Help answers at once: what a command needs is imported when it runs."""
    look = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert module in loaded
    assert not loaded & {"numpy", "scipy", "igl", "jaxtyping", "bunraku.types", "bunraku.formats"}


def test_every_file_has_its_line_in_the_readme():
    tree = (ROOT.parent / "README.md").read_text()
    named = {path.name for path in FILES if path.stem != "__init__"}
    assert {name for name in named if f" {name} " not in tree} == set()
