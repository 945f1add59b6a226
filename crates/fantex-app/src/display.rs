//! How the scene is shown: views of the shading, overlays, tone, resolution.

use fantex::scene::{FilterOptions, ToneMap};
use fantex::store::ChannelKind;
use fantex::texture::Filter;
use serde::{Deserialize, Serialize};

/// What of the shading is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShadingView {
    #[default]
    Lit,
    BaseColor,
    /// Shading normals as colours.
    Normal,
    /// Occlusion, roughness and metal as red, green and blue.
    OcclusionRoughnessMetallic,
    Emission,
}

impl ShadingView {
    /// The view of a channel alone, where there is one.
    pub fn of_channel(kind: ChannelKind) -> Option<Self> {
        match kind {
            ChannelKind::BaseColor => Some(Self::BaseColor),
            ChannelKind::Normal => Some(Self::Normal),
            ChannelKind::OcclusionRoughnessMetallic => Some(Self::OcclusionRoughnessMetallic),
            ChannelKind::Emission => Some(Self::Emission),
            ChannelKind::Displacement | ChannelKind::Light | ChannelKind::Anisotropy => None,
        }
    }

    /// All views in the order in which a key goes through them.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Lit, "Lit"),
        (Self::BaseColor, "Base colour"),
        (Self::Normal, "Normals"),
        (Self::OcclusionRoughnessMetallic, "Occl. / rough. / metal"),
        (Self::Emission, "Emission"),
    ];
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Overlay {
    #[default]
    None,
    Fans,
    Groups,
    Levels,
    Residency,
    BlendBands,
}

impl Overlay {
    /// All overlays in the order in which a key goes through them.
    pub const ALL: [(Self, &'static str); 6] = [
        (Self::None, "None"),
        (Self::Fans, "Partial fans"),
        (Self::Groups, "Groups"),
        (Self::Levels, "Levels"),
        (Self::Residency, "Residency"),
        (Self::BlendBands, "Blend bands"),
    ];

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
pub const TONE_MAPS: [(ToneMap, &str); 3] =
    [(ToneMap::Clip, "Clip"), (ToneMap::Reinhard, "Reinhard"), (ToneMap::Filmic, "Filmic")];

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DisplaySettings {
    pub shading: ShadingView,
    pub overlay: Overlay,
    pub has_wireframe: bool,
    /// Exposure in stops; 0 is as it is.
    pub exposure_stops: f32,
    pub tone: ToneMap,
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
            tone: ToneMap::Filmic,
            anisotropy: 8,
            samples: 4,
            is_adaptive: true,
        }
    }
}

impl DisplaySettings {
    pub const ANISOTROPIES: [(u32, &'static str); 5] =
        [(1, "Off (trilinear)"), (2, "2×"), (4, "4×"), (8, "8×"), (16, "16×")];

    /// Range of the exposure in stops.
    pub const EXPOSURES: [f32; 2] = [-8.0, 8.0];

    /// Factor of all light.
    pub fn exposure(&self) -> f32 {
        self.exposure_stops.exp2()
    }

    pub fn change_exposure(&mut self, stops: f32) {
        let [least, most] = Self::EXPOSURES;
        self.exposure_stops = (self.exposure_stops + stops).clamp(least, most);
    }

    pub fn filter(&self) -> FilterOptions {
        let filter = if self.anisotropy > 1 { Filter::Anisotropic } else { Filter::Trilinear };
        FilterOptions { filter, max_anisotropy: self.anisotropy as f32 }
    }

    pub fn step_overlay(&mut self, by: isize) {
        self.overlay = step(&Overlay::ALL, self.overlay, by);
    }

    pub fn step_shading(&mut self, by: isize) {
        self.shading = step(&ShadingView::ALL, self.shading, by);
    }

    /// Numbers brought into their ranges.
    pub(crate) fn sanitized(mut self) -> Self {
        let stops = self.exposure_stops;
        self.exposure_stops = if stops.is_finite() { stops.clamp(-8.0, 8.0) } else { 0.0 };
        if Self::ANISOTROPIES.iter().all(|(n, _)| *n != self.anisotropy) {
            self.anisotropy = Self::default().anisotropy;
        }
        if ![1, 4].contains(&self.samples) {
            self.samples = Self::default().samples;
        }
        self
    }
}

/// The element `by` places after another, round and round.
fn step<T: Copy + PartialEq>(all: &[(T, &str)], now: T, by: isize) -> T {
    let at = all.iter().position(|(one, _)| *one == now).unwrap_or(0) as isize;
    all[(at + by).rem_euclid(all.len() as isize) as usize].0
}
