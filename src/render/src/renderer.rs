//! Renderer: draws batches of views of one snapshot. A GPU gets a batch in one submission; a software adapter is opened
//! several times, and each device draws its share of the views.

use super::device_renderer::{DeviceRenderer, SharedSceneData};
use super::readback::{MappedReadback, PendingReadback};
use super::request::{Pictures, RenderRequest};
use super::textures::BakedTextures;
use super::{Context, Image, RenderError, Settings, TargetView, fleet, ground_truth};
use city3d_models::Model;
use city3d_protocol::snapshot::{BodyType, FrameSnapshot};
use city3d_scene::SceneDescription;
use city3d_sensors::{PictureKind, View};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Draws one scene and the vehicles of snapshots.
#[derive(Debug)]
pub struct Renderer {
    context: Context,
    settings: Settings,
    /// One per opened device, at least one.
    devices: Vec<DeviceRenderer>,
    /// Round robin: the device that gets the next share.
    next_device: usize,
    /// Mean over the views of the last batch.
    triangles: u64,
    /// Devices that drew the last batch.
    busy_devices: Vec<usize>,
}

impl Renderer {
    /// Uploads a scene and builds the pipelines.
    ///
    /// # Errors
    /// [`RenderError::Device`] where the adapter does not take the scene.
    pub fn new(context: &Context, scene: &SceneDescription, settings: Settings) -> Result<Self, RenderError> {
        Self::with_textures(context, scene, BakedTextures::new(settings))
    }

