"""Draws the files of `cargo xtask reference` with Mitsuba, and compares the renderer's pictures with these by FLIP.

Called by scripts/reference.sh.
"""

import argparse
import json
import time
from pathlib import Path

import flip_evaluator
import mitsuba as mi
import numpy as np
import pyoidn
from PIL import Image

mi.set_variant("llvm_ad_rgb")

import materials  # noqa: E402, after the variant is set
import report  # noqa: E402

# Clear sky of a temperate climate (Hosek and Wilkie 2012), over land.
TURBIDITY = 3.0
GROUND_ALBEDO = 0.15
MAX_DEPTH = 8
# Exposure and white balance: units of the renderer in one of Mitsuba's. Fixed once for all pictures and for changes of the
# renderer's light: with them level, white, matt ground in the open at noon was as bright in both.
UNITS = np.array([6.47, 6.85, 6.93])
# Samples of a pass: a pass holds all its paths in memory.
PASS = 16


def sun_and_sky(to_sun):
    return {"type": "sunsky", "sun_direction": to_sun, "turbidity": TURBIDITY, "albedo": GROUND_ALBEDO}


def sensor(camera, extent):
    eye, forward, up = (np.array(camera[key]) for key in ("eye", "forward", "up"))
    return mi.load_dict({
        "type": "perspective",
        "fov": camera["vertical_fov_deg"],
        "fov_axis": "y",
        "near_clip": 0.1,
        "far_clip": 12000.0,
        "to_world": mi.ScalarTransform4f().look_at(eye.tolist(), (eye + forward).tolist(), up.tolist()),
        "film": {"type": "hdrfilm", "width": extent[0], "height": extent[1], "rfilter": {"type": "box"},
                 "pixel_format": "rgb"},
    })


def load_meshes(folder, scene):
    factors, rows = materials.factors(scene)
    # Between lines asphalt is as reflective as elsewhere.
    asphalt = rows.get(materials.MEASURED[0].name)
    surface = materials.SURFACE_REFLECTS
    scene["asphalt_factor"] = (asphalt[2] - surface) / (asphalt[1] - surface) if asphalt else 1.0
    shapes = {}
    for mesh in scene["meshes"]:
        shapes[Path(mesh["file"]).stem.replace("-", "_")] = mi.load_dict({
            "type": "ply", "filename": str(folder / mesh["file"]),
            "bsdf": materials.bsdf(mesh, factors[mesh["file"]]),
        })
    return shapes, rows


def draw(folder, scene, args):
    """Linear pictures of the wanted cameras and times. Samples that are there already are kept, and more are added."""
    wanted = [(moment, camera) for moment in scene["times"] for camera in scene["cameras"]
              if camera["name"] in (args.camera or [camera["name"]])
              and moment["name"] in (args.time or [moment["name"]])]
    shapes, rows = load_meshes(folder, scene)
    lit = {}
    for moment, camera in wanted:
        total, passes = (0.0, 0) if args.again else sum_of(folder, camera, moment)
        if passes * PASS >= args.spp:
            continue
        name, begun = moment["name"], time.monotonic()
        if name not in lit:
            lit = {name: mi.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": MAX_DEPTH},
                                       "light": sun_and_sky(moment["to_sun"]), **shapes})}
        view = sensor(camera, scene["extent"])
        while passes * PASS < args.spp:
            total = total + np.array(mi.render(lit[name], sensor=view, spp=PASS, seed=passes), np.float64)
            passes += 1
        np.savez(sum_file(folder, camera, moment), total=total, passes=passes)
        print(f"{camera['name']}, {name}: {passes * PASS} samples, {time.monotonic() - begun:.0f} s", flush=True)
    guides = {} if args.noisy else {camera["name"]: guides_of(folder, scene, shapes, camera) for _, camera in wanted}
    return wanted, rows, guides


