//! GPU time of a batch, by timestamp queries.

use super::Context;

/// Two timestamp queries per batch, at its start and its end.
#[derive(Debug)]
pub(super) struct GpuTimer {
    stamps: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
    period_ns: f32,
}

/// Device features that [`GpuTimer`] needs.
pub(super) const FEATURES: wgpu::Features =
    wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);

const BYTES: u64 = 16;

impl GpuTimer {
    /// `None` if the device has no timestamp queries.
    pub(super) fn new(context: &Context) -> Option<Self> {
        let device = &context.device;
        if !device.features().contains(FEATURES) {
            return None;
        }
        let buffer = |label, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: BYTES,
                usage,
                mapped_at_creation: false,
            })
        };
        Some(Self {
            stamps: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("time"),
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            }),
            resolved: buffer("time", wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            read: buffer("time to read", wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
            period_ns: context.queue.get_timestamp_period(),
        })
    }

    pub(super) fn start(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.write_timestamp(&self.stamps, 0);
    }

    pub(super) fn stop(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.write_timestamp(&self.stamps, 1);
        encoder.resolve_query_set(&self.stamps, 0..2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read, 0, BYTES);
    }

    /// Waits for the last batch and returns the time between its start and stop, seconds.
    pub(super) fn seconds(&self, device: &wgpu::Device) -> Option<f64> {
        let slice = self.read.slice(..);
        slice.map_async(wgpu::MapMode::Read, |_| {});
        device.poll(wgpu::PollType::wait_indefinitely()).ok()?;
        let stamps = {
            let bytes = slice.get_mapped_range().ok()?;
            [0, 8].map(|at| bytes[at..at + 8].iter().rev().fold(0_u64, |n, &b| n << 8 | u64::from(b)))
        };
        self.read.unmap();
        let ticks = stamps[1].checked_sub(stamps[0])?;
        Some(ticks as f64 * f64::from(self.period_ns) * 1e-9)
    }
}