    /// [`Renderer::new`] with textures baked in advance, and their settings.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with_textures(
        context: &Context,
        scene: &SceneDescription,
        textures: BakedTextures,
    ) -> Result<Self, RenderError> {
        let settings = textures.settings;
        let opened: Vec<&Context> = std::iter::once(context).chain(&*context.peers).collect();
        let shared = SharedSceneData::new(scene, textures);
        // Single-threaded devices draw one view after the other into the same texture: there is nothing to parallelise
        // in a pass, and depth and colour stay in the processor's cache.
        let views_per_pass = if opened.len() > 1 { 1 } else { usize::MAX };
        let device =
            |context: &Context| DeviceRenderer::new(context, (scene, &shared), settings, views_per_pass);
        let devices: Vec<DeviceRenderer> = opened.into_par_iter().map(device).collect();
        devices.iter().try_for_each(DeviceRenderer::check)?;
        let context = context.clone();
        Ok(Self { context, settings, devices, next_device: 0, triangles: 0, busy_devices: Vec::new() })
    }

    /// Sets the model of a body type; it is stretched to the dimensions of each vehicle.
    pub fn set_vehicle_model(&mut self, body: BodyType, model: &Arc<Model>) {
        for device in &mut self.devices {
            device.set_vehicle_model(body, Arc::clone(model));
        }
    }

    /// Sets the models of several body types, such as those of a scenario.
    pub fn set_vehicle_models(&mut self, models: &BTreeMap<BodyType, Arc<Model>>) {
        models.iter().for_each(|(&body, model)| self.set_vehicle_model(body, model));
    }

    /// Settings that it was built for.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Mean number of triangles drawn for a view of the last batch, without the sky.
    pub fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Measures the GPU time of each batch from now on, where the adapter has timestamp queries.
    pub fn start_gpu_timer(&mut self) {
        self.devices.iter_mut().for_each(DeviceRenderer::start_gpu_timer);
    }

    /// Ends [`Renderer::start_gpu_timer`].
    pub fn stop_gpu_timer(&mut self) {
        self.devices.iter_mut().for_each(DeviceRenderer::stop_gpu_timer);
    }

    /// Waits for the last batch and returns its GPU time, seconds; `None` without a running timer.
    pub fn last_batch_gpu_seconds(&self) -> Option<f64> {
        let seconds = self.busy_devices.iter().filter_map(|&k| self.devices[k].last_batch_gpu_seconds());
        seconds.max_by(f64::total_cmp)
    }

    /// GPU context of the first device.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Pictures of all views at one instant, in the order of the views.
    ///
    /// # Errors
    /// [`RenderError::Extent`], [`RenderError::View`] and [`RenderError::Vehicle`] for what cannot
    /// be drawn, [`RenderError::TooLarge`] for more than the adapter takes at once, [`RenderError::Device`] and
    /// [`RenderError::Readback`] where the adapter failed or was lost.
    pub fn render(&mut self, snapshot: &FrameSnapshot, views: &[View]) -> Result<Vec<Image>, RenderError> {
        let pending = self.submit(snapshot, views)?;
        self.finish(pending)
    }

    /// Pictures of all requested kinds, in the order of the requests.
    ///
    /// # Errors
    /// As [`Renderer::render`], and [`RenderError::Number`] for vehicles whose number no pixel can hold
    /// where instances are asked for.
    pub fn render_kinds(
        &mut self,
        snapshot: &FrameSnapshot,
        requests: &[RenderRequest],
    ) -> Result<Vec<Pictures>, RenderError> {
        let pending = self.submit_kinds(snapshot, requests)?;
        self.finish_kinds(pending)
    }

    /// Length of the longest prefix of the requests that fits one batch, within [`Settings::batch_bytes`] and the
    /// limits of the adapter; at least one.
    pub fn max_batch_len(&self, requests: &[RenderRequest]) -> usize {
        let most = self.context.device.limits().max_buffer_size.min(self.settings.batch_bytes);
        let ends = requests.iter().scan(0, |end, request| {
            *end += request.bytes();
            Some(*end)
        });
        ends.take_while(|&end| end <= most).count().max(1).min(requests.len())
    }

    /// Splits views into batches that the renderer takes at once.
    pub fn batches(&self, views: &[View]) -> Vec<Vec<View>> {
        let mut rest: Vec<RenderRequest> = views.iter().map(RenderRequest::from).collect();
        let mut batches = Vec::new();
        while !rest.is_empty() {
            let after = rest.split_off(self.max_batch_len(&rest));
            batches.push(rest.iter().map(|request| request.view).collect());
            rest = after;
        }
        batches
    }

    /// Number of batches of `views` views to keep in flight so that no device runs idle.
    pub fn batches_in_flight(&self, views: usize) -> usize {
        let adapters = self.devices.len();
        2 * adapters.div_ceil(views.clamp(1, adapters))
    }

    /// Submits the drawing of all views in colour and returns at once; [`Renderer::finish`] waits for the pictures.
    /// Several batches may be in flight; each holds its own staging buffer.
    ///
    /// # Errors
    /// As [`Renderer::render`], before anything is submitted.
    pub fn submit(
        &mut self,
        snapshot: &FrameSnapshot,
        views: &[View],
    ) -> Result<PendingReadback, RenderError> {
        let requests: Vec<RenderRequest> = views.iter().map(RenderRequest::from).collect();
        self.submit_kinds(snapshot, &requests)
    }

    /// Submits the drawing of all pictures and returns at once; [`Renderer::finish_kinds`] waits for them. A view is
    /// culled once for all its kinds.
    ///
    /// # Errors
    /// As [`Renderer::render_kinds`], before anything is submitted.
    pub fn submit_kinds(
        &mut self,
        snapshot: &FrameSnapshot,
        requests: &[RenderRequest],
    ) -> Result<PendingReadback, RenderError> {
        if requests.iter().any(|request| request.kinds.contains(PictureKind::Instance)) {
            ground_truth::check_instance_ids(snapshot)?;
        }
        self.check(snapshot, requests.iter().map(|request| &request.view))?;
        self.check_sizes(requests)?;
        let share = requests.len().div_ceil(self.devices.len()).max(1);
        let mut triangles = 0;
        self.busy_devices.clear();
        let mut parts = Vec::with_capacity(self.devices.len());
        for part in requests.chunks(share) {
            let device = &mut self.devices[self.next_device];
            parts.push(device.submit(snapshot, part));
            device.check()?;
            triangles += device.triangles() * part.len() as u64;
            self.busy_devices.push(self.next_device);
            self.next_device = (self.next_device + 1) % self.devices.len();
        }
        if parts.len() == self.devices.len() {
            // Rotates the shares among the devices: one share may take longer in every batch.
            self.next_device = (self.next_device + 1) % self.devices.len();
        }
        self.triangles = triangles / (requests.len() as u64).max(1);
        Ok(PendingReadback { parts })
    }

    /// Checks that the pictures of each view fit a staging buffer.
    fn check_sizes(&self, requests: &[RenderRequest]) -> Result<(), RenderError> {
        let most = self.context.device.limits().max_buffer_size;
        requests.iter().find(|request| request.bytes() > most).map_or(Ok(()), |request| {
            let [width, height] = request.view.extent;
            Err(RenderError::TooLarge { width, height, bytes: request.bytes(), most })
        })
    }

    /// Checks that the views and vehicles can be drawn.
    fn check<'a>(
        &self,
        snapshot: &FrameSnapshot,
        views: impl Iterator<Item = &'a View>,
    ) -> Result<(), RenderError> {
        let most = self.context.device.limits().max_texture_dimension_2d;
        for (index, view) in views.enumerate() {
            let [width, height] = view.extent;
            if width == 0 || height == 0 || width > most || height > most {
                return Err(RenderError::Extent { width, height, most });
            }
            if !view.clip_from_world().is_finite() || !view.extrinsics.position.is_finite() {
                return Err(RenderError::View { index });
            }
        }
        fleet::check(snapshot)
    }

    /// Waits for a batch of [`Renderer::submit`] and reads its pictures.
    ///
    /// # Errors
    /// [`RenderError::Readback`] where the adapter was lost.
    pub fn finish(&mut self, pending: PendingReadback) -> Result<Vec<Image>, RenderError> {
        let pictures = self.finish_kinds(pending)?;
        Ok(pictures.into_iter().filter_map(|pictures| pictures.rgb).collect())
    }

    /// Waits for a batch and reads its pictures of all kinds.
    ///
    /// # Errors
    /// [`RenderError::Readback`] where the adapter was lost.
    pub fn finish_kinds(&mut self, pending: PendingReadback) -> Result<Vec<Pictures>, RenderError> {
        let readback = self.wait(pending)?;
        Ok((0..readback.len()).into_par_iter().map(|index| readback.pictures(index)).collect())
    }

    /// Waits for a batch. Any thread can read its pictures, one by one; the batch holds its staging buffers until it is
    /// dropped.
    ///
    /// # Errors
    /// [`RenderError::Readback`] where the adapter was lost.
    pub fn wait(&self, pending: PendingReadback) -> Result<MappedReadback, RenderError> {
        pending.wait()
    }

    /// Draws views of one instant into targets, each view into the target of the same index: a window and its panels.
    /// A picture fills its target, so a view's extent should have the target's proportions. With vertex lighting,
    /// targets must have the pixel format that the renderer was built for, without the suffix sRGB. Targets of another kind
    /// than colour show depth, classes or instances in colours, without the overlay.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn draw(
        &mut self,
        snapshot: &FrameSnapshot,
        views: &[View],
        targets: &[TargetView<'_>],
    ) -> Result<(), RenderError> {
        self.check(snapshot, views.iter())?;
        // Targets belong to the device of the context.
        if let Some(device) = self.devices.first_mut() {
            device.draw(snapshot, views, targets);
            device.check()?;
        }
        Ok(())
    }
}
