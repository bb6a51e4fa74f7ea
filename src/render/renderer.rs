//! Draws snapshots: all views of one call are of the same instant, go to the adapter in one
//! submission and come back through one buffer.

use super::atlas::{Atlas, Ring, padded_row, tile_bytes};
use super::fleet::{Fleet, linear_from_srgb};
use super::frustum::{Frustum, Sharpness};
use super::passes::Attachments;
use super::passes::city::CityPass;
use super::passes::common::{FrameGroup, gpu_data};
use super::passes::contact::ContactPass;
use super::passes::light::LightGroup;
use super::passes::shadow::{ShadowPass, SunView};
use super::passes::sky::SkyPass;
use super::passes::vehicle::VehiclePass;
use super::settings::{EXPOSURE, HAZE_SRGB, radiance_of};
use super::standing::{Gaze, Standing};
use super::{Context, Image, RenderError, Settings, TargetView};
use crate::camera::View;
use crate::city::scene::SceneDescription;
use crate::model::Model;
use crate::snapshot::{BodyType, FrameSnapshot};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, mpsc};

/// Draws one scene and whatever drives in it.
#[derive(Debug)]
pub struct Renderer {
    context: Context,
    settings: Settings,
    attachments: Attachments,
    frame: FrameGroup,
    light: LightGroup,
    shadow: ShadowPass,
    city: CityPass,
    vehicles: VehiclePass,
    contact: ContactPass,
    sky: SkyPass,
    standing: Standing,
    fleet: Fleet,
    sun_view: SunView,
    atlases: BTreeMap<[u32; 2], Atlas>,
    ring: Ring,
    /// Depth and samples of the target that was drawn to last.
    window: Option<Atlas>,
}

/// Pictures on their way back from the adapter.
#[derive(Debug)]
pub struct Pending {
    buffer: wgpu::Buffer,
    /// Of each view where its picture begins and how large it is.
    places: Vec<(u64, [u32; 2])>,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
    submission: wgpu::SubmissionIndex,
    bgra: bool,
}

impl Renderer {
    /// Uploads a scene and builds the pipelines.
    ///
    /// # Errors
    /// None that a valid scene and adapter give; the adapter's own are logged by wgpu.
    pub fn new(context: &Context, scene: &SceneDescription, settings: Settings) -> Result<Self, RenderError> {
        let device = &context.device;
        let quality = settings.quality;
        let attachments = Attachments { format: settings.format, samples: quality.samples };
        let frame = FrameGroup::new(device);
        let sun_view = SunView::around(scene.bounds, settings.sun.direction(), quality.shadow_texels);
        let shadow = ShadowPass::new(device, &frame.layout, sun_view);
        let light = LightGroup::new(device, &shadow.map);
        let groups = [&frame.layout, &light.layout];
        let renderer = Self {
            city: CityPass::new(context, attachments, quality, groups),
            vehicles: VehiclePass::new(device, attachments, quality, groups),
            contact: ContactPass::new(device, attachments, &frame.layout),
            sky: SkyPass::new(context, attachments, settings.sun, groups),
            standing: Standing::new(device, scene),
            fleet: Fleet::new(device),
            context: context.clone(),
            settings,
            attachments,
            frame,
            light,
            shadow,
            sun_view,
            atlases: BTreeMap::new(),
            ring: Ring::default(),
            window: None,
        };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        renderer.frame.write_frame(&context.queue, &renderer.frame_data(0.0));
        renderer.shadow.draw_standing(&mut encoder, &renderer.frame, &renderer.standing);
        context.queue.submit([encoder.finish()]);
        Ok(renderer)
    }

    /// Draws vehicles of a body type with a model, stretched to the measures of each.
    pub fn set_vehicle_model(&mut self, body: BodyType, model: Arc<Model>) {
        self.fleet.set_model(body, model);
    }

    /// What it was built for.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The adapter that draws.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Pictures of all views at one instant, in the order of the views.
    ///
    /// # Errors
    /// [`RenderError::Extent`], [`RenderError::View`] and [`RenderError::Vehicle`] for what cannot
    /// be drawn, [`RenderError::Readback`] where the adapter was lost.
    pub fn render(&mut self, snapshot: &FrameSnapshot, views: &[View]) -> Result<Vec<Image>, RenderError> {
        let pending = self.begin(snapshot, views)?;
        self.finish(pending)
    }

    /// How many views of an extent one call can take: their pictures come back in one buffer, whose
    /// size the adapter limits.
    pub fn views_at_once(&self, extent: [u32; 2]) -> usize {
        let most = self.context.device.limits().max_buffer_size;
        (most / tile_bytes(extent).max(1)).max(1) as usize
    }

