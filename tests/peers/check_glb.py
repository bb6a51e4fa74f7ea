"""Loads models with pygltflib and trimesh and says what is in them: check_glb.py FILE..."""

import json
import sys

import pygltflib
import trimesh

found = {}
for path in sys.argv[1:]:
    document = pygltflib.GLTF2().load(path)
    scene = trimesh.load(path, force="scene")
    low, high = scene.bounds
    found[path.split("/")[-1]] = {
        "nodes": [node.name for node in document.nodes],
        "materials": [material.name for material in document.materials],
        "size": [float(b - a) for a, b in zip(low, high)],
        "triangles": int(sum(len(scene.geometry[scene.graph[n][1]].faces) for n in scene.graph.nodes_geometry)),
    }
print(json.dumps(found))
