//! Shadows of what stands on the ground, as people do: a soft patch where little light of the sky arrives, and at night
//! a shadow in the light of each street lamp near it. Neither the shadow map nor the light map of lamps has them.

use super::{Attachments, ScenePipelineState, scene_pipeline};
use crate::shader::Shader;
use city3d_scene::{Class, SceneDescription, SceneObject, TreeShade};
use glam::{Vec2, Vec3};
use gpu_data::Patch;
use wgpu::util::DeviceExt;

pub(crate) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// A dark ellipse on the ground.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
    pub(crate) struct Patch {
        /// Middle, city metres; w: share of the light that it takes.
        pub(crate) at: [f32; 4],
        /// Unit vector along its first axis (xy), and half its axes (zw), metres.
        pub(crate) axes: [f32; 4],
        /// How much weaker it is at the far end of its first axis, 0 to 1.
        pub(crate) fades: f32,
    }

    const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
        wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4, 2 => Float32];

    pub(crate) const LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Patch>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &ATTRIBUTES,
    };
}

/// Vertices up to this height over the lowest one are those that stand on the ground, metres.
const FOOT_M: f32 = 0.25;
/// Wider things are no furniture, and their shadows no ellipses, metres.
const WIDEST_M: f32 = 1.6;
/// How far a patch reaches around a foot, metres.
const SPREAD_M: f32 = 0.30;
/// Height of a patch over the ground, metres.
const OVER_GROUND_M: f32 = 0.03;
/// Shares of the light that patches take: of the sky's, and of the lamps'.
const SKY_SHARE: f32 = 0.70;
const LAMP_SHARE: f32 = 0.92;
/// Share of the light that the shadow of a tree takes, how far its soft edge reaches, and its greatest length in crown radii.
const TREE_SHARE: f32 = 0.62;
/// The same without a sun.
const UNDER_CLOUDS: f32 = 0.30;
const SOFT: f32 = 1.25;
const LONGEST_OF_TREE: f32 = 4.0;
/// Light between the lamps, in units of [`lamplight`].
const ELSEWHERE: f32 = 0.015;
/// Longest shadow, and farthest lamp that casts one, metres.
const LONGEST_M: f32 = 4.5;
const LAMP_REACH_M: f32 = super::lamps::LAMP_REACH_M;
/// Fainter shadows are not drawn.
const FAINTEST: f32 = 0.12;

/// Where an object stands: an ellipse, and how high it is.
#[derive(Clone, Copy, Debug)]
struct Footprint {
    middle: Vec3,
    axis: Vec2,
    half_m: Vec2,
    height_m: f32,
}

impl Footprint {
    /// Of people, poles and furniture; `None` of anything else.
    fn of(object: &SceneObject) -> Option<Self> {
        let mesh = &object.levels.first()?.mesh;
        let class = mesh.vertices.first()?.finish.class;
        if !matches!(class, Class::Person | Class::Pole | Class::Furniture) {
            return None;
        }
        let heights = mesh.vertices.iter().map(|vertex| vertex.position.z);
        let (low, high) = heights.fold((f32::MAX, f32::MIN), |(low, high), z| (low.min(z), high.max(z)));
        let feet = || {
            let on_ground = mesh.vertices.iter().filter(move |vertex| vertex.position.z < low + FOOT_M);
            on_ground.map(|vertex| vertex.position.truncate())
        };
        let count = feet().count() as f32;
        let middle = feet().sum::<Vec2>() / count;
        // Principal axes of the feet, from their covariance.
        let [xx, yy, xy] = feet().map(|at| at - middle).fold([0.0; 3], |[xx, yy, xy], off| {
            [xx + off.x * off.x / count, yy + off.y * off.y / count, xy + off.x * off.y / count]
        });
        let (mean, apart) = (0.5 * (xx + yy), Vec2::new(0.5 * (xx - yy), xy).length());
        let axis = if xx > yy { Vec2::new(mean + apart - yy, xy) } else { Vec2::new(xy, mean + apart - xx) };
        let half_m = Vec2::new(mean + apart, (mean - apart).max(0.0)).map(|variance| 1.5 * variance.sqrt());
        (half_m.x < WIDEST_M).then(|| Self {
            middle: middle.extend(low),
            axis: axis.try_normalize().unwrap_or(Vec2::X),
            half_m: half_m.max(Vec2::splat(0.05)),
            height_m: high - low,
        })
    }