    /// Submits the drawing of all views and returns at once; [`Renderer::finish`] waits for the
    /// pictures. Several batches may be on their way, each holds its own memory.
    ///
    /// # Errors
    /// As [`Renderer::render`], before anything is submitted.
    pub fn begin(&mut self, snapshot: &FrameSnapshot, views: &[View]) -> Result<Pending, RenderError> {
        let mut encoder = self.prepare(snapshot, views)?;
        let mut by_extent: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
        for (index, view) in views.iter().enumerate() {
            by_extent.entry(view.extent).or_default().push(index);
        }
        let bytes: u64 = views.iter().map(|view| tile_bytes(view.extent)).sum();
        let buffer = self.ring.take(&self.context.device, bytes.max(4));
        let mut places = vec![(0, [0; 2]); views.len()];
        let mut offset = 0;
        for (&extent, indices) in &by_extent {
            self.make_atlas(extent, indices.len());
            let Some(atlas) = self.atlases.get(&extent) else { continue };
            for batch in indices.chunks(atlas.capacity) {
                let tiles: Vec<_> =
                    batch.iter().enumerate().map(|(tile, &index)| (index, atlas.origin(tile))).collect();
                self.draw_tiles(&mut encoder, atlas, &atlas.color_view, views, &tiles);
                atlas.copy_to(&mut encoder, batch.len(), &buffer, offset);
                for &index in batch {
                    places[index] = (offset, extent);
                    offset += tile_bytes(extent);
                }
            }
        }
        let submission = self.context.queue.submit([encoder.finish()]);
        let (sender, mapped) = mpsc::channel();
        buffer.slice(..).map_async(wgpu::MapMode::Read, move |result| {
            // Nobody waits any longer when the batch was dropped.
            let _ = sender.send(result);
        });
        let bgra = matches!(
            self.attachments.format,
            wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb
        );
        Ok(Pending { buffer, places, mapped, submission, bgra })
    }

