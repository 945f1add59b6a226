//! Options of light maps, and what may be wrong with them.

/// What a light map holds. Either is relative to a white, perfectly diffuse surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightQuantity {
    /// What lights, sky and glowing surfaces reach the point directly.
    Direct,
    /// The share of the sky that is seen from the point, weighted by the cosine to the normal; lights do not matter.
    AmbientOcclusion,
    /// All light that arrives, after up to [`LightMapOptions::bounces`] diffuse reflections.
    #[default]
    Full,
}

/// How to bake a light map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightMapOptions {
    /// What is computed.
    pub quantity: LightQuantity,
    /// Paths per texel, 4 to 1048576; rounded up to a multiple of 4.
    pub samples: u32,
    /// Where given, texels whose standard error is larger (in units of the value) take more paths, up to `max_samples`.
    /// Positive.
    pub target_error: Option<f32>,
    /// Paths per texel at most where `target_error` is given; not below `samples`, at most 1048576.
    pub max_samples: u32,
    /// Diffuse reflections before light reaches the point, 0 to 64. Only for [`LightQuantity::Full`].
    pub bounces: u32,
    /// Only for [`LightQuantity::AmbientOcclusion`]: surfaces farther away than this do not occlude, world units; all do
    /// where it is not given. Positive.
    pub occlusion_distance: Option<f64>,
    /// Rays start from the smooth surface that vertex normals suggest where it lies above the triangle (J. Hanika,
    /// "Hacking the Shadow Terminator", 2021), so that coarse round objects do not shade themselves triangle by triangle.
    pub smooth_terminator: bool,
    /// Other seeds give other noise.
    pub seed: u32,
}

impl Default for LightMapOptions {
    /// All light, 256 paths of up to 4 reflections, not adaptive.
    fn default() -> Self {
        Self {
            quantity: LightQuantity::Full,
            samples: 256,
            target_error: None,
            max_samples: 4096,
            bounces: 4,
            occlusion_distance: None,
            smooth_terminator: true,
            seed: 0,
        }
    }
}

/// Largest number of paths per texel.
const MOST_SAMPLES: u32 = 1 << 20;
const MOST_BOUNCES: u32 = 64;

/// What is wrong with the description of a light map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LightMapError {
    /// Too few or too many paths.
    #[error("{what} is {count}, but a texel takes 4 to {MOST_SAMPLES} paths")]
    Samples {
        /// Which of the options.
        what: &'static str,
        /// Its value.
        count: u32,
    },
    /// `max_samples` is below `samples`.
    #[error("max_samples is {max_samples}, but must not be below samples, {samples}")]
    MaxSamplesBelowSamples {
        /// The most paths.
        max_samples: u32,
        /// The fewest.
        samples: u32,
    },
    /// Too many reflections.
    #[error("bounces is {0}, but at most {MOST_BOUNCES} reflections are followed")]
    Bounces(u32),
    /// A length or an error bound is not a positive number.
    #[error("{what} is {value}, but must be a positive number")]
    NotPositive {
        /// Which of the options.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A number of a light is out of its range.
    #[error("{what} of light {light} is {value}, but must be {allowed}")]
    Light {
        /// Index of the light.
        light: usize,
        /// Which of its numbers.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl LightMapOptions {
    /// Checks every range.
    ///
    /// # Errors
    ///
    /// The first option that is out of range.
    pub fn check(&self) -> Result<(), LightMapError> {
        let counts = [("samples", self.samples), ("max_samples", self.max_samples)];
        if let Some((what, count)) = counts.into_iter().find(|c| !(4..=MOST_SAMPLES).contains(&c.1)) {
            return Err(LightMapError::Samples { what, count });
        }
        if self.target_error.is_some() && self.max_samples < self.samples {
            let (max_samples, samples) = (self.max_samples, self.samples);
            return Err(LightMapError::MaxSamplesBelowSamples { max_samples, samples });
        }
        if self.bounces > MOST_BOUNCES {
            return Err(LightMapError::Bounces(self.bounces));
        }
        let lengths = [
            ("target_error", self.target_error.map(f64::from)),
            ("occlusion_distance", self.occlusion_distance),
        ];
        for (what, value) in lengths {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                return Err(LightMapError::NotPositive { what, value });
            }
        }
        Ok(())
    }

    /// Reflections that are followed.
    pub(super) fn reflections(&self) -> u32 {
        if self.quantity == LightQuantity::Full { self.bounces } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_range_is_checked() {
        let good = LightMapOptions::default();
        assert_eq!(good.check(), Ok(()));
        let bad = [
            LightMapOptions { samples: 3, ..good },
            LightMapOptions { samples: MOST_SAMPLES + 1, max_samples: MOST_SAMPLES, ..good },
            LightMapOptions { target_error: Some(0.1), max_samples: 8, ..good },
            LightMapOptions { target_error: Some(0.0), ..good },
            LightMapOptions { target_error: Some(f32::NAN), ..good },
            LightMapOptions { bounces: 65, ..good },
            LightMapOptions { occlusion_distance: Some(-1.0), ..good },
            LightMapOptions { occlusion_distance: Some(f64::INFINITY), ..good },
        ];
        for options in bad {
            assert!(options.check().is_err(), "{options:?}");
        }
    }
}
