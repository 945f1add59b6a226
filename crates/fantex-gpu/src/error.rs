//! What can go wrong between a program and its GPU.

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