    /// Waits for a batch and takes its pictures.
    ///
    /// # Errors
    /// [`RenderError::Readback`] where the adapter was lost.
    pub fn finish(&mut self, pending: Pending) -> Result<Vec<Image>, RenderError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(pending.submission), timeout: None };
        let lost = |error: &dyn std::fmt::Display| RenderError::Readback(error.to_string());
        self.context.device.poll(wait).map_err(|error| lost(&error))?;
        pending.mapped.recv().map_err(|error| lost(&error))?.map_err(|error| lost(&error))?;
        let images = {
            let view = pending.buffer.slice(..).get_mapped_range().map_err(|error| lost(&error))?;
            let bytes: &[u8] = &view;
            pending
                .places
                .par_iter()
                .map(|&(offset, extent)| unpack(&bytes[offset as usize..], extent, pending.bgra))
                .collect()
        };
        pending.buffer.unmap();
        self.ring.put_back(pending.buffer);
        Ok(images)
    }

    /// Draws one view into a target of the format that the renderer was built for: a window. The view's
    /// picture fills the target, so that its extent should have the target's proportions.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn draw(
        &mut self,
        snapshot: &FrameSnapshot,
        view: &View,
        target: TargetView<'_>,
    ) -> Result<(), RenderError> {
        let mut encoder = self.prepare(snapshot, std::slice::from_ref(view))?;
        if self.window.as_ref().is_none_or(|atlas| atlas.tile != target.extent) {
            self.window = Some(self.new_atlas(target.extent, 1));
        }
        if let Some(atlas) = &self.window {
            self.draw_tiles(&mut encoder, atlas, target.color, std::slice::from_ref(view), &[(0, [0, 0])]);
        }
        self.context.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Writes what all views share and brings the shadows up to date.
    fn prepare(
        &mut self,
        snapshot: &FrameSnapshot,
        views: &[View],
    ) -> Result<wgpu::CommandEncoder, RenderError> {
        let most = self.context.device.limits().max_texture_dimension_2d;
        for (index, view) in views.iter().enumerate() {
            let [width, height] = view.extent;
            if width == 0 || height == 0 || width > most || height > most {
                return Err(RenderError::Extent { width, height, most });
            }
            if !view.clip_from_world().is_finite() || !view.extrinsics.position.is_finite() {
                return Err(RenderError::View { index });
            }
        }
        self.fleet.update(&self.context, snapshot)?;
        let slots: Vec<gpu_data::View> = views
            .iter()
            .map(|view| gpu_data::View {
                clip_from_world: view.clip_from_world().as_mat4().to_cols_array_2d(),
                eye: view.extrinsics.position.as_vec3().extend(1.0).to_array(),
            })
            .collect();
        let frame = self.frame_data(snapshot.time_s as f32);
        let device = &self.context.device;
        self.frame.write(device, &self.context.queue, &frame, &slots);
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.shadow.draw_vehicles(&mut encoder, &self.frame, &self.fleet);
        Ok(encoder)
    }

    fn new_atlas(&self, extent: [u32; 2], views: usize) -> Atlas {
        Atlas::new(&self.context.device, extent, views, self.attachments, self.settings.batch_bytes)
    }

    /// Sees to an atlas for views of an extent.
    fn make_atlas(&mut self, extent: [u32; 2], views: usize) {
        let fits = |atlas: &Atlas| atlas.capacity >= views || atlas.is_full_size;
        if !self.atlases.get(&extent).is_some_and(fits) {
            let atlas = self.new_atlas(extent, views);
            self.atlases.insert(extent, atlas);
        }
    }

    fn draw_tiles(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        atlas: &Atlas,
        color: &wgpu::TextureView,
        views: &[View],
        tiles: &[(usize, [u32; 2])],
    ) {
        let [r, g, b] = HAZE_SRGB.map(|c| f64::from(linear_from_srgb((c * 255.0) as u8)));
        let clear = wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 });
        let attachment = match &atlas.samples_view {
            Some(samples) => wgpu::RenderPassColorAttachment {
                view: samples,
                depth_slice: None,
                resolve_target: Some(color),
                ops: wgpu::Operations { load: clear, store: wgpu::StoreOp::Discard },
            },
            None => wgpu::RenderPassColorAttachment {
                view: color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: clear, store: wgpu::StoreOp::Store },
            },
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("pictures"),
            color_attachments: &[Some(attachment)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &atlas.depth_view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let [width, height] = atlas.tile;
        for &(index, [x, y]) in tiles {
            let view = &views[index];
            pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
            pass.set_scissor_rect(x, y, width, height);
            pass.set_bind_group(0, &self.frame.group, &[FrameGroup::offset(index)]);
            pass.set_bind_group(1, &self.light.group, &[]);
            self.draw_view(&mut pass, view);
        }
    }

    fn draw_view(&self, pass: &mut wgpu::RenderPass<'_>, view: &View) {
        let clip_from_world = view.clip_from_world().as_mat4();
        let frustum = Frustum::new(&clip_from_world);
        let gaze = Gaze {
            frustum: &frustum,
            sharpness: Sharpness::new(&clip_from_world, view.extent[1]),
            eye: view.extrinsics.position.as_vec3(),
            coarse_below_px: self.settings.quality.coarse_below_px,
        };
        let seen = self.fleet.seen(&gaze, view.carrier);
        // Nearest first, as far as can be told: what is hidden costs no shading.
        self.vehicles.draw(pass, &self.fleet, &seen);
        self.city.draw(pass, &self.standing, &gaze, false);
        self.city.draw(pass, &self.standing, &gaze, true);
        self.sky.draw(pass);
        self.contact.draw(pass, &self.fleet, &seen);
    }

    fn frame_data(&self, time_s: f32) -> gpu_data::Frame {
        let haze = HAZE_SRGB.map(|c| radiance_of(linear_from_srgb((c * 255.0) as u8)));
        let to_sun: Vec3 = self.settings.sun.direction();
        gpu_data::Frame {
            to_sun: to_sun.extend(time_s).to_array(),
            sun: [2.55, 2.28, 1.86, EXPOSURE],
            sky_light: [0.60, 0.72, 0.92, 0.0],
            ground_light: [0.34, 0.34, 0.30, 0.0],
            haze: [haze[0], haze[1], haze[2], 1.0 / 950.0],
            shadow_from_world: self.sun_view.shadow_from_world.to_cols_array_2d(),
            shadow_texel: [1.0 / self.settings.quality.shadow_texels as f32, self.sun_view.texel_m, 0.0, 0.0],
        }
    }
}

/// RGB out of padded rows of RGBA.
fn unpack(bytes: &[u8], [width, height]: [u32; 2], bgra: bool) -> Image {
    let row = padded_row(width) as usize;
    let mut rgb = vec![0; width as usize * height as usize * 3];
    for (to, from) in rgb.chunks_exact_mut(width as usize * 3).zip(bytes.chunks(row)) {
        for (pixel, texel) in to.chunks_exact_mut(3).zip(from.chunks_exact(4)) {
            pixel.copy_from_slice(&texel[..3]);
            if bgra {
                pixel.swap(0, 2);
            }
        }
    }
    Image { width, height, rgb }
}
