//! What the pen does.

use fantex_paint::{ColorFill, FillSettings};
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
    /// Drags what is there along.
    Smudge,
    /// Copies from elsewhere.
    Clone,
    /// Lays a text or a picture onto the surface.
    Sticker,
    /// Takes the colour from the surface.
    Pick,
}

impl PaintTool {
    /// All tools from the top of the strip to its bottom.
    pub const ALL: [Self; 8] = [
        Self::Paint,
        Self::Erase,
        Self::Fill,
        Self::Blur,
        Self::Smudge,
        Self::Clone,
        Self::Sticker,
        Self::Pick,
    ];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Paint => "Paint",
            Self::Erase => "Erase",
            Self::Fill => "Fill",
            Self::Blur => "Blur",
            Self::Smudge => "Smudge",
            Self::Sticker => "Text and pictures",
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
            Self::Smudge => "Drag takes the colours along",
            Self::Sticker => "Click lays the text or the picture onto the surface",
            Self::Clone => "Alt + click says from where, then drag copies",
            Self::Pick => "Click takes the colour from the surface",
        }
    }

    /// Whether it has a brush.
    pub fn has_brush(self) -> bool {
        !matches!(self, Self::Fill | Self::Sticker | Self::Pick)
    }

    /// Whether it lays the chosen colour on.
    pub fn has_color(self) -> bool {
        matches!(self, Self::Paint | Self::Fill | Self::Sticker)
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
    /// What looks alike and hangs together.
    Color,
    /// What looks alike anywhere.
    AllOfColor,
    /// Everything.
    Whole,
}

/// What a sticker is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StickerKind {
    /// A text in the foreground's colour.
    #[default]
    Text,
    /// A picture from a file.
    Picture,
}

impl StickerKind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Text, Self::Picture];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Text => "Text",
            Self::Picture => "Picture",
        }
    }
}

impl FillReach {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Connected, Self::Angle, Self::Color, Self::AllOfColor, Self::Whole];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Connected => "Connected part",
            Self::Angle => "Up to edges",
            Self::Color => "Same colour",
            Self::AllOfColor => "Same colour anywhere",
            Self::Whole => "Everything",
        }
    }

    /// As the engine knows it; an edge bends by more than `degrees`. Colours differ by at most
    /// `tolerance`, 0..2.
    pub fn fill(self, degrees: f32, tolerance: f32) -> FillSettings {
        let by_color =
            |connected| FillSettings::Color(ColorFill { tolerance, softness: 0.5 * tolerance, connected });
        match self {
            Self::Connected => FillSettings::Connected,
            Self::Angle => FillSettings::Angle(degrees),
            Self::Whole => FillSettings::Whole,
            Self::Color => by_color(true),
            Self::AllOfColor => by_color(false),
        }
    }
}
