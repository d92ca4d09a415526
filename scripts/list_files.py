"""Write the file tree of README.md anew: one line a file, from the first line of its docstring.

python scripts/list_files.py
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
ORDER = (
    *("types", "errors", "limits", "rotations", "skinning", "meshes", "spectral", "graphs"),
    *("proxy", "matching", "registration", "weights", "skeletons", "reposing", "standing"),
    *(
        "depth",
        "curves",
        "bones",
        "embedding",
        "retargeting",
        "adjusting",
        "contacts",
        "humanoids",
        "routes",
    ),
    *("formats", "builtin", "evaluate", "verbs", "batching", "cli", "studio"),
)  # the layers, lowest first; whatever is not named comes last
BEGIN, END = "<!-- files: scripts/list_files.py -->\n```\n", "```\n<!-- end of files -->"
WIDTH = 28


def describe(path: Path) -> str:
    """Give the first sentence of a file's docstring."""
    documented = ast.get_docstring(ast.parse(path.read_text())) or ""
    return " ".join(documented.split("\n\n")[0].split()).rstrip(".")


def rank(path: Path) -> tuple[int, str]:
    """Order the parts of the package by layer, then by name."""
    return (ORDER.index(path.stem) if path.stem in ORDER else len(ORDER)), path.name


def list_folder(folder: Path, depth: int) -> Iterator[str]:
    """List the modules of a folder and of the packages in it."""
    for path in sorted(folder.iterdir(), key=rank):
        inner = path / "__init__.py"
        if path.suffix == ".py" and path.stem != "__init__":
            yield f"{'  ' * depth + path.name:<{WIDTH}}{describe(path)}".rstrip()
        elif inner.exists():
            yield f"{'  ' * depth + path.name + '/':<{WIDTH}}{describe(inner)}".rstrip()
            yield from list_folder(path, depth + 1)


def main() -> None:
    """Replace the tree in README.md."""
    lines = []
    for name in ("bunraku", "bench", "examples", "scripts"):
        lines += [f"{name}/", *list_folder(ROOT / name, 1)]
    readme = ROOT / "README.md"
    text = readme.read_text()
    before, after = text.index(BEGIN) + len(BEGIN), text.index(END)
    readme.write_text(text[:before] + "\n".join(lines) + "\n" + text[after:])


if __name__ == "__main__":
    main()
