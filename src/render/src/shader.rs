//! WGSL shader sources: read from disk in debug builds if present, otherwise embedded; constants shared with Rust are
//! injected in front.

use super::passes::common::gpu_data::Frame;
use super::passes::lamps::LAMP_REACH_M;
use super::vehicle::VehiclePart;
use city3d_models::glb::linear_from_srgb;
use city3d_scene::{ASPHALT, Class, Surface};
use std::borrow::Cow;

/// File of `shaders/`.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShaderFile {
    name: &'static str,
    embedded: &'static str,
}

macro_rules! shader_file {
    ($name:literal) => {
        ShaderFile { name: $name, embedded: include_str!(concat!("../../../shaders/", $name)) }
    };
}

const COMMON: ShaderFile = shader_file!("common.wgsl");
const LIGHT: ShaderFile = shader_file!("light.wgsl");
const VERTEX_LIT: ShaderFile = shader_file!("vertex_lit.wgsl");
const GROUND_DETAIL: ShaderFile = shader_file!("ground_detail.wgsl");
const FOLIAGE: ShaderFile = shader_file!("foliage.wgsl");
const HASH: ShaderFile = shader_file!("hash.wgsl");
const SPRAYS: ShaderFile = shader_file!("sprays.wgsl");
const ROOMS: ShaderFile = shader_file!("rooms.wgsl");
const NUMBER: ShaderFile = shader_file!("number.wgsl");
const CITY: ShaderFile = shader_file!("city.wgsl");
const VEHICLE: ShaderFile = shader_file!("vehicle.wgsl");
const CONTACT: ShaderFile = shader_file!("contact.wgsl");
const STANDING: ShaderFile = shader_file!("standing.wgsl");
const GLOW: ShaderFile = shader_file!("glow.wgsl");
const SIGNAL: ShaderFile = shader_file!("signal.wgsl");
const SHADOW: ShaderFile = shader_file!("shadow.wgsl");
const SKY: ShaderFile = shader_file!("sky.wgsl");
const LAMPS: ShaderFile = shader_file!("lamps.wgsl");
const GROUND_TRUTH: ShaderFile = shader_file!("ground_truth.wgsl");
const TILE: ShaderFile = shader_file!("tile.wgsl");
const SINGLE_SAMPLE: ShaderFile = shader_file!("single_sample.wgsl");
const MULTISAMPLE: ShaderFile = shader_file!("multisample.wgsl");
const SURFACE: ShaderFile = shader_file!("surface.wgsl");
const REFLECTION: ShaderFile = shader_file!("reflection.wgsl");
const OCCLUSION: ShaderFile = shader_file!("occlusion.wgsl");
const DISPLAY: ShaderFile = shader_file!("display.wgsl");
const OVERLAY: ShaderFile = shader_file!("overlay.wgsl");
const PALETTE: ShaderFile = shader_file!("palette.wgsl");

/// Shader of a pass: the concatenation of its own file and those it builds on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shader {
    City,
    Vehicle,
    Contact,
    Standing,
    Glow,
    Signal,
    Shadow,
    Sky,
    GroundTruth,
    Lamps,
    Occlusion(SampleCount),
    Reflection(SampleCount),
    Display(SampleCount),
    Overlay(SampleCount),
    Palette,
}

/// Whether the attachments that a shader reads are multisampled (MSAA).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SampleCount {
    Single,
    Multi,
}

impl Shader {
    #[cfg(test)]
    pub(super) const ALL: [Self; 19] = [
        Self::City,
        Self::Vehicle,
        Self::Contact,
        Self::Standing,
        Self::Glow,
        Self::Signal,
        Self::Shadow,
        Self::Sky,
        Self::GroundTruth,
        Self::Lamps,
        Self::Occlusion(SampleCount::Single),
        Self::Occlusion(SampleCount::Multi),
        Self::Reflection(SampleCount::Single),
        Self::Reflection(SampleCount::Multi),
        Self::Display(SampleCount::Single),
        Self::Display(SampleCount::Multi),
        Self::Overlay(SampleCount::Single),
        Self::Overlay(SampleCount::Multi),
        Self::Palette,
    ];

