"""Materials of the reference: reflectances from the literature where there are some, else those of the renderer."""

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# Above this roughness the renderer's surfaces reflect diffusely alone, and those of the reference too.
MATT = 0.96
# What a rough dielectric of refractive index 1.5 reflects at its surface, of light from all sides: what the literature
# measures is the sum of this and of the diffuse part (Karis 2014, at roughness 0.83 and 60 degrees).
SURFACE_REFLECTS = 0.025
ROUGH_DIELECTRICS = ("Asphalt", "Lane", "Patch", "Manhole", "Line")


@dataclass(frozen=True)
class Measured:
    """Visible reflectance of a material out of the literature. `low` and `high` are equal where one mean is given; of a
    range the reference takes what is nearest to the renderer's."""

    name: str
    surfaces: tuple
    classes: tuple
    low: float
    high: float
    source: str


MEASURED = [
    Measured("asphalt, some years old", ("Asphalt", "Lane", "Patch", "Manhole"), ("road",), 0.12, 0.12,
             "Pomerantz, Akbari, Harvey 2000"),
    Measured("concrete slabs and kerbs, weathered", ("Slabs", "Concrete"), ("pavement",), 0.25, 0.25,
             "ACPA 2002: 0.20 to 0.30"),
    Measured("stone setts", ("Setts",), ("pavement",), 0.20, 0.35, "Oke 1987"),
    Measured("lawn", ("Grass",), ("grass",), 0.11, 0.11, "Oleson et al. 2013, grass leaves, visible"),
    Measured("broad leaves", ("Leaves",), ("vegetation",), 0.10, 0.10,
             "Oleson et al. 2013, broadleaf deciduous trees, visible"),
    Measured("needles", ("Needles",), ("vegetation",), 0.07, 0.07,
             "Oleson et al. 2013, needleleaf trees, visible"),
    Measured("white road paint, worn", ("Line", "Paint"), ("marking",), 0.40, 0.60, "EN 1436, classes B3 to B5"),
    Measured("brick", ("Brick",), ("building", "wall"), 0.20, 0.40, "Oke 1987"),
    Measured("roof tiles", ("RoofTiles",), ("building",), 0.10, 0.35, "Oke 1987"),
    Measured("gravel on roofs", ("Gravel",), ("building",), 0.08, 0.18, "Oke 1987"),
]


def linear_from_srgb(c):
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


class Atlas:
    """Textures of all surfaces in linear light, and roughness as the fourth channel, for lookups with repetition."""

    def __init__(self, folder, scene):
        edge = self.edge = scene["texture_edge"]
        texels = np.fromfile(folder / "textures.rgba", np.uint8).reshape(-1, edge, edge, 4) / 255.0
        texels[..., :3] = linear_from_srgb(texels[..., :3])
        self.means = texels.mean(axis=(1, 2))
        self.is_matt = texels[..., 3] > MATT
        self.texels = mi.Float(texels.astype(np.float32).ravel())

    def at(self, layer, uv, channels):
        """Bilinear lookup of some channels."""
        place = uv * self.edge - 0.5
        corner = dr.floor(place)
        part = place - corner
        total = [mi.Float(0) for _ in channels]
        for dy in range(2):
            for dx in range(2):
                x, y = (int_mod(corner[k] + d, self.edge) for k, d in ((0, dx), (1, dy)))
                weight = (part.x if dx else 1 - part.x) * (part.y if dy else 1 - part.y)
                index = ((layer * self.edge + y) * self.edge + x) * 4
                for k, channel in enumerate(channels):
                    total[k] += weight * dr.gather(mi.Float, self.texels, index + channel)
        return total


def int_mod(value, edge):
    """Number of a texel, which repeats; the edge is a power of two."""
    return mi.UInt32(mi.Int32(value)) & (edge - 1)


# Textures are plugins, which get numbers and other plugins alone.
ATLAS = None
SCENE = None


def set_up(folder, scene):
    global ATLAS, SCENE
    ATLAS, SCENE = Atlas(folder, scene), scene
    mi.register_texture("city_albedo", CityAlbedo)
    mi.register_texture("city_roughness", CityRoughness)
    mi.register_texture("city_matt", CityMatt)


class CityTexture(mi.Texture):
    def __init__(self, props):
        mi.Texture.__init__(self, props)
        self.layer = dr.opaque(mi.UInt32, props["layer"])
        self.surface = props["surface"]

    def is_spatially_varying(self):
        return True

    def mean(self):
        return mi.Float(0.5)


