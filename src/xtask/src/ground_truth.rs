//! Ground truth from random places of a city: whether a ray that points down hits something, and whether all quality
//! presets show the same classes and vehicles.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

use city3d_geometry::{LengthScale, point_in_polygon};
use city3d_models::Model;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_render::{AdapterPreference, Context, Pictures, Quality, RenderRequest, Renderer, Settings};
use city3d_roadmap::{CityMap, Footprint, Grid, GridSize, SceneryKind, load_map};
use city3d_scene::{Class, SceneDescription};
use city3d_sensors::{Extrinsics, Lens, PictureKind, PictureKinds, Projection, View};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{ScenarioRequest, is_map, map_alone};
use clap::Args;
use glam::{DVec2, DVec3, Vec3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::error::Error;
use std::fmt;
use std::sync::Arc;

#[derive(Debug, Args)]
pub struct GroundTruthArgs {
    /// Scenarios, maps (.dxf), or sizes of grids such as 3x2
    #[arg(default_values = ["city", "3x2"])]
    cities: Vec<String>,
    /// Random views of each city
    #[arg(long, default_value_t = 2000)]
    views: usize,
    /// Seed of the views
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Graphics adapter: "software", or a part of its name [default: the best one] [env: CITY3D_ADAPTER]
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

/// Heights of the cameras, metres: as many of them between 1 and 2 m as between 100 and 200 m.
const HEIGHTS_M: [f64; 2] = [0.3, 200.0];
/// So far around the city cameras stand, and those of the land, which are this share of all.
const AROUND_M: f64 = 20.0;
const IN_LAND_M: f64 = 1000.0;
const IN_LAND: f64 = 0.3;
const PITCHES_DEG: [f64; 2] = [-89.0, 5.0];
const FIELDS_OF_VIEW_DEG: [f64; 2] = [25.0, 100.0];
const EXTENT: [u32; 2] = [160, 120];
/// Views along kerbs, and the least length of a kerb in a straight line.
const KERB_VIEWS: usize = 64;
const LEAST_KERB_M: f32 = 4.0;
/// Rays that point down by less may miss the ground.
const LEAST_DIP_DEG: f64 = 2.0;
/// Pixels no farther than this from another class or vehicle are not compared.
const EDGE_PX: i32 = 2;
/// Share of the compared pixels that have to agree.
pub const LEAST_AGREEMENT: f64 = 0.995;
/// Views that are drawn together.
const BATCH: usize = 64;

/// Draws random views of cities, and fails if ground truth is wrong.
pub fn ground_truth(args: &GroundTruthArgs) -> Result<(), Box<dyn Error + Send + Sync>> {
    let preference =
        args.adapter.as_deref().map_or_else(AdapterPreference::from_environment, AdapterPreference::parse);
    let context = Context::for_batches(&preference)?;
    let mut is_right = true;
    for name in &args.cities {
        let report = City::read(name)?.check(&context, args.views, args.seed)?;
        print!("{name}: {report}");
        is_right &= report.is_right();
    }
    if is_right { Ok(()) } else { Err("ground truth is wrong".into()) }
}

/// A city at the first instant of its scenario.
#[derive(Debug)]
pub struct City {
    map: CityMap,
    scene: SceneDescription,
    /// The same without levels for cameras close by, as `low` draws it.
    plain: SceneDescription,
    snapshot: FrameSnapshot,
}

/// What pictures of a number of views show.
#[derive(Clone, Debug, Default)]
pub struct Report {
    views: usize,
    /// Pixels of rays that point down, in all presets.
    downward: u64,
    /// Views with such pixels that show nothing, by preset.
    pub holes: Vec<Hole>,
    /// Of each preset, against the finest: pixels compared, and those of the same class and vehicle.
    pub presets: Vec<Agreement>,
}

/// A view into nothing below the horizon.
#[derive(Clone, Debug)]
pub struct Hole {
    preset: &'static str,
    pixels: usize,
    eye: DVec3,
    /// Direction of the first pixel.
    ray: DVec3,
}

/// How many pixels of a preset agree with those of the finest one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Agreement {
    preset: &'static str,
    compared: u64,
    class: u64,
    instance: u64,
}

impl Agreement {
    /// Shares of pixels with the same class and the same vehicle.
    pub fn shares(&self) -> [f64; 2] {
        [self.class, self.instance].map(|same| same as f64 / self.compared.max(1) as f64)
    }
}

impl Report {
    /// Whether no view has a hole, and all presets agree.
    pub fn is_right(&self) -> bool {
        let agree = |preset: &Agreement| preset.shares().into_iter().all(|share| share >= LEAST_AGREEMENT);
        self.downward > 0 && self.holes.is_empty() && self.presets.iter().all(agree)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} views, {} pixels below the horizon", self.views, self.downward)?;
        for Hole { preset, pixels, eye, ray } in &self.holes {
            writeln!(f, "  {preset}: nothing in {pixels} pixels from {eye:.2}, first along {ray:.4}")?;
        }
        for agreement in &self.presets {
            let [class, instance] = agreement.shares().map(|share| 100.0 * share);
            let Agreement { preset, compared, .. } = agreement;
            writeln!(f, "  {preset}: {class:.3} % of class, {instance:.3} % of instance, {compared} pixels")?;
        }
        Ok(())
    }
}

