//! Draws snapshots: all views of one call are of the same instant. A GPU gets them in one submission; of an adapter that
//! draws on the CPU several are opened, and each draws its share of the views.

use super::readback::{Arrived, Pending};
use super::request::{Pictures, Request};
use super::stage::{Made, Stage};
use super::textures::Paintings;
use super::{Context, Image, RenderError, Settings, TargetView, fleet, kinds};
use crate::camera::{PictureKind, View};
use crate::city::scene::SceneDescription;
use crate::model::Model;
use crate::snapshot::{BodyType, FrameSnapshot};
use rayon::prelude::*;
use std::sync::Arc;

/// Draws one scene and whatever drives in it.
#[derive(Debug)]
pub struct Renderer {
    context: Context,
    settings: Settings,
    /// One for each opened adapter, one at least.
    stages: Vec<Stage>,
    /// The stage whose turn is next.
    turn: usize,
    /// Of a view of the last batch, in the mean.
    triangles: u64,
    /// Stages that drew the last batch.
    at_work: Vec<usize>,
}

impl Renderer {
    /// Uploads a scene and builds the pipelines.
    ///
    /// # Errors
    /// None that a valid scene and adapter give; the adapter's own are logged by wgpu.
    pub fn new(context: &Context, scene: &SceneDescription, settings: Settings) -> Result<Self, RenderError> {
        Self::painted(context, scene, Paintings::new(settings))
    }

