//! The device that pictures are drawn with.
//!
//! Errors: [`ErrorKind::Unavailable`] says that there is no GPU or that it has gone (then [`Gpu::lost`] says why, and everything made
//! with it must be made again with a new one); [`ErrorKind::TooLarge`] that something exceeds what it allows;
//! [`ErrorKind::InvalidArgument`] that a frame cannot be drawn at all; [`ErrorKind::Unsupported`] that the driver refused something.
//!
//! [`ErrorKind::Unavailable`]: fantex_base::ErrorKind::Unavailable
//! [`ErrorKind::TooLarge`]: fantex_base::ErrorKind::TooLarge
//! [`ErrorKind::InvalidArgument`]: fantex_base::ErrorKind::InvalidArgument
//! [`ErrorKind::Unsupported`]: fantex_base::ErrorKind::Unsupported

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use fantex_base::{Error, Result};

use crate::fan::FanPrograms;
use crate::frame::FrameLayout;

/// How to choose an adapter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuOptions {
    /// Only software adapters, for pictures that do not depend on the machine.
    pub software: bool,
}

/// What a GPU is called and how it is reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuInfo {
    /// The adapter's name, as its driver gives it.
    pub name: String,
    /// `Vulkan`, `Metal`, `Dx12`, ...
    pub backend: String,
    /// Whether the processor does the work.
    pub is_software: bool,
}

/// An open GPU.
#[derive(Debug)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    info: GpuInfo,
    state: Arc<Mutex<DeviceState>>,
    frame_layout: OnceLock<FrameLayout>,
    fan_programs: OnceLock<FanPrograms>,
}

/// What the driver has reported since the device was opened.
#[derive(Debug, Default)]
struct DeviceState {
    lost: Option<String>,
    error: Option<Error>,
}