    /// Where little light of the sky arrives.
    fn under(&self) -> Patch {
        let half = self.half_m + SPREAD_M;
        // Whoever is higher hides more of the sky.
        let dark = SKY_SHARE * (self.height_m / 1.2).min(1.0);
        self.patch(Vec2::ZERO, (self.axis, half), (dark, 0.0))
    }

    fn patch(&self, off: Vec2, (axis, half): (Vec2, Vec2), (dark, fades): (f32, f32)) -> Patch {
        let at = self.middle + off.extend(OVER_GROUND_M);
        Patch { at: at.extend(dark).to_array(), axes: [axis.x, axis.y, half.x, half.y], fades }
    }

    /// Shadows in the light of lamps.
    fn in_lamplight(&self, lamps: &[Vec3]) -> Vec<Patch> {
        let foot = self.middle.truncate();
        let near: Vec<Vec3> =
            lamps.iter().filter(|lamp| lamp.truncate().distance(foot) < LAMP_REACH_M).copied().collect();
        let all: f32 = near.iter().map(|lamp| lamplight(*lamp - self.middle)).sum();
        let shadow = |lamp: &Vec3| {
            let from_lamp = foot - lamp.truncate();
            let (distance, above) = (from_lamp.length(), lamp.z - self.middle.z);
            let ahead = from_lamp.try_normalize()?;
            let dark = LAMP_SHARE * lamplight(*lamp - self.middle) / (all + ELSEWHERE);
            let length = (self.height_m * distance / (above - self.height_m).max(0.5)).min(LONGEST_M);
            let width = 0.6 * (self.half_m.x + self.half_m.y) + 0.05;
            let is_seen = dark > FAINTEST && length > 0.3 && above > 1.0;
            let half = Vec2::new(0.5 * length + 0.1, width);
            is_seen.then(|| self.patch(ahead * (0.5 * length), (ahead, half), (dark, 0.75)))
        };
        near.iter().filter_map(shadow).collect()
    }
}

/// The shadow of a tree in the light of the sun, or under clouds.
fn shadow_of(tree: &TreeShade, to_sun: Option<Vec3>) -> Patch {
    let share = if to_sun.is_some() { TREE_SHARE } else { UNDER_CLOUDS };
    // The sky above all is brightest at the zenith.
    let to_sun = to_sun.unwrap_or(Vec3::Z);
    let away = -to_sun.truncate();
    let steepness = to_sun.z.max(0.02) / away.length().max(1e-3);
    let TreeShade { foot, radius_m, height_m } = *tree;
    // Of the middle of the crown; that of a low sun is too thin to be seen to its end.
    let far_m = (0.62 * height_m / steepness).min(LONGEST_OF_TREE * radius_m);
    let longer_m = (0.38 * height_m / steepness).min(LONGEST_OF_TREE * radius_m);
    let ahead = away.normalize_or(Vec2::X);
    let middle = foot + (ahead * far_m).extend(OVER_GROUND_M);
    Patch {
        at: middle.extend(share).to_array(),
        axes: [ahead.x, ahead.y, radius_m.max(longer_m) * SOFT, radius_m * SOFT],
        fades: 0.0,
    }
}

/// Light of a street lamp on the ground at its foot and around it, see `lamp_fragment` in `lamps.wgsl`.
fn lamplight(to_lamp: Vec3) -> f32 {
    let (far, above) = (to_lamp.truncate().length_squared(), to_lamp.z * to_lamp.z);
    let edge = (1.0 - far / (LAMP_REACH_M * LAMP_REACH_M)).max(0.0);
    let fall = above / (above + far).max(1e-3);
    fall * edge * edge
}