    /// [`Renderer::new`] with the settings of these paintings.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn painted(
        context: &Context,
        scene: &SceneDescription,
        paintings: Paintings,
    ) -> Result<Self, RenderError> {
        let settings = paintings.settings;
        let opened: Vec<&Context> = std::iter::once(context).chain(&*context.peers).collect();
        let made = Made::new(scene, paintings);
        // Those that share the processors draw one view after the other into the same texture: they have nobody to wait
        // for after a pass, and depths and colours stay in their caches.
        let views_at_once = if opened.len() > 1 { 1 } else { usize::MAX };
        let stage = |context: &Context| Stage::new(context, (scene, &made), settings, views_at_once);
        let stages = opened.into_par_iter().map(stage).collect();
        let context = context.clone();
        Ok(Self { context, settings, stages, turn: 0, triangles: 0, at_work: Vec::new() })
    }

    /// Draws vehicles of a body type with a model, stretched to the measures of each.
    pub fn set_vehicle_model(&mut self, body: BodyType, model: &Arc<Model>) {
        for stage in &mut self.stages {
            stage.set_vehicle_model(body, Arc::clone(model));
        }
    }

    /// What it was built for.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// How many triangles a view of the last batch was given in the mean, without the sky.
    pub fn triangles(&self) -> u64 {
        self.triangles
    }

    /// Has the adapter take the time of each batch from now on, where it can.
    pub fn keep_time(&mut self) {
        self.stages.iter_mut().for_each(Stage::keep_time);
    }

    pub fn stop_keeping_time(&mut self) {
        self.stages.iter_mut().for_each(Stage::stop_keeping_time);
    }

    /// Seconds that the adapter took for the last batch, which is waited for; `None` unless it keeps time.
    pub fn seconds_of_last_batch(&self) -> Option<f64> {
        let seconds = self.at_work.iter().filter_map(|&k| self.stages[k].seconds_of_last_batch());
        seconds.max_by(f64::total_cmp)
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

    /// Pictures of all kinds that are asked for, in the order of the requests.
    ///
    /// # Errors
    /// As [`Renderer::render`], and [`RenderError::Number`] for vehicles whose number no pixel can hold
    /// where instances are asked for.
    pub fn render_kinds(
        &mut self,
        snapshot: &FrameSnapshot,
        requests: &[Request],
    ) -> Result<Vec<Pictures>, RenderError> {
        let pending = self.begin_kinds(snapshot, requests)?;
        self.finish_kinds(pending)
    }

    /// How many of these requests, from the first on, one call can take within what a batch may use and
    /// the adapter's limits: one at least.
    pub fn requests_at_once(&self, requests: &[Request]) -> usize {
        let most = self.context.device.limits().max_buffer_size.min(self.settings.batch_bytes);
        let ends = requests.iter().scan(0, |end, request| {
            *end += request.bytes();
            Some(*end)
        });
        ends.take_while(|&end| end <= most).count().max(1).min(requests.len())
    }

    /// How many batches of so many views have to be on their way that every adapter has the next before it is done.
    pub fn batches_ahead(&self, views: usize) -> usize {
        let adapters = self.stages.len();
        2 * adapters.div_ceil(views.clamp(1, adapters))
    }

    /// Submits the drawing of all views in colour and returns at once; [`Renderer::finish`] waits for
    /// the pictures. Several batches may be on their way, each holds its own memory.
    ///
    /// # Errors
    /// As [`Renderer::render`], before anything is submitted.
    pub fn begin(&mut self, snapshot: &FrameSnapshot, views: &[View]) -> Result<Pending, RenderError> {
        let requests: Vec<Request> = views.iter().map(Request::from).collect();
        self.begin_kinds(snapshot, &requests)
    }

    /// Submits the drawing of all pictures and returns at once; [`Renderer::finish_kinds`] waits for
    /// them. What a view may see is found once for all its kinds.
    ///
    /// # Errors
    /// As [`Renderer::render_kinds`], before anything is submitted.
    pub fn begin_kinds(
        &mut self,
        snapshot: &FrameSnapshot,
        requests: &[Request],
    ) -> Result<Pending, RenderError> {
        if requests.iter().any(|request| request.kinds.contains(PictureKind::Instance)) {
            kinds::check_numbers(snapshot)?;
        }
        self.check(snapshot, requests.iter().map(|request| &request.view))?;
        let share = requests.len().div_ceil(self.stages.len()).max(1);
        let mut triangles = 0;
        self.at_work.clear();
        let mut parts = Vec::with_capacity(self.stages.len());
        for part in requests.chunks(share) {
            let stage = &mut self.stages[self.turn];
            parts.push(stage.begin(snapshot, part));
            triangles += stage.triangles() * part.len() as u64;
            self.at_work.push(self.turn);
            self.turn = (self.turn + 1) % self.stages.len();
        }
        if parts.len() == self.stages.len() {
            // Who has got the harder half gets the other one next.
            self.turn = (self.turn + 1) % self.stages.len();
        }
        self.triangles = triangles / (requests.len() as u64).max(1);
        Ok(Pending { parts })
    }

    /// Whether all that is asked for can be drawn.
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

    /// Waits for a batch of [`Renderer::begin`] and takes its pictures.
    ///
    /// # Errors
    /// [`RenderError::Readback`] where the adapter was lost.
    pub fn finish(&mut self, pending: Pending) -> Result<Vec<Image>, RenderError> {
        let pictures = self.finish_kinds(pending)?;
        Ok(pictures.into_iter().filter_map(|pictures| pictures.rgb).collect())
    }

    /// Waits for a batch and takes its pictures.
    ///
    /// # Errors
    /// [`RenderError::Readback`] where the adapter was lost.
    pub fn finish_kinds(&mut self, pending: Pending) -> Result<Vec<Pictures>, RenderError> {
        let arrived = self.wait(pending)?;
        Ok((0..arrived.len()).into_par_iter().map(|index| arrived.pictures(index)).collect())
    }

    /// Waits for a batch. Its pictures can be taken from any thread, one by one; until the last has been
    /// it holds its memory.
    ///
    /// # Errors
    /// [`RenderError::Readback`] where the adapter was lost.
    pub fn wait(&self, pending: Pending) -> Result<Arrived, RenderError> {
        pending.wait()
    }

    /// Draws views of one instant into targets, each view into the target of the same index: a window and what
    /// its panels show. A view's picture fills its target, so that its extent should have the target's
    /// proportions. Where light is worked out at the vertices, targets have to be of the format that the
    /// renderer was built for, without the suffix sRGB.
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
        // Targets are of the device that the context shows.
        if let Some(stage) = self.stages.first_mut() {
            stage.draw(snapshot, views, targets);
        }
        Ok(())
    }
}
