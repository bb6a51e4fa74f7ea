"""Writes a car and a building with trimesh: make_glb.py FOLDER."""

import sys
from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial

folder = Path(sys.argv[1])


def box(extents, centre, name, colour):
    mesh = trimesh.creation.box(extents=extents)
    mesh.apply_translation(centre)
    material = PBRMaterial(name=name, baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=0.9)
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    return mesh


# Axes of glTF: y up, z forward, x left. Half the size of the vehicle: it is stretched to it.
car = trimesh.Scene()
car.add_geometry(box([1.25, 0.5, 2.5], [0, 0.45, 0], "paint", [255, 255, 255, 255]), node_name="body")
for index, (x, z) in enumerate([(0.5, 0.75), (-0.5, 0.75), (0.5, -0.75), (-0.5, -0.75)]):
    wheel = box([0.1, 0.34, 0.34], [0, 0, 0], "tyre", [20, 20, 20, 255])
    place = np.eye(4)
    place[:3, 3] = [x, 0.17, z]
    car.add_geometry(wheel, node_name=f"wheel_{index}", transform=place)
(folder / "peer_car.glb").write_bytes(car.export(file_type="glb"))

house = trimesh.Scene()
# 4 m wide, 6 m high, 2 m deep, standing on its origin; turned and moved by its node.
place = np.eye(4)
place[:3, 3] = [0, 3.0, 0]
house.add_geometry(box([4, 6, 2], [0, 0, 0], "wall", [255, 0, 255, 255]), node_name="house", transform=place)
(folder / "peer_house.glb").write_bytes(house.export(file_type="glb"))