impl Gpu {
    /// Opens the best adapter without a window; any will do, including software.
    ///
    /// # Errors
    /// No adapter, or none that can be opened.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn headless(options: &GpuOptions) -> Result<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::PRIMARY,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let request = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            force_fallback_adapter: options.software,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&request))
            .map_err(|error| {
                Error::unavailable(format!(
                    "no GPU adapter was found ({error}): install a Vulkan, Metal or DirectX 12 driver (Mesa's software Vulkan will \
                     do), or render on the CPU, with `fantex render` without --gpu"
                ))
            })?;
        let opened = pollster::block_on(adapter.request_device(&Self::wanted_device_descriptor(&adapter)));
        let (device, queue) = opened.map_err(|error| {
            let adapter = adapter.get_info().name;
            Error::unavailable(format!(
                "the GPU \"{adapter}\" cannot be opened: {error}; `fantex render` without --gpu uses the CPU"
            ))
        })?;
        let gpu = Self::from_parts(&adapter, device, queue);
        gpu.record_errors();
        Ok(gpu)
    }

    /// A device that was opened elsewhere, with [`Gpu::wanted_device_descriptor`]. Its owner decides what errors do that
    /// nobody asks for (by default they end the program), and may call [`Gpu::record_errors`].
    pub fn from_parts(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let about = adapter.get_info();
        let info = GpuInfo {
            name: about.name,
            backend: about.backend.to_string(),
            is_software: about.device_type == wgpu::DeviceType::Cpu,
        };
        let state = Arc::new(Mutex::new(DeviceState::default()));
        let told = Arc::clone(&state);
        device.set_device_lost_callback(move |reason, message| {
            let mut state = told.lock().unwrap_or_else(PoisonError::into_inner);
            state.lost = Some(format!("{reason:?}: {message}"));
        });
        let (frame_layout, fan_programs) = (OnceLock::new(), OnceLock::new());
        Self { device, queue, info, state, frame_layout, fan_programs }
    }

    /// What to ask an adapter for: the features that are used where they exist, and limits as large as it has.
    pub fn wanted_device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
        let useful = wgpu::Features::TEXTURE_COMPRESSION_BC
            | wgpu::Features::TIMESTAMP_QUERY
            | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS
            | wgpu::Features::FLOAT32_FILTERABLE;
        wgpu::DeviceDescriptor {
            label: Some("fantex"),
            required_features: adapter.features() & useful,
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        }
    }

    /// What it is called and how it is reached.
    pub fn info(&self) -> &GpuInfo {
        &self.info
    }

    /// What the device allows.
    pub fn limits(&self) -> wgpu::Limits {
        self.device.limits()
    }

    /// Whether textures should be block-compressed: the device has the formats, and its sampling of them is not done by the
    /// processor, which takes up to twenty times as long.
    pub fn has_block_compression(&self) -> bool {
        !self.info.is_software && self.device.features().contains(wgpu::Features::TEXTURE_COMPRESSION_BC)
    }

    /// What every shader that takes part in a frame is bound to in group 0.
    pub fn frame_layout(&self) -> &FrameLayout {
        self.frame_layout.get_or_init(|| FrameLayout::new(self))
    }

    /// Shaders and pipelines of fan-textured models.
    pub(crate) fn fan_programs(&self) -> &FanPrograms {
        self.fan_programs.get_or_init(|| FanPrograms::new(self))
    }

    /// Why the device is lost, if it is.
    pub fn lost(&self) -> Option<String> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).lost.clone()
    }

    /// An error if the device is lost, or (see [`Gpu::record_errors`]) has refused something since the last call.
    ///
    /// # Errors
    /// The device is lost, for good; it has no memory left or has refused something, once each.
    pub fn check(&self) -> Result<()> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reason) = &state.lost {
            return Err(device_lost(reason));
        }
        state.error.take().map_or(Ok(()), Err)
    }

    /// Waits until all work that was submitted is done.
    ///
    /// # Errors
    /// As [`Gpu::check`].
    pub fn wait(&self) -> Result<()> {
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        waited.map(|_| ()).map_err(|error| refused(&error))
    }

    /// A buffer with contents, at least 16 bytes long. Unlike buffers that are mapped when they are made, it can be made on a
    /// device that is already lost.
    pub fn buffer(&self, label: &str, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let aligned = contents.len() / 4 * 4;
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: contents.len().next_multiple_of(4).max(16) as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, &contents[..aligned]);
        if aligned < contents.len() {
            let mut rest = [0; 4];
            rest[..contents.len() - aligned].copy_from_slice(&contents[aligned..]);
            self.queue.write_buffer(&buffer, aligned as u64, &rest);
        }
        buffer
    }

    /// A texture of one sample, of columns, rows and layers.
    pub(crate) fn texture(
        &self,
        label: &str,
        [width, height, depth_or_array_layers]: [u32; 3],
        mip_level_count: u32,
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers },
            mip_level_count,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// The layout of a bind group whose bindings count from zero.
    pub(crate) fn bind_layout(
        &self,
        label: &str,
        visibility: wgpu::ShaderStages,
        types: impl IntoIterator<Item = wgpu::BindingType>,
    ) -> wgpu::BindGroupLayout {
        let entry = |(binding, ty)| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
        let entries: Vec<_> = (0..).zip(types).map(entry).collect();
        self.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &entries,
        })
    }

    /// A bind group whose bindings count from zero.
    pub(crate) fn bind_group<'a>(
        &self,
        label: &str,
        layout: &wgpu::BindGroupLayout,
        resources: impl IntoIterator<Item = wgpu::BindingResource<'a>>,
    ) -> wgpu::BindGroup {
        let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
        let entries: Vec<_> = (0..).zip(resources).map(entry).collect();
        let descriptor = wgpu::BindGroupDescriptor { label: Some(label), layout, entries: &entries };
        self.device.create_bind_group(&descriptor)
    }

    pub(crate) fn allow(
        &self,
        what: &str,
        needed: impl Into<u64>,
        allowed: impl Into<u64>,
        unit: &str,
    ) -> Result<()> {
        let (needed, allowed) = (needed.into(), allowed.into());
        if needed <= allowed { Ok(()) } else { Err(self.too_large(what, needed, allowed, unit)) }
    }

    pub(crate) fn too_large(&self, what: &str, needed: u64, allowed: u64, unit: &str) -> Error {
        let adapter = &self.info.name;
        Error::too_large(format!("{what} needs {needed} {unit}, the GPU \"{adapter}\" allows {allowed}"))
    }

    /// Makes something on the device.
    ///
    /// # Errors
    /// The device has no memory for it, or refuses it. (In browsers that is told later, by [`Gpu::check`].)
    pub(crate) fn make<T>(&self, make: impl FnOnce() -> T) -> Result<T> {
        #[cfg(not(target_arch = "wasm32"))]
        {
            let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
            let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
            let made = make();
            let refused = pollster::block_on(validation.pop());
            // What there was no memory for is refused where it is used, too.
            match pollster::block_on(memory.pop()).or(refused) {
                Some(error) => Err(device_error(error)),
                None => Ok(made),
            }
        }
        #[cfg(target_arch = "wasm32")]
        Ok(make())
    }

    /// Has [`Gpu::check`] return errors that nobody asks for, such as a lack of memory; otherwise they end the program. Devices
    /// opened by [`Gpu::headless`] do so already. A handler that was set before is replaced.
    pub fn record_errors(&self) {
        let told = Arc::clone(&self.state);
        self.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let error = device_error(error);
            told.lock().unwrap_or_else(PoisonError::into_inner).error.get_or_insert(error);
        }));
    }
}

