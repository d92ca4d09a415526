"""The options that commands share, each explained once."""

from pathlib import Path
from typing import Annotated

import typer

from bunraku import __version__


def print_version(wanted: bool | None) -> None:
    """Print the version and stop, if that was asked."""
    if wanted:
        typer.echo(f"bunraku {__version__}")
        raise typer.Exit


VersionOption = Annotated[
    bool | None,
    typer.Option("--version", callback=print_version, is_eager=True, help="Print the version."),
]
FileArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="Any file of the formats above, or a .bvh.")
]
FolderOption = Annotated[
    Path, typer.Option("-o", "--out", metavar="FOLDER", help="Where the results go.")
]
InspectJsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
FigureArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FIGURE",
        help="What is to move: .glb .gltf .vrm .obj .ply .stl .off. A rig in it is replaced.",
        show_default=False,
    ),
]
DepthArgument = Annotated[
    Path,
    typer.Argument(
        metavar="DEPTH_FOLDER",
        help="NNNN.png in 16 bits, intrinsics.json, and mask/NNNN.png if you have them.",
        show_default=False,
    ),
]
WithOption = Annotated[
    Path | None,
    typer.Option(
        "--with",
        metavar="PERFORMANCE",
        help="A rigged character (.glb .gltf .vrm), a folder of depth frames, or a motion (.bvh) "
        "for the built-in human. Without it: the built-in human and its clips.",
        show_default=False,
    ),
]
CharacterOption = Annotated[
    Path | None,
    typer.Option(
        "--with",
        metavar="CHARACTER",
        help="A rigged character (.glb .gltf .vrm). Without it: the built-in human.",
        show_default=False,
    ),
]
ClipOption = Annotated[
    list[str] | None,
    typer.Option(
        "--clip", metavar="NAME", help="A clip to keep; repeat for more. All, if none is named."
    ),
]
OutOption = Annotated[
    Path, typer.Option("-o", "--out", metavar="OUT", help="File to write.", show_default=False)
]
ReportOption = Annotated[
    Path | None,
    typer.Option("--report", metavar="OUT.json", help="Write how far to trust the result."),
]
LandmarksOption = Annotated[
    Path | None,
    typer.Option(
        "--landmarks",
        metavar="FILE.json",
        help='Never needed: {"joint name": [x, y, z], ...}, where some of the performance\'s '
        "joints are, in the coordinates of the figure's file.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="The same seed, the same bytes.")]
UpOption = Annotated[
    str | None,
    typer.Option("--up", metavar="y|z", help="The figure's up axis, if its format does not say."),
]
FacingOption = Annotated[
    str | None,
    typer.Option("--facing", metavar="AXIS", help="Where the figure looks: +z -z +x -x +y -y."),
]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Write the result even if the match is poor.")
]
DataOption = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="FOLDER",
        help="Evaluation data; otherwise BUNRAKU_DATA, or ../shared/data.",
    ),
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="OUT", help="Write every row as JSON.")
]
PairsOption = Annotated[
    list[str] | None,
    typer.Option("--pairs", metavar="TEXT", help="Only rows with this in 'folder/Source>Target'."),
]
ClipsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--pairs", metavar="TEXT", help="Only rows with this in 'folder/Character:clip:camera'."
    ),
]
LimitOption = Annotated[
    int | None, typer.Option("--limit", min=1, help="At most so many rows, from every family.")
]
ThoroughOption = Annotated[
    bool, typer.Option("--thorough", help="All clips and 30 frames each, not 3 clips and 8 frames.")
]
StateOption = Annotated[
    Path | None,
    typer.Option("--state", metavar="ROWS.jsonl", help="Keep rows here, and resume from here."),
]