/// The scene of a map with and without levels for cameras close by.
fn scenes(map: &CityMap, models: &BTreeMap<String, Arc<Model>>) -> [SceneDescription; 2] {
    [true, false].map(|has_close_ups| SceneDescription::with_close_ups(map, models, has_close_ups))
}

impl City {
    /// Reads a scenario, a map, or makes a grid of a size.
    pub fn read(name: &str) -> Result<Self, Box<dyn Error + Send + Sync>> {
        if let Ok(size) = name.parse::<GridSize>() {
            let grid = Grid { size, block_m: 3.0, entry_m: 3.0, ..Grid::default() };
            let map = load_map(grid.to_dxf()?.as_bytes())?.map.to_city(LengthScale::TESTBED);
            let [scene, plain] = scenes(&map, &BTreeMap::new());
            return Ok(Self { map, scene, plain, snapshot: FrameSnapshot::default() });
        }
        let request = ScenarioRequest { scenario: name.to_owned(), ..ScenarioRequest::default() };
        let experiment = if is_map(&request) { map_alone(&request)? } else { request.read()? };
        let [scene, plain] = scenes(&experiment.city_map, &experiment.models.placed);
        let map = (*experiment.city_map).clone();
        let snapshot = Run::new(Arc::new(experiment))?.snapshot().clone();
        Ok(Self { map, scene, plain, snapshot })
    }

    /// Draws random views, and some along kerbs, in every preset.
    pub fn check(
        &self,
        context: &Context,
        views: usize,
        seed: u64,
    ) -> Result<Report, Box<dyn Error + Send + Sync>> {
        let mut draws = ChaCha8Rng::seed_from_u64(seed);
        let kinds: PictureKinds =
            [PictureKind::Depth, PictureKind::Semantic, PictureKind::Instance].into_iter().collect();
        let random = (0..views).map(|_| self.random_view(&mut draws));
        let drawn = random.chain(self.views_along_kerbs());
        let requests: Vec<RenderRequest> = drawn.map(|view| RenderRequest { view, kinds }).collect();
        let [others @ .., (finest, finest_quality)] = Quality::PRESETS;
        let renderer = |quality: Quality| {
            // Shadows are in none of the pictures.
            let quality = Quality { shadow_texels: 512, ..quality };
            let scene = if quality.vertex_lit { &self.plain } else { &self.scene };
            Renderer::new(context, scene, Settings { quality, ..Settings::default() })
        };
        let mut reference = renderer(finest_quality)?;
        let mut drawn = others
            .map(|(preset, quality)| Ok((Agreement { preset, ..Agreement::default() }, renderer(quality)?)))
            .into_iter()
            .collect::<Result<Vec<_>, city3d_render::RenderError>>()?;
        let mut report = Report { views: requests.len(), ..Report::default() };
        for batch in requests.chunks(BATCH) {
            let expected = reference.render_kinds(&self.snapshot, batch)?;
            report.look(finest, batch, &expected);
            for (agreement, renderer) in &mut drawn {
                let found = renderer.render_kinds(&self.snapshot, batch)?;
                report.look(agreement.preset, batch, &found);
                expected.iter().zip(&found).for_each(|(expected, found)| agreement.add(expected, found));
            }
        }
        report.presets = drawn.into_iter().map(|(agreement, _)| agreement).collect();
        Ok(report)
    }

