//! How the scene is shown: views of the shading, overlays, tone, resolution.

use fantex::scene::{FilterOptions, ToneMap};
use fantex::texture::Filter;
use serde::{Deserialize, Serialize};

/// What of the shading is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShadingView {
    /// Lit.
    #[default]
    Lit,
    /// Base colour alone.
    BaseColor,
    /// Shading normals as colours.
    Normal,
    /// Occlusion, roughness and metal as red, green and blue.
    OcclusionRoughnessMetallic,
    /// Emitted light alone.
    Emission,
}

impl ShadingView {
    /// All views in the order in which a key goes through them.
    pub const ALL: [Self; 5] =
        [Self::Lit, Self::BaseColor, Self::Normal, Self::OcclusionRoughnessMetallic, Self::Emission];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Lit => "Lit",
            Self::BaseColor => "Base colour",
            Self::Normal => "Normals",
            Self::OcclusionRoughnessMetallic => "Occl. / rough. / metal",
            Self::Emission => "Emission",
        }
    }
}

/// What is drawn over the scene of an asset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Overlay {
    /// Nothing.
    #[default]
    None,
    /// Each partial fan in a colour.
    Fans,
    /// Each group of fans (each tile) in a colour.
    Groups,
    /// The detail level that is shown.
    Levels,
    /// How much coarser than wanted is what is there.
    Residency,
    /// Where tiles blend.
    BlendBands,
}

impl Overlay {
    /// All overlays in the order in which a key goes through them.
    pub const ALL: [Self; 6] =
        [Self::None, Self::Fans, Self::Groups, Self::Levels, Self::Residency, Self::BlendBands];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Fans => "Partial fans",
            Self::Groups => "Groups",
            Self::Levels => "Levels",
            Self::Residency => "Residency",
            Self::BlendBands => "Blend bands",
        }
    }

    /// What its colours mean.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Fans => {
                "Each partial fan has its own colour; the model's triangles are shared by three of them."
            }
            Self::Groups => "Each group of partial fans shares one tile and has one colour.",
            Self::Levels => {
                "Red is the finest level (0), then orange, yellow, green, blue: each is half as fine."
            }
            Self::Residency => {
                "Green: the wanted level is there. Yellow to red: a coarser one stands in until it arrives."
            }
            Self::BlendBands => "Orange where two or three tiles blend, grey where a single one is read.",
        }
    }
}

/// How light beyond one becomes a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToneChoice {
    /// Cut off.
    #[default]
    Clip,
    /// Luminance compressed, hues kept.
    Reinhard,
    /// As film.
    Filmic,
}

impl ToneChoice {
    /// All choices.
    pub const ALL: [Self; 3] = [Self::Clip, Self::Reinhard, Self::Filmic];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Clip => "Clip",
            Self::Reinhard => "Reinhard",
            Self::Filmic => "Filmic",
        }
    }

    /// The renderer's.
    pub fn tone_map(self) -> ToneMap {
        match self {
            Self::Clip => ToneMap::Clip,
            Self::Reinhard => ToneMap::Reinhard { white: 4.0 },
            Self::Filmic => ToneMap::Filmic,
        }
    }
}

/// How the scene is shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DisplaySettings {
    /// What of the shading is shown.
    pub shading: ShadingView,
    /// What is drawn over it.
    pub overlay: Overlay,
    /// Whether edges are drawn.
    pub has_wireframe: bool,
    /// Exposure in stops; 0 is as it is.
    pub exposure_stops: f32,
    /// What becomes of light beyond one.
    pub tone: ToneChoice,
    /// Longest ratio of a footprint's axes, 1 (trilinear) to 16.
    pub anisotropy: u32,
    /// Samples per pixel of edges: 1 or 4.
    pub samples: u32,
    /// Whether pictures are smaller while the camera moves and frames would take long.
    pub is_adaptive: bool,
}

impl Default for DisplaySettings {
    fn default() -> Self {
        Self {
            shading: ShadingView::Lit,
            overlay: Overlay::None,
            has_wireframe: false,
            exposure_stops: 0.0,
            tone: ToneChoice::Clip,
            anisotropy: 8,
            samples: 4,
            is_adaptive: true,
        }
    }
}

impl DisplaySettings {
    /// Choices of the anisotropy.
    pub const ANISOTROPIES: [u32; 5] = [1, 2, 4, 8, 16];

    /// Range of the exposure in stops.
    pub const EXPOSURES: [f32; 2] = [-8.0, 8.0];

    /// Factor of all light.
    pub fn exposure(&self) -> f32 {
        self.exposure_stops.exp2()
    }

    /// Brighter or darker.
    pub fn change_exposure(&mut self, stops: f32) {
        let [least, most] = Self::EXPOSURES;
        self.exposure_stops = (self.exposure_stops + stops).clamp(least, most);
    }

    /// The texture filter.
    pub fn filter(&self) -> FilterOptions {
        let filter = if self.anisotropy > 1 { Filter::Anisotropic } else { Filter::Trilinear };
        FilterOptions { filter, max_anisotropy: self.anisotropy as f32 }
    }

    /// The next or the previous overlay.
    pub fn step_overlay(&mut self, by: isize) {
        self.overlay = step(&Overlay::ALL, self.overlay, by);
    }

    /// The next view of the shading.
    pub fn step_shading(&mut self, by: isize) {
        self.shading = step(&ShadingView::ALL, self.shading, by);
    }

    /// Numbers brought into their ranges.
    pub(crate) fn sanitized(mut self) -> Self {
        let stops = self.exposure_stops;
        self.exposure_stops = if stops.is_finite() { stops.clamp(-8.0, 8.0) } else { 0.0 };
        if !Self::ANISOTROPIES.contains(&self.anisotropy) {
            self.anisotropy = Self::default().anisotropy;
        }
        if ![1, 4].contains(&self.samples) {
            self.samples = Self::default().samples;
        }
        self
    }
}

/// The element `by` places after another, round and round.
fn step<T: Copy + PartialEq>(all: &[T], now: T, by: isize) -> T {
    let at = all.iter().position(|&one| one == now).unwrap_or(0) as isize;
    all[(at + by).rem_euclid(all.len() as isize) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_go_round_all_overlays() {
        let mut display = DisplaySettings::default();
        for overlay in Overlay::ALL {
            assert_eq!(display.overlay, overlay);
            display.step_overlay(1);
        }
        assert_eq!(display.overlay, Overlay::None);
        display.step_overlay(-1);
        assert_eq!(display.overlay, Overlay::BlendBands);
    }

    #[test]
    fn exposure_is_in_stops() {
        let mut display = DisplaySettings::default();
        display.change_exposure(2.0);
        assert_eq!(display.exposure(), 4.0);
        display.change_exposure(99.0);
        assert_eq!(display.exposure_stops, 8.0);
    }

    #[test]
    fn without_anisotropy_the_filter_is_trilinear() {
        let display = DisplaySettings { anisotropy: 1, ..DisplaySettings::default() };
        assert_eq!(display.filter().filter, Filter::Trilinear);
    }
}
