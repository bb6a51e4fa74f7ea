"""Reads the pictures of a run with numpy and Pillow and prints what is in them as JSON.

The points are found by the example of docs/cameras.md, which the second argument is.

usage: read_frames.py FOLDER docs/cameras.md
"""

import csv
import json
import os
import re
import sys

import numpy as np
from PIL import Image

folder, document = sys.argv[1], os.path.abspath(sys.argv[2])
os.chdir(folder)
example = re.search(r"```python\n(.*?)```", open(document).read(), re.S)[1]
found = {}
exec(example, found)

files = {row["kind"]: row for row in csv.DictReader(open("frames.csv"))}
classes = Image.open(files["semantic"]["file"])
vehicles = Image.open(files["instance"]["file"])
road = np.array(classes) == 1
of_vehicles = np.array(vehicles)
points, depth = found["points"], found["depth"]
print(json.dumps({
    "modes": {kind: Image.open(row["file"]).mode for kind, row in files.items() if row["file"].endswith(".png")},
    "depth": [str(depth.dtype), list(depth.shape)],
    "road": int(road.sum()),
    "highest": float(np.abs(points[road][:, 2]).max()),
    "sky": int(np.isinf(depth).sum()),
    "sky_by_class": int((np.array(classes) == 0).sum()),
    "vehicles": {
        str(number): {
            "pixels": int((of_vehicles == number).sum()),
            "middle": [float(np.median(points[of_vehicles == number][:, axis])) for axis in range(2)],
            "classes": sorted(set(np.array(classes)[of_vehicles == number].tolist())),
        }
        for number in np.unique(of_vehicles) if number > 0
    },
}))