    /// A view from outside of all buildings.
    fn random_view(&self, draws: &mut ChaCha8Rng) -> View {
        let mut unit = || f64::from(draws.next_u32()) / f64::from(u32::MAX);
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * unit();
        let [low, high] = self.map.bounds();
        let height = between(HEIGHTS_M.map(f64::ln)).exp();
        let around_m = if between([0.0, 1.0]) < IN_LAND { IN_LAND_M } else { AROUND_M };
        let at = loop {
            let x = between([low.x - around_m, high.x + around_m]);
            let at = DVec2::new(x, between([low.y - around_m, high.y + around_m]));
            if height > f64::from(self.scene.bounds[1].z) || !self.is_built(at) {
                break at;
            }
        };
        let (yaw, pitch) = (between([0.0, std::f64::consts::TAU]), between(PITCHES_DEG).to_radians());
        let lens = Lens {
            vertical_fov_rad: between(FIELDS_OF_VIEW_DEG).to_radians(),
            extent: EXTENT,
            ..Lens::default()
        };
        let ahead = DVec2::from_angle(yaw) * pitch.cos();
        let eye = at.extend(height + self.ground_m(at));
        View::new(Extrinsics::looking_at(eye, eye + ahead.extend(pitch.sin())), &lens)
    }

    /// Views from high above straight along the faces of kerbs, from a little behind them: there an edge of the road and one
    /// of the pavement fall together.
    fn views_along_kerbs(&self) -> Vec<View> {
        let mut faces = Vec::new();
        for level in self.scene.ground.iter().filter_map(|object| object.levels.first()) {
            let corner = |k: u32| level.mesh.vertices[k as usize].position;
            let triangles = level.mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(corner));
            faces.extend(triangles.filter_map(|[a, b, c]| {
                let normal = (b - a).cross(c - a).normalize_or_zero();
                let is_kerb = normal.z.abs() < 0.01 && a.z == 0.0 && b.z == 0.0;
                (is_kerb && a.distance(b) > LEAST_KERB_M).then_some([a, b, normal])
            }));
        }
        let step = (faces.len() / KERB_VIEWS).max(1);
        let view = |(k, [a, b, normal]): (usize, &[Vec3; 3])| {
            let height_m = 60.0 + 130.0 * (k % 16) as f32 / 16.0;
            let middle = (a + b) / 2.0;
            let aside = (b - a).normalize_or_zero() * (0.2 * height_m) - normal * (0.002 * height_m);
            let eye = middle + aside + Vec3::Z * height_m;
            let vertical_fov_rad = FIELDS_OF_VIEW_DEG[k % 2].to_radians();
            let lens = Lens { vertical_fov_rad, extent: EXTENT, ..Lens::default() };
            View::new(Extrinsics::looking_at(eye.as_dvec3(), middle.as_dvec3()), &lens)
        };
        faces.iter().step_by(step).take(KERB_VIEWS).enumerate().map(view).collect()
    }

    /// Height of the ground at a place.
    fn ground_m(&self, at: DVec2) -> f64 {
        let at = at.as_vec2();
        let height = |[a, b, c]: [Vec3; 3]| {
            let (p, q, r) = ((b - a).truncate(), (c - a).truncate(), at - a.truncate());
            let doubled = p.perp_dot(q);
            let (along, across) = (r.perp_dot(q) / doubled, p.perp_dot(r) / doubled);
            let is_inside = doubled > 1e-6 && along >= 0.0 && across >= 0.0 && along + across <= 1.0;
            is_inside.then_some(a.z + along * (b.z - a.z) + across * (c.z - a.z))
        };
        let levels = self.scene.ground.iter().filter_map(|object| object.levels.first());
        let heights = levels.flat_map(|level| {
            let corner = |k: u32| level.mesh.vertices[k as usize].position;
            level.mesh.indices.chunks_exact(3).filter_map(move |t| height([t[0], t[1], t[2]].map(corner)))
        });
        f64::from(heights.fold(0.0, f32::max))
    }

    /// Whether a building stands there.
    fn is_built(&self, at: DVec2) -> bool {
        self.map.scenery.iter().filter(|piece| piece.kind == SceneryKind::Building).any(|piece| match &piece
            .shape
        {
            Footprint::Circle { centre, radius_m } => centre.distance(at) < *radius_m,
            Footprint::Polygon(ring) | Footprint::Polyline(ring) => point_in_polygon(at, ring),
        })
    }
}

