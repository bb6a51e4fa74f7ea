//! Renderer of one GPU device: records and submits the passes of a batch of views in one command buffer and copies the
//! pictures into one staging buffer.

use super::atlas::Atlas;
use super::daylight::Light;
use super::fleet::{FleetRenderer, OwnVehicle, VisibleVehicle};
use super::frame_constants::constant_frame;
use super::frustum::{Frustum, PixelScale, corner_rays};
use super::geometry::DrawBucket;
use super::gpu_timer::GpuTimer;
use super::grid::Tile;
use super::ground_truth::{self, GroundTruthRenderer, GroundTruthTile};
use super::jitter::SubpixelJitter;
use super::occlusion_horizon::AzimuthSector;
use super::passes::city::{CityPass, CityPassInput};
use super::passes::common::{FrameBindGroup, gpu_data};
use super::passes::contact::ContactPass;
use super::passes::glow::GlowPass;
use super::passes::lamps::LampPass;
use super::passes::light::LightBindGroup;
use super::passes::overlay::{OverlayPass, OverlayTarget};
use super::passes::shadow::{ShadowPass, SunView};
use super::passes::signals::SignalPass;
use super::passes::sky::SkyPass;
use super::passes::standing::StandingPass;
use super::passes::vehicle::VehiclePass;
use super::passes::{Attachments, light_constants};
use super::post_process::PostProcess;
use super::readback::{PendingDeviceReadback, StagingPool};
use super::request::{ReadbackLayout, RenderRequest, readback_layouts};
use super::static_scene::{
    CullContext, IndexLists, PreparedGeometry, StaticScene, TextureDetail, VisibleRanges,
};
use super::textures::BakedTextures;
use super::{Context, RenderError, Settings, TargetView};
use city3d_models::Model;
use city3d_protocol::snapshot::{BodyType, FrameSnapshot};
use city3d_scene::SceneDescription;
use city3d_sensors::{PictureKind, View, Weather};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Pipelines, buffers and render targets of one device for one scene.
#[derive(Debug)]
pub(super) struct DeviceRenderer {
    context: Context,
    settings: Settings,
    /// Most views of a batch that one render pass draws.
    views_per_pass: usize,
    attachments: Attachments,
    frame: FrameBindGroup,
    light: LightBindGroup,
    shadow: ShadowPass,
    lamps: LampPass,
    daylight: Light,
    city: CityPass,
    vehicles: VehiclePass,
    contact: ContactPass,
    /// With light per pixel.
    standing: Option<StandingPass>,
    sky: SkyPass,
    /// At night.
    glow: Option<GlowPass>,
    /// Where the city has traffic signals.
    signals: Option<SignalPass>,
    /// For the HDR target; `None` where light is computed at the vertices.
    post_process: Option<PostProcess>,
    /// Made at the first request for depth or labels.
    ground_truth: Option<GroundTruthRenderer>,
    /// Made at the first overlay of a target.
    overlay: Option<OverlayPass>,
    static_scene: StaticScene,
    /// Of the last batch.
    index_lists: IndexLists,
    fleet: FleetRenderer,
    gpu_timer: Option<GpuTimer>,
    /// Uniforms of the frame apart from the time.
    frame_constants: gpu_data::Frame,
    /// By the extent of a view.
    atlases: BTreeMap<[u32; 2], Atlas>,
    staging: StagingPool,
    /// Mean over the views of the last batch.
    triangles: u64,
    /// Depth and MSAA attachments for the caller's targets of the last draw, by extent.
    targets: BTreeMap<[u32; 2], Atlas>,
}

/// Potentially visible set of a view: culled once, drawn by each pass.
#[derive(Debug)]
pub(super) struct VisibleSet {
    pub(super) vehicles: Vec<VisibleVehicle>,
    pub(super) ranges: VisibleRanges,
    /// Rows from the top that the vehicle that carries the camera does not cover entirely.
    pub(super) visible_rows: u32,
}

/// Geometry and textures of a scene on the CPU, made once and shared by all devices.
#[derive(Debug)]
pub(super) struct SharedSceneData {
    textures: BakedTextures,
    geometry: PreparedGeometry,
}