    fn parts(self) -> &'static [ShaderFile] {
        match self {
            Self::City => {
                &[COMMON, LIGHT, VERTEX_LIT, HASH, GROUND_DETAIL, SPRAYS, FOLIAGE, ROOMS, NUMBER, CITY]
            }
            Self::Vehicle => &[COMMON, LIGHT, VERTEX_LIT, NUMBER, VEHICLE],
            Self::Contact => &[COMMON, CONTACT],
            Self::Standing => &[COMMON, STANDING],
            Self::Glow => &[COMMON, GLOW],
            Self::Signal => &[COMMON, SIGNAL],
            Self::Shadow => &[COMMON, SHADOW],
            Self::Sky => &[COMMON, SKY],
            Self::GroundTruth => &[HASH, SPRAYS, GROUND_TRUTH],
            Self::Lamps => &[COMMON, LAMPS],
            Self::Occlusion(SampleCount::Single) => &[COMMON, TILE, SINGLE_SAMPLE, SURFACE, OCCLUSION],
            Self::Occlusion(SampleCount::Multi) => &[COMMON, TILE, MULTISAMPLE, SURFACE, OCCLUSION],
            Self::Reflection(SampleCount::Single) => &[COMMON, TILE, SINGLE_SAMPLE, SURFACE, REFLECTION],
            Self::Reflection(SampleCount::Multi) => &[COMMON, TILE, MULTISAMPLE, SURFACE, REFLECTION],
            Self::Display(SampleCount::Single) => &[COMMON, TILE, SINGLE_SAMPLE, SURFACE, DISPLAY],
            Self::Display(SampleCount::Multi) => &[COMMON, TILE, MULTISAMPLE, SURFACE, DISPLAY],
            Self::Overlay(SampleCount::Single) => &[COMMON, SINGLE_SAMPLE, OVERLAY],
            Self::Overlay(SampleCount::Multi) => &[COMMON, MULTISAMPLE, OVERLAY],
            Self::Palette => &[PALETTE],
        }
    }

    /// WGSL text; with `frame_constants`, uniforms of the frame that never change are injected as constants.
    pub(super) fn text(self, frame_constants: Option<&Frame>) -> String {
        let constants = frame_constants.map(|frame| Cow::Owned(wgsl_constants(frame)));
        let parts = self.parts().iter().map(|part| part.text());
        let shared = std::iter::once(Cow::Owned(self.shared_constants()));
        constants.into_iter().chain(shared).chain(parts).collect::<Vec<_>>().join("\n")
    }

    pub(super) fn module(self, device: &wgpu::Device, frame_constants: Option<&Frame>) -> wgpu::ShaderModule {
        device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(match self {
                Self::City => "city",
                Self::Vehicle => "vehicle",
                Self::Contact => "contact",
                Self::Standing => "standing",
                Self::Glow => "glow",
                Self::Signal => "signal",
                Self::Shadow => "shadow",
                Self::Sky => "sky",
                Self::GroundTruth => "ground truth",
                Self::Lamps => "lamps",
                Self::Occlusion(_) => "occlusion",
                Self::Reflection(_) => "reflection",
                Self::Display(_) => "display",
                Self::Overlay(_) => "overlay",
                Self::Palette => "palette",
            }),
            source: wgpu::ShaderSource::Wgsl(Cow::Owned(self.text(frame_constants))),
        })
    }
}

impl Shader {
    /// Constants that Rust defines and the shader uses.
    fn shared_constants(self) -> String {
        match self {
            Self::City => surface_constants(),
            Self::Vehicle => vehicle_part_constants(),
            Self::Lamps => format!("const LAMP_REACH_M: f32 = {LAMP_REACH_M:?};\n"),
            Self::Palette => class_constants(),
            _ => String::new(),
        }
    }
}

/// Layers of the texture array of surfaces, and the linear colour of asphalt.
fn surface_constants() -> String {
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
        ("GLASS", Surface::Glass),
        ("LANTERN", Surface::Lantern),
        ("BOUTIQUE", Surface::Boutique),
        ("TEAROOM", Surface::Tearoom),
        ("NUMBER", Surface::Number),
        ("SLABS", Surface::Slabs),
        ("SETTS", Surface::Setts),
        ("CONCRETE", Surface::Concrete),
        ("GRAVEL", Surface::Gravel),
        ("SAND", Surface::Sand),
    ];
    let [r, g, b] = ASPHALT.colour.map(linear_from_srgb);
    layers.map(|(name, surface)| format!("const {name}: u32 = {}u;\n", surface as u32)).concat()
        + &format!("const ASPHALT_TINT: vec3<f32> = vec3<f32>({r:.3}, {g:.3}, {b:.3});\n")
}

/// Colours of the semantic classes, by their numbers.
fn class_constants() -> String {
    let colours = Class::ALL.map(|class| {
        let [r, g, b] = class.colour().map(|part| f32::from(part) / 255.0);
        format!("vec3<f32>({r:.4}, {g:.4}, {b:.4})")
    });
    let (count, colours) = (colours.len(), colours.join(", "));
    format!(
        "const CLASS_COUNT: u32 = {count}u;\n\
         const CLASS_COLOURS = array<vec3<f32>, {count}>({colours});\n"
    )
}

fn vehicle_part_constants() -> String {
    let parts = [
        ("PAINT", VehiclePart::Paint),
        ("GLASS", VehiclePart::Glass),
        ("HEAD", VehiclePart::Head),
        ("TAIL", VehiclePart::Tail),
        ("INDICATOR_LEFT", VehiclePart::IndicatorLeft),
        ("INDICATOR_RIGHT", VehiclePart::IndicatorRight),
        ("REVERSE", VehiclePart::Reverse),
        ("BRIGHT", VehiclePart::Bright),
        ("LENS", VehiclePart::Lens),
        ("NUMBER", VehiclePart::Number),
    ];
    parts.map(|(name, part)| format!("const {name}: u32 = {}u;\n", part as u32)).concat()
}

/// Members of a frame other than the time, as constants with their names in capitals.
fn wgsl_constants(frame: &Frame) -> String {
    let list = |values: &[f32]| values.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(", ");
    let vectors = [
        ("SUN", frame.sun),
        ("SKY_LIGHT", frame.sky_light),
        ("GROUND_LIGHT", frame.ground_light),
        ("HAZE", frame.haze),
        ("SHADOW_TEXEL", frame.shadow_texel),
        ("ZENITH", frame.zenith),
        ("LAMP_UV_FROM_WORLD", frame.lamp_uv_from_world),
    ];
    let vectors = vectors.map(|(name, v)| format!("const {name} = vec4<f32>({});\n", list(&v)));
    let to_sun = list(&frame.to_sun[..3]);
    let shadow = list(frame.shadow_from_world.as_flattened());
    vectors.concat()
        + &format!("const TO_SUN = vec3<f32>({to_sun});\nconst SHADOW_FROM_WORLD = mat4x4<f32>({shadow});\n")
}

impl ShaderFile {
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
