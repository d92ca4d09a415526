"""Give a file a skeleton, a skin and two clips, as `bunraku animate` does.

python examples/01_animate_a_file.py
"""

import tempfile
from pathlib import Path

import bunraku
from bunraku import builtin


def main() -> float:
    """Animate the stylised figure; give how many seconds it moves."""
    figure = builtin.figure_paths()["stylised"]
    result = bunraku.animate(figure, clips=["walk", "wave"])
    with tempfile.TemporaryDirectory() as folder:
        moving = Path(folder) / "moving.glb"
        bunraku.write(moving, result)
        bunraku.write(moving.with_suffix(".json"), result)
        written = bunraku.read_performer(moving)
    for clip in written.clips:
        print(f"{clip.name}: {clip.times[-1]:.1f} s, {len(clip.times)} frames")
    print(f"confidence {result.confidence:.2f}", *result.warnings, sep="\n")
    return float(sum(clip.times[-1] for clip in written.clips))


if __name__ == "__main__":
    main()