impl SharedSceneData {
    pub(super) fn new(scene: &SceneDescription, textures: BakedTextures) -> Self {
        let light = &textures.light;
        // At night every vertex-lit surface reads the light map of lamps.
        let bucket = match (textures.settings.quality.vertex_lit, light.is_lamplit()) {
            (false, _) => Some(DrawBucket::AlphaToCoverage),
            (true, false) => Some(DrawBucket::Unlit(light.to_sun)),
            (true, true) => None,
        };
        Self { geometry: PreparedGeometry::new(scene, bucket), textures }
    }
}

impl DeviceRenderer {
    /// Uploads a scene, builds the pipelines and draws the static shadow map and light map. One render pass draws at
    /// most `views_per_pass` views.
    pub(super) fn new(
        context: &Context,
        (scene, shared): (&SceneDescription, &SharedSceneData),
        settings: Settings,
        views_per_pass: usize,
    ) -> Self {
        let device = &context.device;
        let quality = settings.quality;
        let vertex_lit = quality.vertex_lit;
        let attachments = Attachments::new(&settings);
        let frame = FrameBindGroup::new(device);
        let SharedSceneData { textures, geometry } = shared;
        let daylight = &textures.light;
        let sun_view = SunView::around(scene.bounds, daylight.to_sun, quality.shadow_texels);
        let shadow = ShadowPass::new(device, &frame.layout, sun_view);
        let lamplit = daylight.is_lamplit();
        let constants = light_constants(&settings, daylight);
        let lamp_texels = if !lamplit {
            1
        } else if vertex_lit {
            512
        } else {
            1024
        };
        let lamps = LampPass::new(device, &frame.layout, scene, (lamp_texels, !vertex_lit));
        let light = LightBindGroup::new(context, &shadow.map, &lamps.map_view, &textures.sky_map(context));
        let frame_constants = constant_frame(daylight, &sun_view, &settings, lamps.uv_from_world);
        let groups = [&frame.layout, &light.layout];
        let mut renderer = Self {
            city: CityPass::new(
                context,
                attachments,
                &CityPassInput {
                    quality: &quality,
                    frame_constants: &frame_constants,
                    constants: &constants,
                    groups,
                    textures,
                    has_instances: geometry.has_instances(),
                },
            ),
            vehicles: VehiclePass::new(device, attachments, (&frame_constants, &constants), groups),
            contact: ContactPass::new(device, attachments, &frame.layout),
            standing: (!vertex_lit).then(|| {
                StandingPass::new(
                    device,
                    attachments,
                    &frame.layout,
                    scene,
                    (textures.light.sun_seen(), lamplit),
                )
            }),
            sky: SkyPass::new(context, attachments, textures, groups),
            glow: lamplit.then(|| {
                let is_wet = settings.weather == Weather::Rain;
                GlowPass::new(device, attachments, &frame.layout, (&scene.lamps, is_wet))
            }),
            signals: (!scene.signals.is_empty())
                .then(|| SignalPass::new(device, attachments, &frame.layout, &scene.signals)),
            post_process: (!vertex_lit)
                .then(|| PostProcess::new(device, attachments, &settings, &frame.layout)),
            ground_truth: None,
            overlay: None,
            static_scene: StaticScene::new(device, geometry),
            index_lists: IndexLists::default(),
            fleet: FleetRenderer::new(device, settings.flat.is_none(), attachments.has_clear_glass()),
            gpu_timer: None,
            context: context.clone(),
            settings,
            views_per_pass,
            attachments,
            frame,
            light,
            shadow,
            lamps,
            daylight: *daylight,
            frame_constants,
            atlases: BTreeMap::new(),
            staging: StagingPool::default(),
            triangles: 0,
            targets: BTreeMap::new(),
        };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        renderer.frame.write_frame(&context.queue, &renderer.frame_data(0.0));
        renderer.shadow.draw_static(&mut encoder, &renderer.frame, &renderer.static_scene);
        if lamplit {
            renderer.lamps.draw_static(context, &mut encoder, &renderer.frame, &scene.lamps);
        }
        context.queue.submit([encoder.finish()]);
        renderer
    }

    /// Whether the device works; see [`Context::check`].
    pub(super) fn check(&self) -> Result<(), RenderError> {
        self.context.check()
    }

