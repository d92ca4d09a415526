"""The options that commands share, each explained once."""

from pathlib import Path
from typing import Annotated

import typer


def print_version(wanted: bool | None) -> None:
    """Print the version and stop, if that was asked."""
    if wanted:
        from bunraku import __version__

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
        help="What is to move: .glb .gltf .vrm .fbx .obj .ply .stl .off. A rig in it is replaced.",
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
        help="A rigged character (.glb .gltf .vrm .fbx), a folder of depth frames, a folder of an "
        "avatar (rest.obj and its poses), or a motion (.bvh) for the built-in human. Without it: "
        "the built-in human and its clips.",
        show_default=False,
    ),
]
CharacterOption = Annotated[
    Path | None,
    typer.Option(
        "--with",
        metavar="CHARACTER",
        help="A rigged character (.glb .gltf .vrm .fbx). Without it: the built-in human.",
        show_default=False,
    ),
]
RestOption = Annotated[
    Path,
    typer.Option(
        "--rest",
        metavar="AVATAR",
        help="A person or quadruped at rest, in about the figure's rest pose, any mesh file.",
        show_default=False,
    ),
]
PosedOption = Annotated[
    list[Path],
    typer.Option(
        "--posed",
        metavar="AVATAR",
        help="The same mesh posed, its vertices in the same order; several make a clip.",
        show_default=False,
    ),
]
RateOption = Annotated[float, typer.Option("--rate", metavar="N", help="Poses a second.")]
NetworkOption = Annotated[
    Path | None,
    typer.Option(
        "--network",
        metavar="FILE.safetensors",
        help="Weights that bunraku train shape wrote. Without it: the built-in ones.",
        show_default=False,
    ),
]
WeightsOption = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--out",
        metavar="FILE.safetensors",
        help="Weights to write. Without it: in the user's cache folder.",
        show_default=False,
    ),
]
BeginOption = Annotated[
    Path | None,
    typer.Option(
        "--from",
        metavar="FILE.safetensors",
        help="Weights to begin with, for other bodies; the course is shorter then.",
        show_default=False,
    ),
]
KindOption = Annotated[
    str, typer.Option("--kind", metavar="KIND", help="What to train for: person or quadruped.")
]
DeformOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--deform",
        metavar="FILE.safetensors",
        help="Weights that bunraku train deform wrote, for rows of the paper's form; one a kind.",
        show_default=False,
    ),
]
UntilOption = Annotated[
    int | None,
    typer.Option(
        "--until", metavar="N", min=1, help="End the course at this step, and write the weights."
    ),
]
SeedsOption = Annotated[
    int, typer.Option("--seeds", metavar="N", min=1, help="How often bodies are generated anew.")
]
MinutesOption = Annotated[
    float | None,
    typer.Option("--minutes", metavar="N", help="Stop after so long; --resume goes on."),
]
ResumeTrainingOption = Annotated[
    bool, typer.Option("--resume", help="Go on from the checkpoint beside the weights.")
]
StepsOption = Annotated[
    int | None,
    typer.Option(
        "--steps", metavar="N", min=1, help="Length of the course; another one is another result."
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
BvhOption = Annotated[
    Path | None,
    typer.Option(
        "--bvh",
        metavar="OUT.bvh",
        help="Write the motion too; several clips become OUT-CLIP.bvh each.",
    ),
]
VrmOption = Annotated[
    bool, typer.Option("--vrm", help="Say which joint is which bone of a human, by VRM 1.0.")
]
EngineOption = Annotated[
    str | None,
    typer.Option(
        "--for",
        metavar="ENGINE",
        help="Joint and clip names of blender, godot, unity or unreal; a root joint where it is "
        "wanted.",
    ),
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
ContactsOption = Annotated[
    bool,
    typer.Option(
        " /--no-contacts",
        help="Let feet go where the copied turns take them; else planted feet stay planted.",
        show_default=False,
    ),
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
BaselinesOption = Annotated[
    bool, typer.Option("--baselines", help="The paper's settings and other methods as rows too.")
]
StateOption = Annotated[
    Path | None,
    typer.Option("--state", metavar="ROWS.jsonl", help="Keep rows here, and resume from here."),
]
JobsArgument = Annotated[
    Path,
    typer.Argument(
        metavar="JOBS.csv",
        help="A figure a line: columns figure, performance, clips (a;b), and options of animate.",
        show_default=False,
    ),
]
ResultsOption = Annotated[
    Path,
    typer.Option("-o", "--out", metavar="FOLDER", help="For the results.", show_default=False),
]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", min=1, help="Jobs at a time; one a core, by default.")
]
ClusterOption = Annotated[
    str | None,
    typer.Option("--cluster", metavar="URL", help="A Dask scheduler, such as tcp://host:8786."),
]
ResumeOption = Annotated[bool, typer.Option("--resume", help="Do only what is missing.")]
MemoryOption = Annotated[
    float, typer.Option("--memory", min=0.1, help="Gigabytes that one job may use.")
]
TimeoutOption = Annotated[
    float, typer.Option("--timeout", min=0.1, help="Seconds that one job may take.")
]
OfferedOption = Annotated[
    Path | None,
    typer.Argument(metavar="[FIGURE]", help="Offered first, beside the built-in figures."),
]
PortOption = Annotated[int, typer.Option("--port", min=0, max=65535, help="Of the page.")]
HostOption = Annotated[
    str,
    typer.Option("--host", help="Address to listen at; others than this machine's let others in."),
]
