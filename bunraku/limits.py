"""How much an input may hold. Each limit is named by the message that refuses and by `--help`."""

BYTES = 2 << 30  # of one file
VERTICES = 5_000_000  # of a figure, and elements of any one array
NODES = 100_000
PIECES = 10_000  # meshes that nodes show, groups of an OBJ, solids of an STL
REPEATED = 1_000_000  # vertices of meshes that are shown again
JOINTS = 4096
FRAMES = 100_000  # of a clip
COORDINATE = 1e37  # room for products in float32, which GLB stores
PIXELS = 64_000_000  # of a picture
WEIGHTS = 1 << 27  # vertices times joints of a character: 1 GiB
JOINT_FRAMES = 10_000_000  # joints times frames of all clips together: .8 GiB

SUMMARY = (
    f"Limits: {BYTES >> 30} GiB a file, {VERTICES:,} vertices, {NODES:,} nodes, {PIECES:,} pieces, "
    f"{REPEATED:,} vertices of copies, {JOINTS:,} joints, "
    f"{FRAMES:,} frames a clip, {JOINT_FRAMES:,} joints times frames, "
    f"{WEIGHTS:,} vertices times joints, {PIXELS:,} pixels a picture."
)
