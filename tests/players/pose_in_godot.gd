# Where Godot 3 puts every joint of res://figure.glb; run by tests/players/test_godot.py.
# user arguments: the clip's name, then times; the answer is a line of JSON.
extends SceneTree


func find(node, kind):
	if node.is_class(kind):
		return node
	for child in node.get_children():
		var found = find(child, kind)
		if found:
			return found
	return null


func _init():
	var job = JSON.parse(OS.get_environment("BUNRAKU_JOB")).result
	var scene = load("res://figure.glb").instance()
	get_root().add_child(scene)
	var player = find(scene, "AnimationPlayer")
	var skeleton = find(scene, "Skeleton")
	var names = []
	for bone in range(skeleton.get_bone_count()):
		names.append(skeleton.get_bone_name(bone))
	player.assigned_animation = job["clip"]
	var poses = []
	for time in job["times"]:
		player.seek(time, true)
		var joints = []
		for bone in range(skeleton.get_bone_count()):
			var pose = skeleton.get_bone_global_pose(bone)
			var parent = skeleton
			while parent is Spatial and parent != get_root():
				pose = parent.transform * pose
				parent = parent.get_parent()
			var b = pose.basis
			joints.append([
				[b.x.x, b.y.x, b.z.x, pose.origin.x],
				[b.x.y, b.y.y, b.z.y, pose.origin.y],
				[b.x.z, b.y.z, b.z.z, pose.origin.z],
				[0, 0, 0, 1],
			])
		poses.append(joints)
	var loops = player.get_animation(job["clip"]).loop
	print("answer ", JSON.print({"names": names, "poses": poses, "loops": loops}))
	quit()
