//! Draws the scene offscreen through wgpu, so that it works whichever renderer the window has, and reads it back.

use super::shapes::{BOX, CORNER, LINE, POINT, Shapes};
use crate::offscreen::Offscreen;
use glam::DMat4;
use std::sync::Arc;

const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Size of the uniforms of a layer: matrix, size, point and line.
const UNIFORMS: u64 = 80;

/// Shapes with the matrix from their frame to clip coordinates.
pub(super) struct Draw {
    pub(super) shapes: Arc<Shapes>,
    pub(super) clip_from_shapes: DMat4,
}

/// A picture that was read back, rows from the top.
pub(super) struct Pixels {
    pub(super) size: [usize; 2],
    pub(super) rgba: Vec<u8>,
    /// 0 near to 1 far; 1 where nothing was drawn.
    pub(super) depth: Vec<f32>,
}

/// The device and what is kept on it.
pub(super) struct Gpu {
    offscreen: Offscreen,
    layout: wgpu::BindGroupLayout,
    /// Of points, lines, boxes and surfaces.
    pipelines: [wgpu::RenderPipeline; 4],
    uploaded: Vec<Uploaded>,
}

/// Instances and corners on the device, with their number.
struct Uploaded {
    shapes: Arc<Shapes>,
    buffers: [Option<(wgpu::Buffer, u32)>; 4],
}

impl Gpu {
    /// Chooses a device; a software one if there is no other. An error says why there is none.
    pub(super) fn new() -> Result<Self, String> {
        let offscreen = Offscreen::new()?;
        let device = &offscreen.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("scene"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let pipelines = pipelines(device, &layout);
        Ok(Self { offscreen, layout, pipelines, uploaded: Vec::new() })
    }

    /// Draws shapes over a background. `per_point` is the number of pixels per screen point.
    pub(super) fn draw(
        &mut self,
        draws: &[Draw],
        size: [u32; 2],
        per_point: f32,
        background: [f64; 3],
    ) -> Result<Pixels, String> {
        let side = self.offscreen.device.limits().max_texture_dimension_2d;
        let size = size.map(|v| v.clamp(1, side));
        self.upload(draws);
        let groups: Vec<_> = draws.iter().map(|draw| self.uniforms(draw, size, per_point)).collect();
        let [color, depth] = [COLOR, DEPTH].map(|format| self.offscreen.target(format, size));
        let views =
            [&color, &depth].map(|texture| texture.create_view(&wgpu::TextureViewDescriptor::default()));
        let mut encoder =
            self.offscreen.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let [r, g, b] = background;
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("scene"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &views[0],
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 }),
                        store: wgpu::StoreOp::Store,
                    },
                    depth_slice: None,
                })],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &views[1],
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(1.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..wgpu::RenderPassDescriptor::default()
            });
            // Boxes first, and lines, which lie on them, later; surfaces last, because they are often translucent.
            for kind in [2, 0, 1, 3] {
                pass.set_pipeline(&self.pipelines[kind]);
                for (uploaded, group) in self.uploaded.iter().zip(&groups) {
                    if let Some((buffer, count)) = &uploaded.buffers[kind] {
                        pass.set_bind_group(0, group, &[]);
                        pass.set_vertex_buffer(0, buffer.slice(..));
                        let (vertices, instances) = match kind {
                            3 => (*count, 1),
                            2 => (30, *count),
                            _ => (4, *count),
                        };
                        pass.draw(0..vertices, 0..instances);
                    }
                }
            }
        }
        let color = self.offscreen.copy(&mut encoder, &color);
        let depth = self.offscreen.copy(&mut encoder, &depth);
        let submission = self.offscreen.queue.submit(std::iter::once(encoder.finish()));
        let rgba = self.offscreen.bytes(&color, submission.clone())?;
        let depth = self.offscreen.bytes(&depth, submission)?;
        let number = |bytes: &[u8]| f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let depth = depth.chunks_exact(4).map(number).collect();
        Ok(Pixels { size: size.map(|v| v as usize), rgba, depth })
    }

    /// Puts the instances on the device that are not there yet, and drops those that are no longer drawn.
    fn upload(&mut self, draws: &[Draw]) {
        let mut old = std::mem::take(&mut self.uploaded);
        for draw in draws {
            let known = old.iter().position(|uploaded| Arc::ptr_eq(&uploaded.shapes, &draw.shapes));
            let uploaded = if let Some(index) = known {
                old.swap_remove(index)
            } else {
                let shapes = &draw.shapes;
                let kinds = [
                    (&shapes.points, POINT),
                    (&shapes.lines, LINE),
                    (&shapes.boxes, BOX),
                    (&shapes.surfaces, CORNER),
                ];
                let buffers = kinds.map(|(bytes, size)| self.buffer(bytes, size));
                Uploaded { shapes: Arc::clone(shapes), buffers }
            };
            self.uploaded.push(uploaded);
        }
    }

    fn buffer(&self, bytes: &[u8], size: usize) -> Option<(wgpu::Buffer, u32)> {
        // What the device cannot hold is left out.
        let most = self.offscreen.device.limits().max_buffer_size as usize / size * size;
        let bytes = &bytes[..bytes.len().min(most)];
        if bytes.is_empty() {
            return None;
        }
        let buffer = self.offscreen.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("scene"),
            size: bytes.len() as u64,
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.offscreen.queue.write_buffer(&buffer, 0, bytes);
        Some((buffer, (bytes.len() / size) as u32))
    }

    fn uniforms(&self, draw: &Draw, size: [u32; 2], per_point: f32) -> wgpu::BindGroup {
        let clip_from_origin = draw.clip_from_shapes * DMat4::from_translation(draw.shapes.origin());
        let matrix = clip_from_origin.to_cols_array().map(|v| v as f32);
        let rest = [size[0] as f32, size[1] as f32, (draw.shapes.side * per_point).max(1.0), per_point];
        let bytes: Vec<u8> = matrix.iter().chain(&rest).flat_map(|v| v.to_ne_bytes()).collect();
        let buffer = self.offscreen.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("scene"),
            size: UNIFORMS,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.offscreen.queue.write_buffer(&buffer, 0, &bytes);
        self.offscreen.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scene"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        })
    }
}

