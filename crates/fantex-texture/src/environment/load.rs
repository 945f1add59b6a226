//! Maps from files.

use std::path::{Path, PathBuf};

use super::{CubeFace, EnvironmentLayout, EnvironmentMap};
use crate::{Image, LoadImageError};

/// Why an environment could not be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadEnvironmentError {
    /// The picture itself.
    #[error(transparent)]
    Image(#[from] LoadImageError),
    /// No layout has these proportions.
    #[error(
        "'{path}' has {width} x {height} texels, which is no environment; give a panorama (2:1), a cube's cross (4:3 or \
         3:4) or a strip of its faces (6:1 or 1:6)"
    )]
    Proportions {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The layout that was asked for has other proportions.
    #[error("'{path}' has {width} x {height} texels, but its layout needs {columns} : {rows}")]
    Layout {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Proportion of the columns.
        columns: u32,
        /// Proportion of the rows.
        rows: u32,
    },
    /// The faces of a cube do not match.
    #[error(
        "face '{path}' of a cube has {width} x {height} texels; all six must be squares of {side} x {side}, as the first is \
         wide"
    )]
    Face {
        /// The face's file.
        path: PathBuf,
        /// Its columns.
        width: u32,
        /// Its rows.
        height: u32,
        /// Columns of the first face.
        side: u32,
    },
    /// Too much memory.
    #[error(
        "'{path}' has {width} x {height} texels, more than the {limit} that an environment may have; scale it down"
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Most texels.
        limit: u64,
    },
}

/// Most texels of a picture: a map takes 21 bytes per texel.
const MAX_TEXELS: u64 = 1 << 27;

impl EnvironmentMap {
    /// Reads a panorama, a cube's cross or a strip of its faces, told apart by their proportions, in any format that
    /// [`Image::load`] reads. See [`EnvironmentLayout`] for the orientation.
    ///
    /// # Errors
    /// The file is no image, is too large or has other proportions.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, LoadEnvironmentError> {
        let (path, image) = load_within_limit(path.as_ref())?;
        let (width, height) = (image.width, image.height);
        EnvironmentLayout::of_size(width, height)
            .and_then(|layout| Self::from_image(&image, layout))
            .ok_or(LoadEnvironmentError::Proportions { path, width, height })
    }

    /// As [`EnvironmentMap::load`], with the layout said.
    ///
    /// # Errors
    /// The file is no image, is too large or does not have the layout's proportions.
    pub fn load_as(path: impl AsRef<Path>, layout: EnvironmentLayout) -> Result<Self, LoadEnvironmentError> {
        let (path, image) = load_within_limit(path.as_ref())?;
        let (width, height, [columns, rows]) = (image.width, image.height, layout.cells());
        Self::from_image(&image, layout).ok_or(LoadEnvironmentError::Layout {
            path,
            width,
            height,
            columns,
            rows,
        })
    }

    /// Reads the six faces of a cube in the order of [`CubeFace::ALL`], which is that of KTX, each as seen from inside.
    ///
    /// # Errors
    /// A file is no image, or they are not squares of one size.
    pub fn load_faces(paths: [&Path; CubeFace::ALL.len()]) -> Result<Self, LoadEnvironmentError> {
        let mut faces = Vec::with_capacity(paths.len());
        for path in paths {
            let (path, image) = load_within_limit(path)?;
            let side = faces.first().map_or(image.width, |first: &Image| first.width);
            let (width, height) = (image.width, image.height);
            if width != side || height != side {
                return Err(LoadEnvironmentError::Face { path, width, height, side });
            }
            faces.push(image);
        }
        let side = faces[0].width;
        Ok(Self::from_texels(super::EnvironmentForm::Cube, [side; 2], |chart, x, y| {
            let [r, g, b, _] = faces[chart].linear_texel(x, y);
            glam::Vec3::new(r, g, b)
        }))
    }
}

fn load_within_limit(path: &Path) -> Result<(PathBuf, Image), LoadEnvironmentError> {
    let image = Image::load(path)?;
    let (path, width, height) = (path.to_owned(), image.width, image.height);
    if u64::from(width) * u64::from(height) > MAX_TEXELS {
        return Err(LoadEnvironmentError::TooLarge { path, width, height, limit: MAX_TEXELS });
    }
    Ok((path, image))
}
