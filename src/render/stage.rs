//! One opened adapter with all that it takes to draw a scene: views of one instant go to it in one submission and come
//! back through one buffer.

use super::atlas::Atlas;
use super::clock::Clock;
use super::daylight::Light;
use super::develop::Develop;
use super::fleet::{Fleet, Sight};
use super::frustum::{Frustum, Sharpness};
use super::grid::Tile;
use super::horizon::Sector;
use super::kinds::{self, KindsDrawing, KindsTile};
use super::passes::city::CityPass;
use super::passes::common::{FrameGroup, gpu_data};
use super::passes::contact::ContactPass;
use super::passes::glow::GlowPass;
use super::passes::lamps::LampPass;
use super::passes::light::LightGroup;
use super::passes::shadow::{ShadowPass, SunView};
use super::passes::sky::SkyPass;
use super::passes::vehicle::VehiclePass;
use super::passes::{Attachments, light_constants};
use super::readback::{PendingPart, Ring};
use super::request::{Places, Request, places};
use super::standing::{Apart, Gaze, Patterns, SeenCells, Sorted, Standing};
use super::textures::Paintings;
use super::{Context, Settings, TargetView};
use crate::camera::View;
use crate::city::scene::SceneDescription;
use crate::model::Model;
use crate::snapshot::{BodyType, FrameSnapshot};
use glam::{DMat4, DVec3, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Draws one scene and whatever drives in it on one opened adapter.
#[derive(Debug)]
pub(super) struct Stage {
    context: Context,
    settings: Settings,
    /// How many views of a batch are drawn in one pass.
    views_at_once: usize,
    attachments: Attachments,
    frame: FrameGroup,
    light: LightGroup,
    shadow: ShadowPass,
    lamps: LampPass,
    daylight: Light,
    city: CityPass,
    vehicles: VehiclePass,
    contact: ContactPass,
    sky: SkyPass,
    /// Where lamps burn.
    glow: Option<GlowPass>,
    /// Where samples are radiance.
    develop: Option<Develop>,
    /// From the first picture that is no colour on.
    kinds: Option<KindsDrawing>,
    standing: Standing,
    fleet: Fleet,
    clock: Option<Clock>,
    /// The frame but for its time.
    fixed: gpu_data::Frame,
    atlases: BTreeMap<[u32; 2], Atlas>,
    ring: Ring,
    /// Of a view of the last batch, in the mean.
    triangles: u64,
    /// Depth and samples of the targets that were drawn to last, by their extents.
    targets: BTreeMap<[u32; 2], Atlas>,
}

/// What a view may see: found once, drawn by each of its passes.
#[derive(Debug)]
pub(super) struct Seen {
    pub(super) vehicles: Vec<Sight>,
    pub(super) cells: SeenCells,
    /// Rows from the top in which more may be seen than the vehicle that carries the camera.
    pub(super) open_rows: u32,
}

/// What is made of a scene before any adapter is needed, for all of them.
#[derive(Debug)]
pub(super) struct Made {
    paintings: Paintings,
    sorted: Sorted,
}

impl Made {
    pub(super) fn new(scene: &SceneDescription, paintings: Paintings) -> Self {
        let light = &paintings.light;
        // By night every surface looks for the light of lamps.
        let apart = match (paintings.settings.quality.light_at_vertices, light.is_lamplit()) {
            (false, _) => Some(Apart::Crowns),
            (true, false) => Some(Apart::Averted(light.to_sun)),
            (true, true) => None,
        };
        Self { sorted: Sorted::new(scene, apart), paintings }
    }
}

impl Stage {
    /// Uploads a scene and builds the pipelines. So many views of a batch are drawn in one pass at most.
    pub(super) fn new(
        context: &Context,
        (scene, made): (&SceneDescription, &Made),
        settings: Settings,
        views_at_once: usize,
    ) -> Self {
        let device = &context.device;
        let quality = settings.quality;
        let light_at_vertices = quality.light_at_vertices;
        let attachments = Attachments::new(&settings);
        let frame = FrameGroup::new(device);
        let Made { paintings, sorted } = made;
        let daylight = &paintings.light;
        let sun_view = SunView::around(scene.bounds, daylight.to_sun, quality.shadow_texels);
        let shadow = ShadowPass::new(device, &frame.layout, sun_view);
        let lamplit = daylight.is_lamplit();
        let constants = light_constants(&settings, daylight);
        let lamp_texels = if !lamplit {
            1
        } else if light_at_vertices {
            512
        } else {
            1024
        };
        let lamps = LampPass::new(device, &frame.layout, scene, (lamp_texels, !light_at_vertices));
        let light = LightGroup::new(context, &shadow.map, &lamps.map_view, &paintings.sky_map(context));
        let fixed = fixed_frame(daylight, &sun_view, quality.shadow_texels, lamps.place);
        let groups = [&frame.layout, &light.layout];
        let mut stage = Self {
            city: CityPass::new(context, attachments, &quality, (&fixed, &constants), groups, paintings),
            vehicles: VehiclePass::new(device, attachments, (&fixed, &constants), groups),
            contact: ContactPass::new(device, attachments, &frame.layout),
            sky: SkyPass::new(context, attachments, paintings, groups),
            glow: lamplit.then(|| GlowPass::new(device, attachments, &frame.layout, &scene.lamps)),
            develop: (!light_at_vertices).then(|| Develop::new(device, attachments, quality, &frame.layout)),
            kinds: None,
            standing: Standing::new(device, sorted),
            fleet: Fleet::new(device, settings.flat.is_none()),
            clock: None,
            context: context.clone(),
            settings,
            views_at_once,
            attachments,
            frame,
            light,
            shadow,
            lamps,
            daylight: *daylight,
            fixed,
            atlases: BTreeMap::new(),
            ring: Ring::default(),
            triangles: 0,
            targets: BTreeMap::new(),
        };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        stage.frame.write_frame(&context.queue, &stage.frame_data(0.0));
        stage.shadow.draw_standing(&mut encoder, &stage.frame, &stage.standing);
        if lamplit {
            stage.lamps.draw_standing(context, &mut encoder, &stage.frame, &scene.lamps);
        }
        context.queue.submit([encoder.finish()]);
        stage
    }

    /// Draws vehicles of a body type with a model, stretched to the measures of each.
    pub(super) fn set_vehicle_model(&mut self, body: BodyType, model: Arc<Model>) {
        self.fleet.set_model(body, model);
    }

    /// How many triangles a view of the last batch was given in the mean, without the sky.
    pub(super) fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Has the adapter take the time of each batch from now on, where it can.
    pub(super) fn keep_time(&mut self) {
        self.clock = Clock::new(&self.context);
    }

    pub(super) fn stop_keeping_time(&mut self) {
        self.clock = None;
    }

    /// Seconds that the adapter took for the last batch, which is waited for; `None` unless it keeps time.
    pub(super) fn seconds_of_last_batch(&self) -> Option<f64> {
        self.clock.as_ref()?.seconds(&self.context.device)
    }

    /// Submits the drawing of all pictures and returns at once. What a view may see is found once for all its kinds.
    pub(super) fn begin(&mut self, snapshot: &FrameSnapshot, requests: &[Request]) -> PendingPart {
        let views: Vec<View> = requests.iter().map(|request| request.view).collect();
        let mut encoder = self.prepare(snapshot, &views);
        let (places, bytes) = places(requests);
        if places.iter().any(|place| place.depth.or(place.meaning).is_some()) {
            let device = &self.context.device;
            let drawing = self.kinds.get_or_insert_with(|| KindsDrawing::new(device));
            drawing.pass.write(device, &self.context.queue, &views);
        }
        let seen = self.look_at(&views);
        if let Some(clock) = &self.clock {
            clock.start(&mut encoder);
        }
        let buffer = self.ring.take(&self.context.device, bytes.max(4));
        let mut by_extent: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
        for (index, view) in views.iter().enumerate() {
            by_extent.entry(view.extent).or_default().push(index);
        }
        for (&extent, indices) in &by_extent {
            self.draw_colors(&mut encoder, (extent, indices), (&places, &seen), &buffer);
            self.draw_kinds(&mut encoder, (extent, indices), (&places, &seen), &buffer);
        }
        if let Some(clock) = &self.clock {
            clock.stop(&mut encoder);
        }
        let submission = self.context.queue.submit([encoder.finish()]);
        self.ring.send(&self.context.device, (buffer, submission), (places, self.attachments.shown))
    }

    /// Draws those of some views of one extent that are wanted in colour.
    fn draw_colors(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        (extent, indices): ([u32; 2], &[usize]),
        (places, seen): (&[Places], &[Seen]),
        buffer: &wgpu::Buffer,
    ) {
        let wanted: Vec<(usize, u64)> =
            indices.iter().filter_map(|&index| Some((index, places[index].color?))).collect();
        if wanted.is_empty() {
            return;
        }
        self.make_atlas(extent, wanted.len());
        let Some(atlas) = self.atlases.get(&extent) else { return };
        for batch in wanted.chunks(atlas.grid.capacity) {
            let tiles: Vec<_> = batch
                .iter()
                .enumerate()
                .map(|(tile, &(index, _))| (index, atlas.grid.origin(tile)))
                .collect();
            let target = (&atlas.color_view, self.attachments.shown);
            self.draw_tiles(encoder, atlas, target, seen, &tiles);
            for (tile, &(_, at)) in batch.iter().enumerate() {
                atlas.grid.copy_tile(encoder, (&atlas.color, tile), (buffer, at));
            }
        }
    }

    /// Draws those of some views of one extent that are wanted in other kinds.
    fn draw_kinds(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        (extent, indices): ([u32; 2], &[usize]),
        (places, seen): (&[Places], &[Seen]),
        buffer: &wgpu::Buffer,
    ) {
        let room = (buffer, self.settings.batch_bytes, self.views_at_once);
        let Some(drawing) = &mut self.kinds else { return };
        let tiles: Vec<KindsTile> = indices
            .iter()
            .map(|&view| KindsTile { view, depth_at: places[view].depth, meaning_at: places[view].meaning })
            .filter(|tile| tile.depth_at.or(tile.meaning_at).is_some())
            .collect();
        let scene = kinds::Scene { standing: &self.standing, fleet: &self.fleet, seen };
        drawing.draw(&self.context.device, encoder, scene, (extent, &tiles), room);
    }

    /// Draws views of one instant into targets, each view into the target of the same index.
    pub(super) fn draw(&mut self, snapshot: &FrameSnapshot, views: &[View], targets: &[TargetView<'_>]) {
        let mut encoder = self.prepare(snapshot, views);
        self.targets.retain(|extent, _| targets.iter().any(|target| target.extent == *extent));
        let seen = self.look_at(views);
        for (index, target) in targets.iter().enumerate().take(views.len()) {
            if !self.targets.contains_key(&target.extent) {
                self.targets.insert(target.extent, self.new_atlas(target.extent, 1));
            }
            if let Some(develop) = &mut self.develop {
                develop.prepare(&self.context.device, &self.frame.layout, target.format);
            }
            if let Some(atlas) = self.targets.get(&target.extent) {
                let place = (target.color, target.format);
                self.draw_tiles(&mut encoder, atlas, place, &seen, &[(index, [0, 0])]);
            }
        }
        self.context.queue.submit([encoder.finish()]);
    }

    /// Writes what all views share and brings the shadows up to date.
    fn prepare(&mut self, snapshot: &FrameSnapshot, views: &[View]) -> wgpu::CommandEncoder {
        self.fleet.update(&self.context, snapshot);
        let slots: Vec<gpu_data::View> = views.iter().map(gpu_data::View::new).collect();
        let frame = self.frame_data(snapshot.time_s as f32);
        let device = &self.context.device;
        self.frame.write(device, &self.context.queue, &frame, &slots);
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.shadow.draw_vehicles(&mut encoder, &self.frame, &self.fleet);
        if self.daylight.is_lamplit() {
            self.lamps.draw_vehicles(&self.context, &mut encoder, &self.frame, &self.fleet);
        }
        if let Some(glow) = &mut self.glow {
            glow.write(&self.context, &self.fleet);
        }
        encoder
    }

    fn new_atlas(&self, extent: [u32; 2], views: usize) -> Atlas {
        let bytes = self.settings.batch_bytes;
        Atlas::new(&self.context.device, (extent, views), self.attachments, self.develop.as_ref(), bytes)
    }

    /// Sees to an atlas for views of an extent.
    fn make_atlas(&mut self, extent: [u32; 2], views: usize) {
        let views = views.min(self.views_at_once);
        if !self.atlases.get(&extent).is_some_and(|atlas| atlas.grid.suits(views)) {
            let atlas = self.new_atlas(extent, views);
            self.atlases.insert(extent, atlas);
        }
    }

    fn draw_tiles(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        atlas: &Atlas,
        target: (&wgpu::TextureView, wgpu::TextureFormat),
        seen: &[Seen],
        tiles: &[(usize, [u32; 2])],
    ) {
        self.draw_samples(encoder, atlas, target.0, seen, tiles);
        if let Some((develop, negative)) = self.develop.as_ref().zip(atlas.negative.as_ref()) {
            develop.draw(encoder, (&self.frame, negative), target, (tiles, atlas.grid.tile));
        }
    }

    /// Draws tiles of an atlas: radiance into its samples, or what is shown into a target.
    fn draw_samples(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        atlas: &Atlas,
        color: &wgpu::TextureView,
        seen: &[Seen],
        tiles: &[(usize, [u32; 2])],
    ) {
        let haze = self.daylight.haze_srgb;
        let haze = if self.develop.is_some() { self.daylight.radiance_of(haze) } else { haze };
        let [r, g, b] = haze.map(f64::from);
        // Ambient occlusion takes nothing of it.
        let a = if self.develop.is_some() { 0.0 } else { 1.0 };
        let load = wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a });
        let keep = wgpu::Operations { load, store: wgpu::StoreOp::Store };
        let drop = wgpu::Operations { load, store: wgpu::StoreOp::Discard };
        let (view, resolve_target, ops) = match &atlas.samples_view {
            Some(samples) if self.develop.is_some() => (samples, None, keep),
            Some(samples) => (samples, Some(color), drop),
            None => (color, None, keep),
        };
        let attachment = wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target, ops };
        let depth_store = if self.develop.is_some() { wgpu::StoreOp::Store } else { wgpu::StoreOp::Discard };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("pictures"),
            color_attachments: &[Some(attachment)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &atlas.depth_view,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: depth_store }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let extent = atlas.grid.tile;
        for &(index, origin) in tiles {
            pass.set_bind_group(0, &self.frame.group, &[FrameGroup::offset(index)]);
            pass.set_bind_group(1, &self.light.group, &[]);
            self.draw_view(&mut pass, Tile { origin, extent }, &seen[index]);
        }
    }

    /// What each view may see, with the lists of the city's triangles on their way to the adapter.
    fn look_at(&mut self, views: &[View]) -> Vec<Seen> {
        let mut lists = Vec::new();
        let open_rows: Vec<u32> = views.iter().map(|view| self.fleet.open_rows(view)).collect();
        let look = |(view, open_rows)| self.look(view, open_rows, &mut lists);
        let seen: Vec<Seen> = views.iter().zip(open_rows).map(look).collect();
        let count = |seen: &Seen| seen.cells.triangles() + self.fleet.triangles(&seen.vehicles);
        self.triangles = seen.iter().map(count).sum::<u64>() / (seen.len() as u64).max(1);
        self.standing.write(&self.context.device, &self.context.queue, &lists);
        seen
    }

    fn look(&self, view: &View, open_rows: u32, lists: &mut Vec<u32>) -> Seen {
        let in_full = view.clip_from_world();
        let clip_from_world = in_full.as_mat4();
        let whole = Frustum::new(&clip_from_world);
        let frustum = whole.upper(open_rows as f32 / view.extent[1] as f32);
        let eye = view.extrinsics.position.as_vec3();
        let sector = Sector::of_view(&looks_to_corners(view.extrinsics.position, &in_full));
        let horizon = self.standing.horizon(view.has_eye().then_some(eye), sector, &frustum);
        let gaze = Gaze {
            frustum: &frustum,
            horizon: &horizon,
            sharpness: Sharpness::new(&clip_from_world, view.extent[1]),
            eye,
            has_eye: view.has_eye(),
            coarse_below_px: self.settings.quality.coarse_below_px,
            least_px: self.settings.quality.least_px,
            patterns: match (self.settings.flat, self.settings.quality.light_at_vertices) {
                (Some(_), _) => Patterns::None,
                (None, true) => Patterns::Near,
                (None, false) => Patterns::All,
            },
        };
        let cells = self.standing.see(&gaze, lists);
        let vehicles = self.fleet.seen(&Gaze { frustum: &whole, ..gaze }, view.carrier);
        Seen { vehicles, cells, open_rows }
    }

    fn draw_view(&self, pass: &mut wgpu::RenderPass<'_>, tile: Tile, seen: &Seen) {
        tile.enter(pass);
        // Nearest first, as far as can be told: what is hidden costs no shading.
        self.vehicles.draw(pass, &self.fleet, &seen.vehicles);
        tile.keep_to(pass, seen.open_rows);
        self.city.draw(pass, &self.standing, &seen.cells);
        if self.settings.flat.is_none() {
            self.sky.draw(pass);
            self.contact.draw(pass, &self.fleet, &seen.vehicles);
        }
        if let Some(glow) = &self.glow {
            glow.draw(pass, &seen.vehicles);
        }
    }

    /// The frame of a time in seconds.
    fn frame_data(&self, time_s: f32) -> gpu_data::Frame {
        let mut frame = self.fixed;
        frame.to_sun[3] = time_s;
        frame
    }
}

