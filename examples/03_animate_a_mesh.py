"""Move a mesh with the built-in human, from arrays to vertices: no file, no command line.

python examples/03_animate_a_mesh.py
"""

import bunraku
from bunraku import builtin
from bunraku.evaluate.metrics import stretch
from bunraku.graphs import mesh_edges
from bunraku.skinning import play_clip


def main() -> float:
    """Let the realistic figure walk; give how far its edges stretch."""
    figure = bunraku.read(builtin.figure_paths()["realistic"]).mesh
    result = bunraku.animate(figure, builtin.human(), ["walk"])
    print(f"confidence {result.confidence:.2f}, {len(result.character.skeleton.names)} joints")

    moved = play_clip(result.character, result.character.clips[0], slice(0, None, 10))
    print(f"{len(moved)} frames of {len(figure.vertices)} vertices")
    ratio = stretch(moved, figure.vertices, mesh_edges(figure.faces))
    print(f"99 % of edges stay below {ratio:.2f} of their length")
    return ratio


if __name__ == "__main__":
    main()
