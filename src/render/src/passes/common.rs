//! Bind group 0: uniforms of the frame, and of each view by dynamic offset.

use super::uniform_entry;
use bytemuck::Zeroable;
use gpu_data::{Frame, View};

pub(crate) mod gpu_data {
    use crate::jitter::SubpixelJitter;
    use bytemuck::{Pod, Zeroable};
    use city3d_sensors::Projection;
    use glam::DMat4;

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Frame {
        pub(crate) to_sun: [f32; 4],
        pub(crate) sun: [f32; 4],
        pub(crate) sky_light: [f32; 4],
        pub(crate) ground_light: [f32; 4],
        pub(crate) haze: [f32; 4],
        pub(crate) shadow_from_world: [[f32; 4]; 4],
        pub(crate) shadow_texel: [f32; 4],
        pub(crate) zenith: [f32; 4],
        pub(crate) lamp_uv_from_world: [f32; 4],
    }

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct View {
        pub(crate) clip_from_world: [[f32; 4]; 4],
        pub(crate) eye: [f32; 4],
        pub(crate) camera_from_clip: [[f32; 4]; 4],
        pub(crate) extent: [f32; 4],
    }

    impl View {
        /// Uniforms of a view, for one of the pictures that are averaged.
        pub(crate) fn new(view: &city3d_sensors::View, jitter: SubpixelJitter) -> Self {
            let [width, height] = view.extent.map(|edge| edge as f32);
            // Depth tolerance of the blur of the ambient occlusion: relative in perspective, absolute in orthographic
            // depth.
            let [part, most] = match view.projection {
                Projection::Orthographic { near_m, far_m, .. } => [0.0, (0.2 / (far_m - near_m)) as f32],
                _ => [0.03, 0.0],
            };
            let shift = DMat4::from_translation(jitter.in_clip(view.extent));
            let clip_from_camera = shift * view.projection.clip_from_camera(view.extent);
            let camera_from_clip = clip_from_camera.inverse();
            Self {
                clip_from_world: (shift * view.clip_from_world()).as_mat4().to_cols_array_2d(),
                eye: view.extrinsics.position.as_vec3().extend(jitter.sample as f32).to_array(),
                camera_from_clip: camera_from_clip.as_mat4().to_cols_array_2d(),
                extent: [width, height, part, most],
            }
        }
    }
}

/// Offset between the uniforms of two views: WebGPU's default alignment of dynamic offsets.
const UNIFORM_STRIDE: u64 = 256;

/// Uniform buffers of group 0. Each view of a submission has its own slot, because a buffer that is
/// written twice before one submission holds the last value for both.
#[derive(Debug)]
pub(crate) struct FrameBindGroup {
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) group: wgpu::BindGroup,
    frame: wgpu::Buffer,
    views: wgpu::Buffer,
    capacity: u64,
}

impl FrameBindGroup {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame and view"),
            entries: &[
                uniform_entry(0, false, size_of::<Frame>() as u64),
                uniform_entry(1, true, size_of::<View>() as u64),
            ],
        });
        let frame = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frame"),
            size: size_of::<Frame>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let capacity = 16;
        let views = view_buffer(device, capacity);
        let group = bind(device, &layout, &frame, &views);
        Self { layout, group, frame, views, capacity }
    }

    /// Writes the frame and every view; the offset of view `k` is [`FrameBindGroup::offset`].
    pub(crate) fn write(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        frame: &Frame,
        views: &[View],
    ) {
        if views.len() as u64 > self.capacity {
            self.capacity = (views.len() as u64).next_power_of_two();
            self.views = view_buffer(device, self.capacity);
            self.group = bind(device, &self.layout, &self.frame, &self.views);
        }
        queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        let mut bytes = vec![0_u8; views.len() * UNIFORM_STRIDE as usize];
        for (slot, view) in bytes.chunks_exact_mut(UNIFORM_STRIDE as usize).zip(views) {
            slot[..size_of::<View>()].copy_from_slice(bytemuck::bytes_of(view));
        }
        queue.write_buffer(&self.views, 0, &bytes);
    }

    /// Dynamic offset of a view.
    pub(crate) fn offset(view: usize) -> u32 {
        (view as u64 * UNIFORM_STRIDE) as u32
    }

    /// Writes a frame without views, for the shadow map of the static city.
    pub(crate) fn write_frame(&self, queue: &wgpu::Queue, frame: &Frame) {
        queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        queue.write_buffer(&self.views, 0, bytemuck::bytes_of(&View::zeroed()));
    }
}

fn view_buffer(device: &wgpu::Device, capacity: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("views"),
        size: capacity * UNIFORM_STRIDE,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn bind(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    frame: &wgpu::Buffer,
    views: &wgpu::Buffer,
) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("frame and view"),
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() },
            wgpu::BindGroupEntry {
                binding: 1,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: views,
                    offset: 0,
                    size: wgpu::BufferSize::new(size_of::<View>() as u64),
                }),
            },
        ],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shader::{Shader, tests::layout, tests::validated};
    use std::mem::offset_of;

    #[test]
    fn structs_lie_as_the_shader_reads_them() {
        // Ground truth has no light and so no frame.
        let has_frame = |shader: &Shader| !matches!(shader, Shader::GroundTruth | Shader::Palette);
        for shader in Shader::ALL.into_iter().filter(has_frame) {
            let module = validated(shader);
            let frame = [
                offset_of!(Frame, to_sun),
                offset_of!(Frame, sun),
                offset_of!(Frame, sky_light),
                offset_of!(Frame, ground_light),
                offset_of!(Frame, haze),
                offset_of!(Frame, shadow_from_world),
                offset_of!(Frame, shadow_texel),
                offset_of!(Frame, zenith),
                offset_of!(Frame, lamp_uv_from_world),
            ];
            let (offsets, size) = layout(&module, "Frame");
            assert_eq!(offsets, frame.map(|o| o as u32));
            assert_eq!(size as usize, size_of::<Frame>());
            let view = [
                offset_of!(View, clip_from_world),
                offset_of!(View, eye),
                offset_of!(View, camera_from_clip),
                offset_of!(View, extent),
            ];
            let (offsets, size) = layout(&module, "View");
            assert_eq!(offsets, view.map(|o| o as u32));
            assert_eq!(size as usize, size_of::<View>());
        }
    }
}
