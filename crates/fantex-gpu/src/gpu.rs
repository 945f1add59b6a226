//! The device that pictures are drawn with.

use std::sync::{Arc, Mutex, PoisonError};

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
    frame_layout: FrameLayout,
}

/// What the driver has told since the device was opened.
#[derive(Debug, Default)]
struct DeviceState {
    lost: Option<String>,
    error: Option<GpuError>,
}

impl Gpu {
    /// Opens the best adapter without a window; any will do, including software.
    ///
    /// # Errors
    ///
    /// No adapter, or none that can be opened.
    pub fn headless(options: &GpuOptions) -> Result<Self, GpuError> {
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
            .map_err(|error| GpuError::NoAdapter { reason: error.to_string() })?;
        let opened = pollster::block_on(adapter.request_device(&Self::wanted_device_descriptor(&adapter)));
        let (device, queue) = opened.map_err(|error| GpuError::NoDevice {
            adapter: adapter.get_info().name,
            reason: error.to_string(),
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
        let frame_layout = FrameLayout::new(&device);
        Self { device, queue, info, state, frame_layout }
    }

    /// What to ask an adapter for: the features that are used where they exist, and limits as large as it has.
    pub fn wanted_device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
        let useful = wgpu::Features::TEXTURE_COMPRESSION_BC
            | wgpu::Features::TIMESTAMP_QUERY
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
        &self.frame_layout
    }

    /// Why the device is lost, if it is.
    pub fn lost(&self) -> Option<String> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).lost.clone()
    }

    /// An error if the device is lost, or (see [`Gpu::record_errors`]) has refused something since the last call.
    ///
    /// # Errors
    ///
    /// [`GpuError::DeviceLost`], for good; [`GpuError::OutOfMemory`] and [`GpuError::Refused`] once each.
    pub fn check(&self) -> Result<(), GpuError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reason) = &state.lost {
            return Err(GpuError::DeviceLost { reason: reason.clone() });
        }
        state.error.take().map_or(Ok(()), Err)
    }

    /// Waits until all work that was submitted is done.
    ///
    /// # Errors
    ///
    /// As [`Gpu::check`].
    pub fn wait(&self) -> Result<(), GpuError> {
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        waited.map(|_| ()).map_err(|error| GpuError::Refused { reason: error.to_string() })
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

    /// [`GpuError::TooLarge`] about this device.
    pub(crate) fn too_large(
        &self,
        what: &'static str,
        needed: u64,
        allowed: u64,
        unit: &'static str,
    ) -> GpuError {
        GpuError::TooLarge { what, needed, allowed, unit, adapter: self.info.name.clone() }
    }

    /// Has [`Gpu::check`] return errors that nobody asks for, such as a lack of memory; otherwise they end the program. Devices
    /// opened by [`Gpu::headless`] do so already. A handler that was set before is replaced.
    pub fn record_errors(&self) {
        let told = Arc::clone(&self.state);
        self.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let error = match error {
                wgpu::Error::OutOfMemory { source } => GpuError::OutOfMemory { what: source.to_string() },
                wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
                    GpuError::Refused { reason: description }
                }
            };
            told.lock().unwrap_or_else(PoisonError::into_inner).error.get_or_insert(error);
        }));
    }
}

// What can go wrong between a program and its GPU.

/// The GPU cannot be used, or a picture cannot be drawn with it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is neither a GPU nor a software stand-in.
    #[error(
        "no GPU adapter was found ({reason}): install a Vulkan, Metal or DirectX 12 driver (Mesa's software Vulkan will do), \
         or render on the CPU, with `fantex render` without --gpu"
    )]
    NoAdapter {
        /// What the system says.
        reason: String,
    },
    /// The adapter gives no device.
    #[error("the GPU \"{adapter}\" cannot be opened: {reason}; `fantex render` without --gpu uses the CPU")]
    NoDevice {
        /// The adapter's name.
        adapter: String,
        /// What the driver says.
        reason: String,
    },
    /// The device has gone: a driver was updated, a card unplugged, a frame took too long. Everything made with it must be
    /// made again with a new one.
    #[error("the GPU device was lost ({reason}): open it again")]
    DeviceLost {
        /// What the driver says.
        reason: String,
    },
    /// The device refused an operation.
    #[error("the GPU refused an operation: {reason}")]
    Refused {
        /// What the driver or its checks say.
        reason: String,
    },
    /// More graphics memory was asked for than there is.
    #[error("the GPU has no memory left for {what}: choose smaller pictures, textures or shadow maps")]
    OutOfMemory {
        /// What did not fit.
        what: String,
    },
    /// Something is larger than the device allows.
    #[error("{what} needs {needed} {unit}, the GPU \"{adapter}\" allows {allowed}")]
    TooLarge {
        /// What is too large.
        what: &'static str,
        /// What it needs.
        needed: u64,
        /// What is allowed.
        allowed: u64,
        /// Of what.
        unit: &'static str,
        /// The adapter's name.
        adapter: String,
    },
    /// Not a number of samples that pictures can have.
    #[error("cannot render with {0} samples per pixel on the GPU: ask for 1 or 4")]
    Samples(u32),
    /// Not a view.
    #[error("cannot render from this camera: {0}")]
    Camera(&'static str),
    /// Not a lamp.
    #[error("cannot render with lamp {lamp} of the scene: {defect}")]
    Light {
        /// Which lamp, from 0.
        lamp: usize,
        /// What is wrong with it.
        defect: &'static str,
    },
}
