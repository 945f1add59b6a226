//! Options, outcome and errors.

use std::io;
use std::path::PathBuf;

use fantex_texture::LoadImageError;
use glam::Vec3;

/// How photographs are laid on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoOptions {
    /// Bytes that photographs may take: half for their pages in memory, half for those that are being read.
    pub memory_bytes: u64,
    /// Folder for a file (without a name) of what does not fit into memory.
    pub scratch: PathBuf,
    /// Solve for a factor per photograph and channel such that they agree.
    pub exposure: bool,
    /// Linear colour of what no photograph sees; `None` spreads the colours of its surroundings.
    pub unseen: Option<Vec3>,
    /// Length of a texel's side on the surface, mesh units: photographs are kept no finer than that needs. `None` keeps every pixel.
    pub texel_size: Option<f32>,
}

impl Default for PhotoOptions {
    /// 1 GiB, the system's folder of temporary files, exposure solved, unseen surface filled, every pixel kept.
    fn default() -> Self {
        Self {
            memory_bytes: 1 << 30,
            scratch: std::env::temp_dir(),
            exposure: true,
            unseen: None,
            texel_size: None,
        }
    }
}

/// What was found out about a set of photographs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotoReport {
    /// Photographs of the set.
    pub photographs: usize,
    /// Those that see some of the surface.
    pub used: usize,
    /// Those that have a mask in a file of its own.
    pub masked: usize,
    /// Share of the area that no photograph sees, 0..=1, measured at 32 768 points.
    pub unseen_share: f64,
    /// Factors of red, green and blue, linear light, per photograph in the set's order; 1 where exposure is not solved for.
    pub gains: Vec<Vec3>,
    /// Bytes of pages in memory.
    pub memory_bytes: u64,
    /// Bytes of pages in the scratch file.
    pub scratch_bytes: u64,
}

/// Why photographs cannot be a source.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PhotoError {
    /// A photograph could not be read.
    #[error(transparent)]
    Load(#[from] LoadImageError),
    /// A photograph is not what its camera took.
    #[error(
        "{} has {found:?} pixels, but its camera took {expected:?}, which is another shape; give the photographs that the cameras \
         were calibrated with, or the same made smaller", path.display()
    )]
    Shape {
        /// The photograph.
        path: PathBuf,
        /// Pixels of the file.
        found: [u32; 2],
        /// Pixels of the camera.
        expected: [u32; 2],
    },
    /// A mask does not fit its photograph.
    #[error(
        "the mask {} has {found:?} pixels, but its photograph has {expected:?}, which is another shape; give masks that were \
         made for these photographs", path.display()
    )]
    MaskShape {
        /// The mask.
        path: PathBuf,
        /// Pixels of the mask.
        found: [u32; 2],
        /// Pixels of the photograph.
        expected: [u32; 2],
    },
    /// Not one photograph shows the model.
    #[error(
        "none of the {photographs} photographs sees the model: it must lie in the coordinates of the cameras, whose middle is at \
         {middle}, and its triangles must be seen from outside"
    )]
    NothingSeen {
        /// How many there are.
        photographs: usize,
        /// Mean of the cameras' places, world units.
        middle: glam::DVec3,
    },
    /// Pages could not be written to or read from the scratch file.
    #[error("cannot keep photographs in {}: {source}", folder.display())]
    Scratch {
        /// Its folder.
        folder: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// The progress receiver asked to stop.
    #[error("reading photographs was cancelled")]
    Cancelled,
}
