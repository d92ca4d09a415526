"""Author the clips of the built-in human and store them in bunraku/builtin/clips.npz.

How to run, after scripts/bake_human.py (needs only the package itself):

    python scripts/author_clips.py

Every clip is written as curves in scripts/choreography/: where the hips travel, how pelvis, chest
and head turn, where the feet stand and roll, how the arms hang. Legs reach their feet by inverse
kinematics, so that a planted foot stays where it is. Stored, clip after clip, are the hips'
path and one local quaternion a joint and frame, 30 frames a second; the same script gives the same
bytes.
"""

import argparse
from pathlib import Path

import numpy as np
from choreography import dancing, gaits, standing, weighty
from choreography.body import clip_arrays
from choreography.curves import RATE

OUTPUT = Path(__file__).parents[1] / "bunraku" / "builtin" / "clips.npz"
CLIPS = {
    "idle": standing.idle,
    "walk": gaits.walk,
    "run": gaits.run,
    "jump": weighty.jump,
    "wave": standing.wave_hand,
    "dance": dancing.dance,
    "sitDown": weighty.sit_down,
    "turn": standing.turn,
    "cheer": standing.cheer,
    "crouch": weighty.crouch,
    "kick": weighty.kick,
}


def main() -> None:
    """Author every clip and store them in one file."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    output = parser.parse_args().output
    authored = {name: clip_arrays(author()) for name, author in CLIPS.items()}
    np.savez(
        output,
        names=np.array(list(authored)),
        rate=np.array(RATE),
        frames=np.array([len(arrays["hips"]) for arrays in authored.values()]),
        hips=np.concatenate([a["hips"] for a in authored.values()]).astype(np.float32),
        rotations=np.concatenate([a["rotations"] for a in authored.values()]).astype(np.float32),
    )
    for name, arrays in authored.items():
        print(f"{name}: {len(arrays['hips'])} frames")


if __name__ == "__main__":
    main()