impl Report {
    /// Looks for pixels that show nothing below the horizon.
    fn look(&mut self, preset: &'static str, requests: &[RenderRequest], pictures: &[Pictures]) {
        for (RenderRequest { view, .. }, pictures) in requests.iter().zip(pictures) {
            let (Some(depth), Some(semantic)) = (&pictures.depth, &pictures.semantic) else { continue };
            let mut missing = Vec::new();
            for (k, (&depth_m, &class)) in depth.values.iter().zip(&semantic.values).enumerate() {
                let Some(ray) = ray(view, k as u32 % depth.width, k as u32 / depth.width) else { continue };
                if ray.z > -LEAST_DIP_DEG.to_radians().sin() {
                    continue;
                }
                self.downward += 1;
                if class == Class::Sky as u8 || depth_m == 0.0 || !depth_m.is_finite() {
                    missing.push(ray);
                }
            }
            if let Some(&ray) = missing.first() {
                let (pixels, eye) = (missing.len(), view.extrinsics.position);
                self.holes.push(Hole { preset, pixels, eye, ray });
            }
        }
    }
}

/// Direction of a pixel's ray in the city frame.
fn ray(view: &View, x: u32, y: u32) -> Option<DVec3> {
    let Projection::Pinhole { intrinsics: k, .. } = view.projection else { return None };
    let in_camera = DVec3::new((f64::from(x) - k.cx) / k.fx, (f64::from(y) - k.cy) / k.fy, 1.0);
    (view.extrinsics.orientation * in_camera).try_normalize()
}

impl Agreement {
    /// Compares pixels away from the edges of the expected picture.
    fn add(&mut self, expected: &Pictures, found: &Pictures) {
        let planes = (&expected.semantic, &expected.instance, &found.semantic, &found.instance);
        let (Some(classes), Some(instances), Some(found_classes), Some(found_instances)) = planes else {
            return;
        };
        let (width, height) = (classes.width as i32, classes.height as i32);
        let label = |x: i32, y: i32| (classes.at(x as u32, y as u32), instances.at(x as u32, y as u32));
        for y in EDGE_PX..height - EDGE_PX {
            for x in EDGE_PX..width - EDGE_PX {
                let here = label(x, y);
                let mut around =
                    (-EDGE_PX..=EDGE_PX).flat_map(|dy| (-EDGE_PX..=EDGE_PX).map(move |dx| (dx, dy)));
                if around.all(|(dx, dy)| label(x + dx, y + dy) == here) {
                    let (x, y) = (x as u32, y as u32);
                    self.compared += 1;
                    self.class += u64::from(found_classes.at(x, y) == here.0);
                    self.instance += u64::from(found_instances.at(x, y) == here.1);
                }
            }
        }
    }
}
