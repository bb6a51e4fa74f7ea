"""Tables and pairs of pictures of the comparison."""

import numpy as np
from PIL import Image

CLASSES = ["sky", "road", "marking", "pavement", "grass", "building", "wall", "vegetation", "pole", "furniture", "water",
           "vehicle", "sign", "person"]


def mean_of(results, **wanted):
    values = [r["flip"] for r in results if all(r[key] == value for key, value in wanted.items())]
    return f"{np.mean(values):.3f}" if values else ""


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def tables(scene, results, materials):
    times = [moment["name"] for moment in scene["times"] if any(r["time"] == moment["name"] for r in results)]
    cameras = [c for c in scene["cameras"] if any(r["camera"] == c["name"] for r in results)]
    parts = []
    rows = [[f"`{p}`", *(mean_of(results, preset=p, time=t) for t in times), mean_of(results, preset=p),
             mean_of(results, preset=p, held_out=False), mean_of(results, preset=p, held_out=True)]
            for p in scene["presets"]]
    parts.append(table(["preset", *times, "all", "tuned by", "held out"], rows))
    rows = [[c["name"] + (" (held out)" if c["is_held_out"] else ""), t,
             *(mean_of(results, preset=p, camera=c["name"], time=t) for p in scene["presets"])]
            for c in cameras for t in times]
    parts.append(table(["camera", "time", *(f"`{p}`" for p in scene["presets"])], rows))
    rows = []
    for t in times:
        for number, name in enumerate(CLASSES):
            seen = [(r["classes"][number]["share"], r["classes"][number]) for r in results
                    if r["preset"] == "ultra" and r["time"] == t and number in r["classes"]]
            share = sum(s for s, _ in seen)
            if share < 0.01 * len(cameras):
                continue
            mean = lambda key: sum(s * np.array(c[key]) for s, c in seen) / share  # noqa: E731
            colour = lambda key: " ".join(f"{255 * c:.0f}" for c in mean(key))  # noqa: E731
            rows.append([t, name, f"{100 * share / len(cameras):.0f} %", f"{mean('flip'):.3f}", colour("reference"),
                         colour("drawn")])
    parts.append(table(["time", "class", "of the pixels", "FLIP, `ultra`", "reference, sRGB", "City3D, sRGB"], rows))
    rows = [[name, f"{own:.3f}", f"{wanted:.3f}", measured.source]
            for name, (measured, own, wanted) in materials.items()]
    parts.append(table(["material", "City3D", "reference", "source"], rows))
    return "\n".join(parts)


def pairs(folder, scene, to):
    """The reference on the left, `ultra` on the right."""
    to.mkdir(parents=True, exist_ok=True)
    for camera in scene["cameras"]:
        for moment in scene["times"]:
            name = f"{camera['name']}-{moment['name']}"
            both = [Image.open(folder / f"{name}-{kind}.png").convert("RGB") for kind in ("reference", "ultra")]
            width, height = both[0].size
            pair = Image.new("RGB", (2 * width + 4, height), "white")
            pair.paste(both[0], (0, 0))
            pair.paste(both[1], (width + 4, 0))
            pair.save(to / f"{name}.jpg", quality=86, optimize=True)