/// From the eye of a view towards the corners of its picture, one after the other.
fn looks_to_corners(eye: DVec3, clip_from_world: &DMat4) -> [Vec3; 4] {
    let world_from_clip = clip_from_world.inverse();
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| {
        let corner = world_from_clip.project_point3(DVec3::new(x, y, 0.5));
        (corner - eye).as_vec3()
    })
}

/// What a frame says that stays as it is: all but the time.
fn fixed_frame(
    light: &Light,
    sun_view: &SunView,
    shadow_texels: u32,
    lamp_place: [f32; 4],
) -> gpu_data::Frame {
    let with = |[r, g, b]: [f32; 3], w: f32| [r, g, b, w];
    gpu_data::Frame {
        to_sun: light.to_sun.extend(0.0).to_array(),
        sun: with(light.sun, light.exposure),
        sky_light: with(light.sky, 0.0),
        ground_light: with(light.ground, 0.0),
        haze: with(light.radiance_of(light.haze_srgb), 1.0 / 520.0),
        shadow_from_world: sun_view.shadow_from_world.to_cols_array_2d(),
        shadow_texel: [1.0 / shadow_texels as f32, sun_view.texel_m, 0.0, 0.0],
        zenith: with(light.zenith, light.lamps),
        lamp_place,
    }
}