class CityAlbedo(CityTexture):
    """Vertex colour times texture as in `shaders/city.wgsl`, times a factor."""

    def __init__(self, props):
        super().__init__(props)
        self.factor = dr.opaque(mi.Float, props["factor"])
        self.colour = props["colour"]

    def eval(self, si, active=True):
        own = self.colour.eval(si, active)
        if self.surface == "Line":
            # u: metres from the middle, v: half the width. Between lines is asphalt.
            pattern = mi.Color3f(ATLAS.at(mi.UInt32(SCENE["asphalt_layer"]), mi.Point2f(si.p.x, si.p.y) * 0.2, range(3)))
            paint = own * (0.62 + 0.5 * pattern.y) * self.factor
            ground = pattern * mi.Color3f(SCENE["asphalt"]) * SCENE["asphalt_factor"]
            return dr.select(dr.abs(si.uv.x) <= si.uv.y, paint, ground)
        pattern = mi.Color3f(ATLAS.at(self.layer, si.uv, range(3)))
        if self.surface in ("Grass", "Asphalt", "Lane"):
            # The second scale of detail texturing.
            layer = SCENE["grass_layer"] if self.surface == "Grass" else SCENE["asphalt_layer"]
            [broad] = ATLAS.at(mi.UInt32(layer), mi.Point2f(si.p.x, si.p.y) * 0.021 + 0.37, [1])
            pattern *= 0.5 + 0.5 * broad / 0.6
        return dr.clip(own * pattern * self.factor, 0, 0.95)

    def eval_1(self, si, active=True):
        return mi.luminance(self.eval(si, active))

    def to_string(self):
        return f"CityAlbedo[{self.surface}]"


class CityRoughness(CityTexture):
    """Roughness as in `shaders/city.wgsl`."""

    def eval_1(self, si, active=True):
        if self.surface == "CarPaint":
            return mi.Float(SCENE["lacquer"])
        if self.surface == "Line":
            return mi.Float(0.75)
        if self.surface in ("Asphalt", "Lane", "Patch"):
            [green] = ATLAS.at(self.layer, si.uv, [1])
            return 0.93 - 0.16 * green
        [roughness] = ATLAS.at(self.layer, si.uv, [3])
        return dr.maximum(roughness, 0.05)

    def eval(self, si, active=True):
        return mi.Color3f(self.eval_1(si, active))

    def to_string(self):
        return f"CityRoughness[{self.surface}]"


class CityMatt(CityRoughness):
    """1 where a surface reflects diffusely alone."""

    def eval_1(self, si, active=True):
        return dr.select(super().eval_1(si, active) > MATT, mi.Float(1), mi.Float(0))

    def to_string(self):
        return f"CityMatt[{self.surface}]"


def measured_of(mesh):
    """What the literature says of a mesh's material, if anything."""
    return next((m for m in MEASURED if mesh["surface"] in m.surfaces and mesh["class"] in m.classes), None)


def reflectance_of(mesh):
    """Mean luminous reflectance of a mesh as the renderer has it, that of its surface included."""
    return diffuse_of(mesh) + surface_of(mesh)


def surface_of(mesh):
    return SURFACE_REFLECTS if mesh["surface"] in ROUGH_DIELECTRICS else 0.0


def diffuse_of(mesh):
    colour = np.array(mesh["mean_colour"])
    if mesh["layer"] is None:
        return float(LUMINANCE @ colour)
    if mesh["surface"] == "Line":
        green = ATLAS.means[SCENE["asphalt_layer"]][1]
        return float(LUMINANCE @ colour * (0.62 + 0.5 * green))
    return float(LUMINANCE @ (colour * ATLAS.means[mesh["layer"]][:3]))


def factors(scene):
    """What each mesh's colours are multiplied by, so that the mean is that of the literature, and rows of a table."""
    table = {}
    for mesh in scene["meshes"]:
        measured = measured_of(mesh)
        if measured:
            has = table.setdefault(measured.name, [measured, 0.0, 0.0])
            has[1] += reflectance_of(mesh) * mesh["area_m2"]
            has[2] += mesh["area_m2"]
    rows = {}
    for name, (measured, sum_of, area) in table.items():
        own = sum_of / max(area, 1e-9)
        rows[name] = (measured, own, min(max(own, measured.low), measured.high))
    by_mesh = {}
    for mesh in scene["meshes"]:
        measured = measured_of(mesh)
        by_mesh[mesh["file"]] = 1.0
        if measured:
            _, own, wanted = rows[measured.name]
            surface = surface_of(mesh)
            by_mesh[mesh["file"]] = (wanted - surface) / (own - surface)
    return by_mesh, rows


def bsdf(mesh, factor):
    """Description of the material of a mesh."""
    colour = {"type": "mesh_attribute", "name": "vertex_color"}
    if mesh["layer"] is None:
        inner = {"type": "principled", "base_color": colour, "metallic": mesh["metallic"],
                 "roughness": max(mesh["roughness"], 0.05), "specular": 0.5}
        return {"type": "twosided", "inner": inner}
    texture = {"layer": mesh["layer"], "surface": mesh["surface"]}
    albedo = {"type": "city_albedo", "factor": factor, "colour": colour, **texture}
    matt = {"type": "diffuse", "reflectance": albedo}
    # Reflectance 0.04 at normal incidence: refractive index 1.5.
    glossy = {"type": "principled", "base_color": albedo, "roughness": {"type": "city_roughness", **texture},
              "specular": 0.5}
    is_matt = ATLAS.is_matt[mesh["layer"]]
    if mesh["surface"] in ROUGH_DIELECTRICS + ("CarPaint",) or not is_matt.any():
        inner = glossy
    elif is_matt.all():
        inner = matt
    else:
        inner = {"type": "blendbsdf", "weight": {"type": "city_matt", **texture}, "first": glossy, "second": matt}
    return {"type": "twosided", "inner": inner}
