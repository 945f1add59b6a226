//! What the pen does.

use fantex_paint::FillScope;
use serde::{Deserialize, Serialize};

/// A tool of the strip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PaintTool {
    /// Lays colour on.
    #[default]
    Paint,
    /// Takes away what was painted.
    Erase,
    /// Covers a part of the surface at once.
    Fill,
    /// Averages what is there.
    Blur,
    /// Copies from elsewhere.
    Clone,
    /// Takes the colour from the surface.
    Pick,
}

impl PaintTool {
    /// All tools from the top of the strip to its bottom.
    pub const ALL: [Self; 6] = [Self::Paint, Self::Erase, Self::Fill, Self::Blur, Self::Clone, Self::Pick];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Paint => "Paint",
            Self::Erase => "Erase",
            Self::Fill => "Fill",
            Self::Blur => "Blur",
            Self::Clone => "Clone",
            Self::Pick => "Pick colour",
        }
    }

    /// What to do with it, for the line below the window.
    pub fn hint(self) -> &'static str {
        match self {
            Self::Paint => "Drag paints, Shift + click draws a straight line, Alt + click picks a colour",
            Self::Erase => "Drag takes away what was painted on the layer, Shift + click in a straight line",
            Self::Fill => "Click fills the part of the surface under the cursor",
            Self::Blur => "Drag averages what is there",
            Self::Clone => "Alt + click says from where, then drag copies",
            Self::Pick => "Click takes the colour from the surface",
        }
    }

    /// Whether it has a brush.
    pub fn has_brush(self) -> bool {
        !matches!(self, Self::Fill | Self::Pick)
    }

    /// Whether it lays the chosen colour on.
    pub fn has_color(self) -> bool {
        matches!(self, Self::Paint | Self::Fill)
    }
}

/// How far a fill goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FillReach {
    /// All that hangs together.
    #[default]
    Connected,
    /// Up to edges that bend.
    Angle,
    /// Everything.
    Whole,
}

impl FillReach {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Connected, Self::Angle, Self::Whole];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Connected => "Connected part",
            Self::Angle => "Up to edges",
            Self::Whole => "Everything",
        }
    }

    /// As the engine knows it; an edge bends by more than `degrees`.
    pub fn scope(self, degrees: f32) -> FillScope {
        match self {
            Self::Connected => FillScope::Connected,
            Self::Angle => FillScope::Angle(degrees),
            Self::Whole => FillScope::Whole,
        }
    }
}