fn pipelines(device: &wgpu::Device, layout: &wgpu::BindGroupLayout) -> [wgpu::RenderPipeline; 4] {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("scene"),
        source: wgpu::ShaderSource::Wgsl(include_str!("scene.wgsl").into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("scene"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let points = wgpu::vertex_attr_array![0 => Float32x3, 1 => Unorm8x4];
    let lines = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Unorm8x4, 3 => Float32];
    let boxes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Unorm8x4];
    let (strip, list) = (wgpu::PrimitiveTopology::TriangleStrip, wgpu::PrimitiveTopology::TriangleList);
    let kinds: [(&str, usize, &[wgpu::VertexAttribute], _); 4] = [
        ("point", POINT, &points, strip),
        ("line", LINE, &lines, strip),
        ("cell", BOX, &boxes, list),
        ("surface", CORNER, &points, list),
    ];
    kinds.map(|(entry, stride, attributes, topology)| {
        let is_surface = entry == "surface";
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(entry),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(entry),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: stride as u64,
                    step_mode: if is_surface {
                        wgpu::VertexStepMode::Vertex
                    } else {
                        wgpu::VertexStepMode::Instance
                    },
                    attributes,
                })],
                compilation_options: wgpu::PipelineCompilationOptions::default(),
            },
            primitive: wgpu::PrimitiveState { topology, ..wgpu::PrimitiveState::default() },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::LessEqual),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("paint"),
                targets: &[Some(wgpu::ColorTargetState {
                    format: COLOR,
                    blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
                compilation_options: wgpu::PipelineCompilationOptions::default(),
            }),
            multiview_mask: None,
            cache: None,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::Color32;
    use glam::DVec3;

    #[test]
    fn what_is_behind_a_translucent_line_shows_through() {
        let mut gpu = match Gpu::new() {
            Ok(gpu) => gpu,
            Err(reason) => return println!("skipped: {reason}"),
        };
        let mut shapes = Shapes::default();
        let ends = [-1.0, 1.0].map(|x| DVec3::new(x, 0.0, 0.5));
        shapes.line(ends, Color32::from_rgba_premultiplied(100, 0, 0, 128), 8.0);
        let draws = [Draw { shapes: Arc::new(shapes), clip_from_shapes: DMat4::IDENTITY }];
        let Pixels { size, rgba, .. } = gpu.draw(&draws, [16, 16], 1.0, [1.0; 3]).expect("a picture");
        let middle = 4 * (size[1] / 2 * size[0] + size[0] / 2);
        let expect = [227_u8, 127, 127, 255];
        let is_near = |(a, b): (&u8, &u8)| a.abs_diff(*b) <= 2;
        let pixel = &rgba[middle..middle + 4];
        assert!(pixel.iter().zip(&expect).all(is_near), "{pixel:?}");
    }
}