def guides_of(folder, scene, shapes, camera):
    """Reflectance and normals of each pixel, by which the denoiser tells textures and edges from noise."""
    path = folder / f"{camera['name']}-guides.npz"
    if not path.exists():
        city = mi.load_dict({"type": "scene", **shapes,
                             "integrator": {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"}})
        values = np.array(mi.render(city, sensor=sensor(camera, scene["extent"]), spp=4 * PASS))[..., -6:]
        np.savez(path, albedo=values[..., :3], normal=values[..., 3:])
    with np.load(path) as stored:
        return {key: np.ascontiguousarray(stored[key], np.float32) for key in ("albedo", "normal")}


def denoised(radiance, guides):
    """Without the noise that is left (Intel Open Image Denoise)."""
    colour = np.ascontiguousarray(np.maximum(radiance, 0.0), np.float32)
    return pyoidn.denoise(colour, albedo=np.clip(guides["albedo"], 0, 1), normal=guides["normal"], hdr=True,
                          clean_aux=True)


def sum_file(folder, camera, moment):
    return folder / f"{camera['name']}-{moment['name']}-reference.npz"


def sum_of(folder, camera, moment):
    """Sum of the linear pictures of all passes, and their number."""
    path = sum_file(folder, camera, moment)
    if not path.exists():
        return 0.0, 0
    with np.load(path) as stored:
        return stored["total"], int(stored["passes"])


def displayed(radiance):
    """Tone mapping and sRGB encoding of shaders/display.wgsl, of radiance times exposure."""
    x = radiance
    y = np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0)
    return np.where(y < 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055).astype(np.float32)


def picture(path):
    return np.asarray(Image.open(path).convert("RGB"), np.float32) / 255.0


def compare(folder, scene, wanted, guides):
    """Rows of preset, camera, time, mean FLIP, and FLIP and mean colours by class."""
    results = []
    for moment, camera in wanted:
        total, passes = sum_of(folder, camera, moment)
        radiance = np.maximum(total / passes, 0.0)
        if camera["name"] in guides:
            radiance = denoised(radiance, guides[camera["name"]])
        shown = displayed(radiance * UNITS * moment["exposure"])
        Image.fromarray((shown * 255 + 0.5).astype(np.uint8)).save(
            folder / f"{camera['name']}-{moment['name']}-reference.png")
        classes = np.fromfile(folder / f"{camera['name']}.classes", np.uint8).reshape(shown.shape[:2])
        for preset in scene["presets"]:
            drawn = picture(folder / f"{camera['name']}-{moment['name']}-{preset}.png")
            flip, mean, _ = flip_evaluator.evaluate(shown, drawn, "LDR", applyMagma=False)
            flip = np.asarray(flip).squeeze()
            by_class = {int(number): {
                "share": float((classes == number).mean()),
                "flip": float(flip[classes == number].mean()),
                "reference": [float(c) for c in shown[classes == number].mean(axis=0)],
                "drawn": [float(c) for c in drawn[classes == number].mean(axis=0)],
            } for number in np.unique(classes)}
            results.append({"preset": preset, "camera": camera["name"], "held_out": camera["is_held_out"],
                            "time": moment["name"], "flip": float(mean), "classes": by_class})
    return results


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="what cargo xtask reference has written")
    parser.add_argument("--spp", type=int, default=256, help="samples of a pixel")
    parser.add_argument("--camera", action="append", help="only this one; may be repeated")
    parser.add_argument("--time", action="append", help="only this one; may be repeated")
    parser.add_argument("--again", action="store_true", help="draw pictures that are there already")
    parser.add_argument("--noisy", action="store_true", help="leave the noise of the samples as it is")
    parser.add_argument("--pairs", type=Path, help="folder for pairs of pictures")
    args = parser.parse_args()
    scene = json.loads((args.folder / "scene.json").read_text())
    materials.set_up(args.folder, scene)
    wanted, rows, guides = draw(args.folder, scene, args)
    results = compare(args.folder, scene, wanted, guides)
    text = report.tables(scene, results, rows)
    (args.folder / "tables.md").write_text(text)
    (args.folder / "results.json").write_text(json.dumps(results, indent=1))
    print(text)
    if args.pairs:
        report.pairs(args.folder, scene, args.pairs)


if __name__ == "__main__":
    main()
