//! Lights to paint in, one click each.

use crate::light::{LightSettings, Surroundings};

/// A light with a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightPreset {
    /// A lamp over the shoulder.
    Studio,
    /// The same from everywhere: colours as they are.
    Even,
    /// A low lamp from the side, which shows relief.
    Grazing,
    /// From behind.
    Rim,
    /// Outdoors at noon.
    Noon,
    /// Outdoors in the evening.
    Evening,
}

impl LightPreset {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Studio, Self::Even, Self::Grazing, Self::Rim, Self::Noon, Self::Evening];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Studio => "Studio",
            Self::Even => "Even",
            Self::Grazing => "Grazing",
            Self::Rim => "Rim",
            Self::Noon => "Noon",
            Self::Evening => "Evening",
        }
    }

    /// The light; what is seen behind the model stays as it is in `now`.
    pub fn light(self, now: &LightSettings) -> LightSettings {
        let usual = LightSettings {
            background: now.background,
            background_blur: now.background_blur,
            ..LightSettings::default()
        };
        let sun = |sun_azimuth: f32, sun_elevation: f32| LightSettings {
            sun_azimuth,
            sun_elevation,
            ..usual.clone()
        };
        match self {
            Self::Studio => usual,
            Self::Even => LightSettings { has_sun: false, surroundings_strength: 1.8, ..usual },
            Self::Grazing => {
                LightSettings { sun_strength: 1.3, surroundings_strength: 0.5, ..sun(275.0, 14.0) }
            }
            Self::Rim => LightSettings { sun_strength: 1.6, surroundings_strength: 0.6, ..sun(160.0, 25.0) },
            Self::Noon => LightSettings { surroundings: Surroundings::Sky, ..sun(330.0, 62.0) },
            Self::Evening => LightSettings { surroundings: Surroundings::Sky, ..sun(285.0, 9.0) },
        }
    }

    /// Whether a light is this one.
    pub fn is_in(self, light: &LightSettings) -> bool {
        self.light(light) == *light
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_differ() {
        let usual = LightSettings::default();
        for preset in LightPreset::ALL {
            let light = preset.light(&usual);
            let found: Vec<_> = LightPreset::ALL.into_iter().filter(|other| other.is_in(&light)).collect();
            assert_eq!(found, [preset]);
        }
    }
}