    /// Draws vehicles of a body type with a model, stretched to the measures of each.
    pub(super) fn set_vehicle_model(&mut self, body: BodyType, model: Arc<Model>) {
        self.fleet.set_model(body, model);
    }

    /// Mean number of triangles drawn for a view of the last batch, without the sky.
    pub(super) fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Measures the GPU time of each batch from now on, where the adapter has timestamp queries.
    pub(super) fn start_gpu_timer(&mut self) {
        self.gpu_timer = GpuTimer::new(&self.context);
    }

    pub(super) fn stop_gpu_timer(&mut self) {
        self.gpu_timer = None;
    }

    /// Waits for the last batch and returns its GPU time, seconds; `None` without a running timer.
    pub(super) fn last_batch_gpu_seconds(&self) -> Option<f64> {
        self.gpu_timer.as_ref()?.seconds(&self.context.device)
    }

    /// Submits the drawing of all pictures and returns at once. A view is culled once for all kinds of its pictures.
    pub(super) fn submit(
        &mut self,
        snapshot: &FrameSnapshot,
        requests: &[RenderRequest],
    ) -> PendingDeviceReadback {
        let views: Vec<View> = requests.iter().map(|request| request.view).collect();
        let mut encoder = self.prepare(snapshot, &views, self.averaged_pictures());
        let (layouts, bytes) = readback_layouts(requests);
        if layouts.iter().any(|layout| layout.depth.or(layout.labels).is_some()) {
            let device = &self.context.device;
            let drawing = self.ground_truth.get_or_insert_with(|| GroundTruthRenderer::new(device));
            drawing.pass.write(device, &self.context.queue, &views);
        }
        let visible = self.cull_views(&views);
        if let Some(gpu_timer) = &self.gpu_timer {
            gpu_timer.start(&mut encoder);
        }
        let buffer = self.staging.acquire(&self.context.device, bytes.max(4));
        let mut by_extent: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
        for (index, view) in views.iter().enumerate() {
            by_extent.entry(view.extent).or_default().push(index);
        }
        for (&extent, indices) in &by_extent {
            self.draw_colors(&mut encoder, (extent, indices), (&layouts, &visible), &buffer);
            self.draw_ground_truth(&mut encoder, (extent, indices), (&layouts, &visible), &buffer);
        }
        if let Some(gpu_timer) = &self.gpu_timer {
            gpu_timer.stop(&mut encoder);
        }
        let submission = self.context.queue.submit([encoder.finish()]);
        self.staging.map(
            &self.context.device,
            (buffer, submission),
            (layouts, self.attachments.display_format),
        )
    }

