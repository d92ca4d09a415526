"""Where Blender puts every vertex; run by a Python that has bpy: pose_in_blender.py < job > answer.

A job is [path, clip, [time, ...]]; the answer, for each time, all vertices in glTF's axes.
"""

import json
import sys

import bpy


def main() -> None:
    path, clip, times = json.load(sys.stdin)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.endswith(".glb"):
        bpy.ops.import_scene.gltf(filepath=path, disable_bone_shape=True)
        rate = bpy.context.scene.render.fps
    else:
        bpy.ops.wm.usd_import(filepath=path)
        rate = 30  # a frame a time code
    (rig,) = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    action = next(a for a in bpy.data.actions if a.name == clip or a.name.startswith(clip + "_"))
    for track in rig.animation_data.nla_tracks:
        track.mute = True
    rig.animation_data.action = action
    if getattr(action, "slots", None):
        rig.animation_data.action_slot = action.slots[0]
    meshes = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    answer = []
    for time in times:
        frame = time * rate
        bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
        graph = bpy.context.evaluated_depsgraph_get()
        places = []
        for thing in meshes:
            seen = thing.evaluated_get(graph)
            places += [list(seen.matrix_world @ vertex.co) for vertex in seen.to_mesh().vertices]
        answer.append([[x, z, -y] for x, y, z in places])  # Blender has Z up
    bones = [bone.name for bone in rig.data.bones]
    print("\nanswer " + json.dumps({"bones": bones, "places": answer}))


main()