/// The device has gone: a driver was updated, a card unplugged, a frame took too long.
pub fn device_lost(reason: &str) -> Error {
    Error::unavailable(format!("the GPU device was lost ({reason}): open it again"))
}

fn device_error(error: wgpu::Error) -> Error {
    match error {
        wgpu::Error::OutOfMemory { source } => Error::too_large(format!(
            "the GPU has no memory left for {source}: choose smaller pictures, textures or shadow maps"
        )),
        wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
            refused(&description)
        }
    }
}

pub(crate) fn refused(reason: &dyn std::fmt::Display) -> Error {
    Error::unsupported(format!("the GPU refused an operation: {reason}"))
}

/// Textures that shaders read and that are written from main memory.
pub(crate) const SAMPLED: wgpu::TextureUsages =
    wgpu::TextureUsages::TEXTURE_BINDING.union(wgpu::TextureUsages::COPY_DST);

pub(crate) const UNIFORM: wgpu::BindingType = wgpu::BindingType::Buffer {
    ty: wgpu::BufferBindingType::Uniform,
    has_dynamic_offset: false,
    min_binding_size: None,
};

/// A buffer that shaders only read.
pub(crate) const STORAGE: wgpu::BindingType = wgpu::BindingType::Buffer {
    ty: wgpu::BufferBindingType::Storage { read_only: true },
    has_dynamic_offset: false,
    min_binding_size: None,
};

pub(crate) const SAMPLER: wgpu::BindingType = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);

/// A uniform buffer of several records, one of which is bound by its offset.
pub(crate) const fn dynamic_uniform(record_bytes: u64) -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: true,
        min_binding_size: std::num::NonZeroU64::new(record_bytes),
    }
}

/// A texture of one sample per texel.
pub(crate) const fn texture_type(
    sample_type: wgpu::TextureSampleType,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindingType {
    wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

/// Floats that samplers filter.
pub(crate) const FILTERED: wgpu::TextureSampleType = wgpu::TextureSampleType::Float { filterable: true };

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_device_refuses_is_told_to_whoever_makes_it() {
        let Ok(gpu) = Gpu::headless(&GpuOptions { software: true }) else { return };
        let side = gpu.limits().max_texture_dimension_2d + 1;
        let texture = || gpu.texture("too large", [side, 1, 1], 1, wgpu::TextureFormat::Rgba8Unorm, SAMPLED);
        assert!(gpu.make(texture).is_err());
        gpu.check().unwrap();
        gpu.make(|| gpu.buffer("sixteen bytes", &[0; 16], wgpu::BufferUsages::UNIFORM)).unwrap();
    }
}