/// Pipeline and patches.
#[derive(Debug)]
pub(crate) struct StandingPass {
    pipeline: wgpu::RenderPipeline,
    patches: wgpu::Buffer,
    count: u32,
}

impl StandingPass {
    /// For a scene by day, or at night with its street lamps.
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneDescription,
        (to_sun, is_lamplit): (Option<Vec3>, bool),
    ) -> Self {
        let lamps: &[Vec3] = if is_lamplit { &scene.lamps } else { &[] };
        let feet = scene.objects.iter().filter_map(Footprint::of);
        let mut patches: Vec<Patch> =
            feet.flat_map(|feet| std::iter::once(feet.under()).chain(feet.in_lamplight(lamps))).collect();
        if !is_lamplit {
            patches.extend(scene.shades.iter().map(|tree| shadow_of(tree, to_sun)));
        }
        let pipeline = scene_pipeline(
            device,
            attachments,
            &ScenePipelineState {
                shader: Shader::Standing,
                module: &Shader::Standing.module(device, None),
                entries: ["vertex_main", "fragment_main"],
                groups: &[Some(frame)],
                buffers: &[Some(gpu_data::LAYOUT)],
                constants: &[],
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                cull_back_faces: false,
                blend: Some(super::contact::DARKENING),
                alpha_to_coverage: false,
                write_depth: false,
            },
        );
        Self {
            pipeline,
            count: patches.len() as u32,
            patches: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("shadows of what stands"),
                contents: bytemuck::cast_slice(&patches),
                usage: wgpu::BufferUsages::VERTEX,
            }),
        }
    }

    /// Draws all patches. The caller has set bind group 0.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        if self.count > 0 {
            pass.set_pipeline(&self.pipeline);
            pass.set_vertex_buffer(0, self.patches.slice(..));
            pass.draw(0..4, 0..self.count);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_scene::{Finish, Mesh, Surface};

    /// A post of 1.6 m whose foot is three times as long as wide.
    fn post(class: Class) -> SceneObject {
        let mut mesh = Mesh::default();
        let finish = Finish::new(Surface::Plain, [90; 3], class);
        let corner = |x: f32, y: f32, z: f32| Vec3::new(4.0 + 0.3 * x, 2.0 + 0.1 * y, 0.12 + z);
        mesh.face(
            &[corner(-1.0, -1.0, 0.0), corner(1.0, -1.0, 0.0), corner(1.0, 1.0, 0.0), corner(-1.0, 1.0, 0.0)],
            &[Vec2::ZERO; 4],
            finish,
        );
        mesh.face(
            &[corner(0.0, 0.0, 0.3), corner(1.0, 0.0, 1.6), corner(0.0, 1.0, 1.6)],
            &[Vec2::ZERO; 3],
            finish,
        );
        SceneObject::of_one_level(mesh)
    }

    #[test]
    fn a_patch_lies_around_feet_and_shadows_point_away_from_lamps() {
        let feet = Footprint::of(&post(Class::Person)).expect("a person has feet");
        assert!(feet.middle.distance(Vec3::new(4.0, 2.0, 0.12)) < 1e-4, "{feet:?}");
        assert!(feet.axis.x.abs() > 0.99 && feet.half_m.x > 2.0 * feet.half_m.y, "{feet:?}");
        let shadows = feet.in_lamplight(&[Vec3::new(0.0, 2.0, 6.0), Vec3::new(90.0, 2.0, 6.0)]);
        let [shadow] = shadows.as_slice() else { panic!("one lamp is near: {shadows:?}") };
        // By similar triangles the shadow of the top is 4 m * 1.6 / (5.88 - 1.6) beyond the foot.
        assert!((shadow.at[0] - (4.0 + 0.5 * 4.0 * 1.6 / 4.28)).abs() < 1e-3, "{shadow:?}");
        assert!(shadow.axes[0] > 0.99);
    }

    #[test]
    fn houses_and_trees_have_no_patches() {
        assert!(Footprint::of(&post(Class::Building)).is_none());
        assert!(Footprint::of(&post(Class::Vegetation)).is_none());
    }
}