    /// Draws the views of one extent whose colour is requested, and copies them into the staging buffer.
    fn draw_colors(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        (extent, indices): ([u32; 2], &[usize]),
        (layouts, visible): (&[ReadbackLayout], &[VisibleSet]),
        buffer: &wgpu::Buffer,
    ) {
        let wanted: Vec<(usize, u64)> =
            indices.iter().filter_map(|&index| Some((index, layouts[index].color?))).collect();
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
            let target = (&atlas.color_view, self.attachments.display_format);
            self.draw_tiles(encoder, atlas, target, (visible, self.averaged_pictures()), &tiles);
            for (tile, &(_, at)) in batch.iter().enumerate() {
                atlas.grid.copy_tile(encoder, (&atlas.color, tile), (buffer, at));
            }
        }
    }

    /// Draws the views of one extent whose depth or labels are requested, and copies them into the staging buffer.
    fn draw_ground_truth(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        (extent, indices): ([u32; 2], &[usize]),
        (layouts, visible): (&[ReadbackLayout], &[VisibleSet]),
        buffer: &wgpu::Buffer,
    ) {
        let room = (buffer, self.settings.batch_bytes, self.views_per_pass);
        let Some(drawing) = &mut self.ground_truth else { return };
        let tiles: Vec<GroundTruthTile> = indices
            .iter()
            .map(|&view| GroundTruthTile {
                view,
                depth_at: layouts[view].depth,
                labels_at: layouts[view].labels,
            })
            .filter(|tile| tile.depth_at.or(tile.labels_at).is_some())
            .collect();
        let scene =
            ground_truth::VisibleScene { static_scene: &self.static_scene, fleet: &self.fleet, visible };
        drawing.draw(&self.context.device, encoder, scene, (extent, &tiles), room);
    }

    /// Draws views of one instant into targets, each view into the target of the same index.
    pub(super) fn draw(&mut self, snapshot: &FrameSnapshot, views: &[View], targets: &[TargetView<'_>]) {
        let mut encoder = self.prepare(snapshot, views, 1);
        let (in_colour, in_palette): (Vec<_>, Vec<_>) = targets
            .iter()
            .enumerate()
            .take(views.len())
            .partition(|(_, target)| target.kind == PictureKind::Rgb);
        self.targets.retain(|extent, _| in_colour.iter().any(|(_, target)| target.extent == *extent));
        let visible = self.cull_views(views);
        for (index, target) in in_colour {
            self.draw_target(&mut encoder, &visible, (index, target));
        }
        self.draw_palettes(&mut encoder, (views, &visible), &in_palette);
        self.context.queue.submit([encoder.finish()]);
    }

    /// Draws a view in colour, and the overlay of its target.
    fn draw_target(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        visible: &[VisibleSet],
        (index, target): (usize, &TargetView<'_>),
    ) {
        let overlay = target.overlay.filter(|overlay| !overlay.is_empty());
        let keeps_depth = self.post_process.is_some() || overlay.is_some();
        let atlas = self.targets.remove(&target.extent).unwrap_or_else(|| self.new_atlas(target.extent, 1));
        self.targets.insert(target.extent, Atlas { keeps_depth, ..atlas });
        let device = &self.context.device;
        if let Some(post_process) = &mut self.post_process {
            post_process.prepare_pipeline(device, &self.frame.layout, target.format);
        }
        let Some(atlas) = self.targets.get(&target.extent) else { return };
        let tiles = [(index, [0, 0])];
        self.draw_tiles(encoder, atlas, (target.color, target.format), (visible, 1), &tiles);
        if let Some(overlay) = overlay {
            let pass = self.overlay.take().filter(|pass| pass.format() == target.format);
            let pass = pass.unwrap_or_else(|| {
                OverlayPass::new(device, self.attachments, &self.frame.layout, target.format)
            });
            let over = OverlayTarget { color: target.color, depth: &atlas.depth_view, view: index };
            pass.draw(device, encoder, &self.frame, (over, overlay));
            self.overlay = Some(pass);
        }
    }

    /// Draws depth, classes or instances of views in colours.
    fn draw_palettes(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        (views, visible): (&[View], &[VisibleSet]),
        targets: &[(usize, &TargetView<'_>)],
    ) {
        let device = &self.context.device;
        if let Some(drawing) = &mut self.ground_truth {
            drawing.keep_extents(|extent| targets.iter().any(|(_, target)| target.extent == extent));
        }
        if targets.is_empty() {
            return;
        }
        let drawing = self.ground_truth.get_or_insert_with(|| GroundTruthRenderer::new(device));
        drawing.pass.write(device, &self.context.queue, views);
        for (index, target) in targets {
            let (static_scene, fleet) = (&self.static_scene, &self.fleet);
            let scene = ground_truth::VisibleScene { static_scene, fleet, visible };
            drawing.draw_in_colours(device, encoder, scene, (*index, target));
        }
    }

    /// How many pictures of a view are averaged: see [`super::Quality::jitter_samples`].
    fn averaged_pictures(&self) -> u32 {
        if self.post_process.is_some() { self.settings.quality.jitter_samples.max(1) } else { 1 }
    }

    /// Writes the uniforms and instances of a snapshot, and redraws vehicles in the shadow map and the light map. Uniforms
    /// of all views come once for each of the `averaged` pictures.
    fn prepare(&mut self, snapshot: &FrameSnapshot, views: &[View], averaged: u32) -> wgpu::CommandEncoder {
        self.fleet.update(&self.context, snapshot);
        let jitters = (0..averaged).map(|sample| SubpixelJitter::new(sample, averaged));
        let view_uniforms: Vec<gpu_data::View> = jitters
            .flat_map(|jitter| views.iter().map(move |view| gpu_data::View::new(view, jitter)))
            .collect();
        let frame = self.frame_data(snapshot.time_s as f32);
        let device = &self.context.device;
        self.frame.write(device, &self.context.queue, &frame, &view_uniforms);
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.shadow.draw_vehicles(&mut encoder, &self.frame, &self.fleet);
        if self.daylight.is_lamplit() {
            self.lamps.draw_vehicles(&self.context, &mut encoder, &self.frame, &self.fleet);
        }
        let aspects = &snapshot.signals;
        if let Some(signals) = &mut self.signals {
            signals.write(&self.context.queue, aspects);
        }
        if let Some(glow) = &mut self.glow {
            let signals = self.signals.iter().flat_map(|signals| signals.glows(aspects));
            glow.write(&self.context, &self.fleet, signals);
        }
        encoder
    }

    fn new_atlas(&self, extent: [u32; 2], views: usize) -> Atlas {
        let bytes = self.settings.batch_bytes;
        Atlas::new(&self.context.device, (extent, views), self.attachments, self.post_process.as_ref(), bytes)
    }

    /// Makes an atlas for views of an extent unless one of sufficient size exists.
    fn make_atlas(&mut self, extent: [u32; 2], views: usize) {
        let views = views.min(self.views_per_pass);
        if !self.atlases.get(&extent).is_some_and(|atlas| atlas.grid.fits(views)) {
            let atlas = self.new_atlas(extent, views);
            self.atlases.insert(extent, atlas);
        }
    }

    /// Draws tiles to a target, as the mean of `averaged` pictures.
    fn draw_tiles(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        atlas: &Atlas,
        target: (&wgpu::TextureView, wgpu::TextureFormat),
        (visible, averaged): (&[VisibleSet], u32),
        tiles: &[(usize, [u32; 2])],
    ) {
        let Some((post_process, hdr_target)) = self.post_process.as_ref().zip(atlas.hdr_target.as_ref())
        else {
            return self.draw_samples(encoder, atlas, target.0, (visible, 0), tiles);
        };
        let hdr = (&self.frame, hdr_target);
        if averaged < 2 {
            self.draw_samples(encoder, atlas, target.0, (visible, 0), tiles);
            return post_process.draw(encoder, hdr, target, (tiles, atlas.grid.tile));
        }
        for sample in 0..averaged as usize {
            let first_slot = sample * visible.len();
            self.draw_samples(encoder, atlas, target.0, (visible, first_slot), tiles);
            let slots: Vec<_> = tiles.iter().map(|&(index, origin)| (first_slot + index, origin)).collect();
            post_process.accumulate(encoder, hdr, (&slots, atlas.grid.tile), sample == 0);
        }
        post_process.draw_mean(encoder, hdr, target.0, (tiles, atlas.grid.tile));
    }

    /// Colour pass over tiles of an atlas: radiance into the HDR target, or displayed colours into a target. Uniforms of
    /// the views begin at `first_slot`.
    fn draw_samples(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        atlas: &Atlas,
        color: &wgpu::TextureView,
        (visible, first_slot): (&[VisibleSet], usize),
        tiles: &[(usize, [u32; 2])],
    ) {
        let haze = self.daylight.haze_srgb;
        let haze = if self.post_process.is_some() { self.daylight.radiance_of(haze) } else { haze };
        let [r, g, b] = haze.map(f64::from);
        // Alpha 0: no ambient occlusion on the background.
        let a = if self.post_process.is_some() { 0.0 } else { 1.0 };
        let load = wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a });
        let keep = wgpu::Operations { load, store: wgpu::StoreOp::Store };
        let drop = wgpu::Operations { load, store: wgpu::StoreOp::Discard };
        let (view, resolve_target, ops) = match &atlas.samples_view {
            Some(samples) if self.post_process.is_some() => (samples, None, keep),
            Some(samples) => (samples, Some(color), drop),
            None => (color, None, keep),
        };
        let attachment = wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target, ops };
        let mirrors = atlas.mirrors_view.as_ref().map(|view| wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            },
        });
        let attachments: Vec<_> = std::iter::once(attachment).chain(mirrors).map(Some).collect();
        let depth_store = if atlas.keeps_depth { wgpu::StoreOp::Store } else { wgpu::StoreOp::Discard };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("pictures"),
            color_attachments: &attachments,
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &atlas.depth_view,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: depth_store }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let extent = atlas.grid.tile;
        for &(index, origin) in tiles {
            pass.set_bind_group(0, &self.frame.group, &[FrameBindGroup::offset(first_slot + index)]);
            pass.set_bind_group(1, &self.light.group, &[]);
            self.draw_view(&mut pass, Tile { origin, extent }, &visible[index]);
        }
    }

    /// Culls the static scene and the vehicles for each view and uploads the index lists.
    fn cull_views(&mut self, views: &[View]) -> Vec<VisibleSet> {
        let mut lists = std::mem::take(&mut self.index_lists);
        lists.clear();
        let device = &self.context.device;
        let own: Vec<Option<OwnVehicle>> =
            views.iter().map(|view| self.fleet.own_vehicle(device, view)).collect();
        let cull = |(view, own): (&View, Option<OwnVehicle>)| self.cull_view(view, own.as_ref(), &mut lists);
        let visible: Vec<VisibleSet> = views.iter().zip(own).map(cull).collect();
        let count = |visible: &VisibleSet| {
            self.static_scene.triangles(&visible.ranges) + self.fleet.triangles(&visible.vehicles)
        };
        self.triangles = visible.iter().map(count).sum::<u64>() / (visible.len() as u64).max(1);
        self.static_scene.upload(&self.context.device, &self.context.queue, &lists);
        self.index_lists = lists;
        visible
    }

    fn cull_view(&self, view: &View, own: Option<&OwnVehicle>, lists: &mut IndexLists) -> VisibleSet {
        let visible_rows = own.map_or(view.extent[1], |own| own.visible_rows);
        let in_full = view.clip_from_world();
        let clip_from_world = in_full.as_mat4();
        let whole = Frustum::new(&clip_from_world);
        let frustum = whole.cropped_to_top(visible_rows as f32 / view.extent[1] as f32);
        let eye = view.extrinsics.position.as_vec3();
        let sector = AzimuthSector::of_view(&corner_rays(view.extrinsics.position, &in_full));
        let horizon = self.static_scene.horizon(view.is_perspective().then_some(eye), sector, &frustum);
        let cull = CullContext {
            frustum: &frustum,
            horizon: &horizon,
            pixel_scale: PixelScale::new(&clip_from_world, view.extent[1]),
            eye,
            is_perspective: view.is_perspective(),
            lod_error_px: self.settings.quality.lod_error_px,
            vehicle_lod_error_px: self.settings.quality.vehicle_lod_error_px,
            min_size_px: self.settings.quality.min_size_px,
            texture_detail: match (self.settings.flat, self.settings.quality.vertex_lit) {
                (Some(_), _) => TextureDetail::None,
                (None, true) => TextureDetail::Near,
                (None, false) => TextureDetail::All,
            },
        };
        let ranges = self.static_scene.cull(&cull, lists);
        let vehicles = self.fleet.visible_vehicles(&CullContext { frustum: &whole, ..cull }, own);
        VisibleSet { vehicles, ranges, visible_rows }
    }

    fn draw_view(&self, pass: &mut wgpu::RenderPass<'_>, tile: Tile, visible: &VisibleSet) {
        tile.set_viewport(pass);
        // Front to back: the early depth test rejects hidden fragments before shading.
        self.vehicles.draw(pass, &self.fleet, &visible.vehicles);
        tile.set_scissor_rows(pass, visible.visible_rows);
        self.city.draw(pass, &self.static_scene, &visible.ranges);
        if let Some(signals) = &self.signals {
            signals.draw(pass);
        }
        if self.settings.flat.is_none() {
            self.sky.draw(pass);
            self.contact.draw(pass, &self.fleet, &visible.vehicles);
            if let Some(standing) = &self.standing {
                standing.draw(pass);
            }
        }
        self.vehicles.draw_glass(pass, &self.fleet, &visible.vehicles);
        if let Some(glow) = &self.glow {
            glow.draw(pass, &visible.vehicles);
        }
    }

    /// Uniforms of the frame at a time in seconds.
    fn frame_data(&self, time_s: f32) -> gpu_data::Frame {
        let mut frame = self.frame_constants;
        frame.to_sun[3] = time_s;
        frame
    }
}
