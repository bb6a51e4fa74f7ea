//! Shader sources: from disk in debug builds where they lie there, embedded else.

use super::passes::common::gpu_data::Frame;
use super::passes::lamps::LAMP_REACH_M;
use super::vehicle::Part;
use crate::city::scene::{ASPHALT, Surface};
use std::borrow::Cow;

/// One file of `shaders/`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Source {
    name: &'static str,
    embedded: &'static str,
}

macro_rules! source {
    ($name:literal) => {
        Source { name: $name, embedded: include_str!(concat!("../../shaders/", $name)) }
    };
}

const COMMON: Source = source!("common.wgsl");
const LIGHT: Source = source!("light.wgsl");
const SWIFT: Source = source!("swift.wgsl");
const CITY: Source = source!("city.wgsl");
const VEHICLE: Source = source!("vehicle.wgsl");
const CONTACT: Source = source!("contact.wgsl");
const GLOW: Source = source!("glow.wgsl");
const SHADOW: Source = source!("shadow.wgsl");
const SKY: Source = source!("sky.wgsl");
const LAMPS: Source = source!("lamps.wgsl");
const KINDS: Source = source!("kinds.wgsl");
const TILE: Source = source!("tile.wgsl");
const ONE_SAMPLE: Source = source!("one_sample.wgsl");
const MANY_SAMPLES: Source = source!("many_samples.wgsl");
const OCCLUSION: Source = source!("occlusion.wgsl");
const DISPLAY: Source = source!("display.wgsl");

/// The shader of a pass: its own file after those it builds on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shader {
    City,
    Vehicle,
    Contact,
    Glow,
    Shadow,
    Sky,
    Kinds,
    Lamps,
    Occlusion(Samples),
    Display(Samples),
}

/// Samples of a pixel, which shaders read in different ways.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Samples {
    One,
    Many,
}

impl Shader {
    #[cfg(test)]
    pub(super) const ALL: [Self; 12] = [
        Self::City,
        Self::Vehicle,
        Self::Contact,
        Self::Glow,
        Self::Shadow,
        Self::Sky,
        Self::Kinds,
        Self::Lamps,
        Self::Occlusion(Samples::One),
        Self::Occlusion(Samples::Many),
        Self::Display(Samples::One),
        Self::Display(Samples::Many),
    ];

    fn parts(self) -> &'static [Source] {
        match self {
            Self::City => &[COMMON, LIGHT, SWIFT, CITY],
            Self::Vehicle => &[COMMON, LIGHT, SWIFT, VEHICLE],
            Self::Contact => &[COMMON, CONTACT],
            Self::Glow => &[COMMON, GLOW],
            Self::Shadow => &[COMMON, SHADOW],
            Self::Sky => &[COMMON, SKY],
            Self::Kinds => &[KINDS],
            Self::Lamps => &[COMMON, LAMPS],
            Self::Occlusion(Samples::One) => &[COMMON, TILE, ONE_SAMPLE, OCCLUSION],
            Self::Occlusion(Samples::Many) => &[COMMON, TILE, MANY_SAMPLES, OCCLUSION],
            Self::Display(Samples::One) => &[COMMON, TILE, ONE_SAMPLE, DISPLAY],
            Self::Display(Samples::Many) => &[COMMON, TILE, MANY_SAMPLES, DISPLAY],
        }
    }

    /// With what of a frame never changes, where it is told, as constants.
    pub(super) fn text(self, fixed: Option<&Frame>) -> String {
        let constants = fixed.map(|frame| Cow::Owned(constants(frame)));
        let parts = self.parts().iter().map(|part| part.text());
        let shared = std::iter::once(Cow::Owned(self.shared_constants()));
        constants.into_iter().chain(shared).chain(parts).collect::<Vec<_>>().join("\n")
    }

    pub(super) fn module(self, device: &wgpu::Device, fixed: Option<&Frame>) -> wgpu::ShaderModule {
        device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(match self {
                Self::City => "city",
                Self::Vehicle => "vehicle",
                Self::Contact => "contact",
                Self::Glow => "glow",
                Self::Shadow => "shadow",
                Self::Sky => "sky",
                Self::Kinds => "kinds",
                Self::Lamps => "lamps",
                Self::Occlusion(_) => "occlusion",
                Self::Display(_) => "display",
            }),
            source: wgpu::ShaderSource::Wgsl(Cow::Owned(self.text(fixed))),
        })
    }
}

impl Shader {
    /// Constants that a shader shares with Rust, from the one place where they are defined.
    fn shared_constants(self) -> String {
        match self {
            Self::City => surfaces(),
            Self::Vehicle => parts_of_vehicles(),
            Self::Lamps => format!("const LAMP_REACH_M: f32 = {LAMP_REACH_M:?};\n"),
            _ => String::new(),
        }
    }
}

