"""Do with a wheel what a stranger does: install it into an empty environment and run the demo.

python scripts/check_wheel.py dist/*.whl

Fails if anything does, or if wheel, installation or import are larger or slower than promised.
"""

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

LARGEST_WHEEL, LARGEST_INSTALLATION = 30e6, 350e6  # bytes on disk
SLOWEST_IMPORT = 0.15  # seconds of the processor
CONSTRAINTS = Path(__file__).parents[1] / "constraints.txt"
TIMER = "import time; b = time.process_time(); import bunraku; print(time.process_time() - b)"


def measure_folder(folder: Path) -> int:
    """Add up what the files of a folder take on the disk, each once."""
    seen = {}
    for path in folder.rglob("*"):
        if path.is_file() and not path.is_symlink():
            status = path.stat()
            seen[status.st_ino] = 512 * status.st_blocks
    return sum(seen.values())


def install(wheel: Path, folder: Path) -> tuple[Path, int]:
    """Make an environment with the wheel and what it asks for.

    Returns:
        its folder of programs, and the bytes that the installation added.
    """
    venv.create(folder, with_pip=True, symlinks=True)
    programs, before = folder / "bin", measure_folder(folder)
    options = ["--quiet", "--disable-pip-version-check", "-c", str(CONSTRAINTS)]
    subprocess.run([programs / "python", "-m", "pip", "install", *options, wheel], check=True)
    return programs, measure_folder(folder) - before


def main() -> None:
    """Check one wheel."""
    wheel = Path(sys.argv[1]).resolve()
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        programs, size = install(wheel, place / "environment")
        times = [
            subprocess.run(
                [programs / "python", "-c", TIMER], cwd=place, env=clean, capture_output=True
            ).stdout
            for _ in range(3)
        ]
        seconds = min(map(float, times))
        command = [programs / "bunraku", "demo", "-o", "demo"]
        subprocess.run(command, cwd=place, env=clean, check=True)
        made = sorted(path.name for path in (place / "demo").iterdir())
    print(f"wheel {wheel.stat().st_size / 1e6:.1f} MB, {size / 1e6:.0f} MB installed")
    print(f"import {seconds:.3f} s; the demo made {', '.join(made)}")
    assert wheel.stat().st_size <= LARGEST_WHEEL
    assert size <= LARGEST_INSTALLATION
    assert seconds <= SLOWEST_IMPORT
    assert {"demo.png", "realistic.glb", "stylised.glb"} <= set(made)


if __name__ == "__main__":
    main()
