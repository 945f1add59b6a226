//! How much two pictures of models differ.

use fantex_base::Result;
use fantex_scene::Picture;
use fantex_texture::Image;
use fantex_texture::compare::{Comparison, compare_where, psnr_db};
use glam::Vec3;

/// What is seen behind models in the pictures that are compared, linear.
const BACKDROP: Vec3 = Vec3::splat(0.46);

/// A picture of models before a grey backdrop, and which of its pixels show them.
#[derive(Clone, Debug)]
pub struct ModelPicture {
    /// The picture, linear RGB.
    pub image: Image,
    /// Per pixel, row by row.
    pub is_model: Vec<bool>,
}

impl ModelPicture {
    /// Of a picture without background.
    pub fn new(picture: &Picture) -> Self {
        let on_backdrop =
            |&[r, g, b, alpha]: &[f32; 4]| BACKDROP.lerp(Vec3::new(r, g, b), alpha).extend(1.0).to_array();
        let texels: Vec<[f32; 4]> = picture.rgba.iter().map(on_backdrop).collect();
        Self {
            image: Image::from_linear_rgb(picture.width, picture.height, &texels),
            is_model: picture.rgba.iter().map(|pixel| pixel[3] > 0.0).collect(),
        }
    }
}

/// Measures of a pair of pictures from one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewComparison {
    /// Over the pixels that show a model in either.
    pub model: Comparison,
    /// Their share.
    pub model_share: f64,
    /// Over all pixels, decibels.
    pub whole_psnr_db: f64,
}

impl ViewComparison {
    /// Compares a picture with a reference.
    ///
    /// # Errors
    /// They differ in size.
    pub fn new([reference, test]: &[ModelPicture; 2]) -> Result<Self> {
        let is_model: Vec<bool> = reference.is_model.iter().zip(&test.is_model).map(|(a, b)| a | b).collect();
        Ok(Self {
            model: compare_where(&reference.image, &test.image, &is_model)?,
            model_share: is_model.iter().filter(|is| **is).count() as f64 / is_model.len() as f64,
            whole_psnr_db: psnr_db(&reference.image, &test.image)?,
        })
    }

    /// Whether a model is seen in either.
    pub fn shows_model(&self) -> bool {
        self.model_share > 0.0
    }

    /// The mean ratio over the pictures that differ, decibels; infinite where all are equal.
    pub fn mean_db(ratios: impl Iterator<Item = f64>) -> f64 {
        let differing = ratios.filter(|db| *db < f64::INFINITY || db.is_nan());
        let (sum, count) = differing.fold((0.0, 0_u32), |(sum, count), db| (sum + db, count + 1));
        if count == 0 { f64::INFINITY } else { sum / f64::from(count) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_pictures_have_no_part_in_a_mean() {
        let mean = |ratios: &[f64]| ViewComparison::mean_db(ratios.iter().copied());
        assert_eq!(mean(&[30.0, f64::INFINITY, 40.0]), 35.0);
        assert_eq!(mean(&[f64::INFINITY; 2]), f64::INFINITY);
        assert!(mean(&[30.0, f64::NAN]).is_nan());
    }
}