/// Layers of the texture array, and the linear colour of asphalt.
fn surfaces() -> String {
    let layers = [
        ("ASPHALT", Surface::Asphalt),
        ("GRASS", Surface::Grass),
        ("WINDOWS", Surface::Windows),
        ("GLAZING", Surface::Glazing),
        ("SHOPFRONT", Surface::Shopfront),
        ("LEAVES", Surface::Leaves),
        ("LANE", Surface::Lane),
        ("LINE", Surface::Line),
        ("PATCH", Surface::Patch),
        ("MANHOLE", Surface::Manhole),
        ("SASH", Surface::Sash),
        ("BALCONY", Surface::Balcony),
        ("LETTERS", Surface::Letters),
        ("NEEDLES", Surface::Needles),
        ("CAR_PAINT", Surface::CarPaint),
        ("LANTERN", Surface::Lantern),
        ("BOUTIQUE", Surface::Boutique),
        ("TEAROOM", Surface::Tearoom),
    ];
    let [r, g, b] = ASPHALT.colour.map(|part| linear_from_srgb(f32::from(part) / 255.0));
    layers.map(|(name, surface)| format!("const {name}: u32 = {}u;\n", surface as u32)).concat()
        + &format!("const ASPHALT_TINT: vec3<f32> = vec3<f32>({r:.3}, {g:.3}, {b:.3});\n")
}

fn linear_from_srgb(part: f32) -> f32 {
    if part <= 0.040_45 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
}

fn parts_of_vehicles() -> String {
    let parts = [
        ("PAINT", Part::Paint),
        ("GLASS", Part::Glass),
        ("HEAD", Part::Head),
        ("TAIL", Part::Tail),
        ("INDICATOR_LEFT", Part::IndicatorLeft),
        ("INDICATOR_RIGHT", Part::IndicatorRight),
        ("REVERSE", Part::Reverse),
        ("BRIGHT", Part::Bright),
    ];
    parts.map(|(name, part)| format!("const {name}: u32 = {}u;\n", part as u32)).concat()
}

/// The members of a frame but for the time as constants of their names in capitals.
fn constants(frame: &Frame) -> String {
    let list = |values: &[f32]| values.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(", ");
    let vectors = [
        ("SUN", frame.sun),
        ("SKY_LIGHT", frame.sky_light),
        ("GROUND_LIGHT", frame.ground_light),
        ("HAZE", frame.haze),
        ("SHADOW_TEXEL", frame.shadow_texel),
        ("ZENITH", frame.zenith),
        ("LAMP_PLACE", frame.lamp_place),
    ];
    let vectors = vectors.map(|(name, v)| format!("const {name} = vec4<f32>({});\n", list(&v)));
    let to_sun = list(&frame.to_sun[..3]);
    let shadow = list(frame.shadow_from_world.as_flattened());
    vectors.concat()
        + &format!("const TO_SUN = vec3<f32>({to_sun});\nconst SHADOW_FROM_WORLD = mat4x4<f32>({shadow});\n")
}

impl Source {
    fn text(self) -> Cow<'static, str> {
        if cfg!(debug_assertions) {
            let path = std::path::Path::new("shaders").join(self.name);
            if let Ok(text) = std::fs::read_to_string(path) {
                return Cow::Owned(text);
            }
        }
        Cow::Borrowed(self.embedded)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use bytemuck::Zeroable;

    /// The shader after naga's parser and validator.
    pub(crate) fn validated(shader: Shader) -> naga::Module {
        let text = shader.text(Some(&Frame::zeroed()));
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(&text)));
        let flags = naga::valid::ValidationFlags::all();
        naga::valid::Validator::new(flags, naga::valid::Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|error| panic!("{shader:?}: {}", error.emit_to_string(&text)));
        module
    }

    /// Byte offsets of a WGSL struct's members, and its size.
    pub(crate) fn layout(module: &naga::Module, name: &str) -> (Vec<u32>, u32) {
        let (_, ty) = module
            .types
            .iter()
            .find(|(_, ty)| ty.name.as_deref() == Some(name))
            .unwrap_or_else(|| panic!("the shader has no struct {name}"));
        match &ty.inner {
            naga::TypeInner::Struct { members, span } => {
                (members.iter().map(|member| member.offset).collect(), *span)
            }
            other => panic!("{name} is {other:?}"),
        }
    }

    #[test]
    fn every_shader_is_valid() {
        for shader in Shader::ALL {
            validated(shader);
        }
    }
}
