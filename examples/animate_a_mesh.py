"""Move a mesh with the built-in human, from arrays to vertices: no file, no command line.

python examples/animate_a_mesh.py
"""

from bunraku import builtin
from bunraku.evaluate.metrics import stretch
from bunraku.formats import read_figure
from bunraku.graphs import mesh_edges
from bunraku.routes.from_rig import animate_from_rig
from bunraku.skinning import play_clip


def main() -> float:
    """Let the realistic figure walk; give how far its edges stretch."""
    human = builtin.human()
    figure = read_figure(builtin.figure_paths()["realistic"]).mesh
    walk = [clip for clip in human.clips if clip.name == "walk"]

    transfer = animate_from_rig(human, figure, clips=walk)
    print(f"confidence {transfer.confidence:.2f}, {len(transfer.character.skeleton.names)} joints")

    moved = play_clip(transfer.character, transfer.character.clips[0], slice(0, None, 10))
    print(f"{len(moved)} frames of {len(figure.vertices)} vertices")
    ratio = stretch(moved, figure.vertices, mesh_edges(figure.faces))
    print(f"99 % of edges stay below {ratio:.2f} of their length")
    return ratio


if __name__ == "__main__":
    main()
