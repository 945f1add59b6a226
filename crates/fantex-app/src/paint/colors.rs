//! Colours at hand: foreground, background, those used last, palettes. All are sRGB bytes.

use fantex::glam::Vec4;
use fantex::texture::color::linear_from_srgb;
use serde::{Deserialize, Serialize};

/// Colours that were used last and are remembered.
const MAX_RECENT: usize = 16;

/// The user's colours.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Colors {
    /// What is painted with.
    pub foreground: [u8; 3],
    /// What `X` brings to the front.
    pub background: [u8; 3],
    /// Those that were painted with, the last one first.
    pub recent: Vec<[u8; 3]>,
    /// The palette that is shown.
    pub palette: usize,
    /// Colours that the user keeps.
    pub own: Vec<[u8; 3]>,
}

impl Default for Colors {
    fn default() -> Self {
        Self {
            foreground: [0xd8, 0x45, 0x2e],
            background: [0xf4, 0xf1, 0xea],
            recent: Vec::new(),
            palette: 0,
            own: Vec::new(),
        }
    }
}

/// Names and colours.
pub const PALETTES: [(&str, &[[u8; 3]]); 4] = [
    (
        "Basic",
        &[
            [0x00, 0x00, 0x00],
            [0x4d, 0x4d, 0x4d],
            [0x99, 0x99, 0x99],
            [0xff, 0xff, 0xff],
            [0xd8, 0x45, 0x2e],
            [0xf0, 0x8a, 0x24],
            [0xf5, 0xcf, 0x3d],
            [0x7f, 0xb5, 0x3c],
            [0x2f, 0x8f, 0x5b],
            [0x2d, 0x9c, 0xb3],
            [0x2f, 0x6f, 0xc1],
            [0x3b, 0x3f, 0x9e],
            [0x7a, 0x46, 0xa8],
            [0xc2, 0x4c, 0x93],
            [0xe8, 0x8f, 0xa6],
            [0x7a, 0x4a, 0x2b],
        ],
    ),
    (
        "Earth",
        &[
            [0x2b, 0x21, 0x1b],
            [0x4a, 0x35, 0x28],
            [0x6b, 0x4a, 0x34],
            [0x8a, 0x62, 0x43],
            [0xa8, 0x7d, 0x57],
            [0xc4, 0x9c, 0x72],
            [0xdb, 0xbd, 0x98],
            [0xee, 0xdf, 0xc6],
            [0x5a, 0x2a, 0x1c],
            [0x8c, 0x3f, 0x26],
            [0xb5, 0x5b, 0x35],
            [0xcf, 0x86, 0x4d],
            [0x3c, 0x42, 0x2b],
            [0x5f, 0x66, 0x3e],
            [0x88, 0x8d, 0x5a],
            [0xb6, 0xb5, 0x84],
        ],
    ),
    (
        "Skin",
        &[
            [0x3a, 0x22, 0x1a],
            [0x5a, 0x37, 0x29],
            [0x7b, 0x4e, 0x3a],
            [0x9b, 0x68, 0x4e],
            [0xb8, 0x84, 0x66],
            [0xcf, 0x9f, 0x80],
            [0xe2, 0xba, 0x9d],
            [0xf1, 0xd5, 0xbf],
            [0x8f, 0x3b, 0x35],
            [0xb5, 0x5a, 0x50],
            [0xd0, 0x81, 0x74],
            [0xe6, 0xab, 0x9e],
            [0x5e, 0x3b, 0x45],
            [0x8a, 0x60, 0x68],
            [0x3f, 0x5a, 0x6b],
            [0x6f, 0x8b, 0x95],
        ],
    ),
    (
        "Metal",
        &[
            // Reflectances at normal incidence of common metals.
            [0xfc, 0xfa, 0xf6],
            [0xff, 0xd7, 0x8a],
            [0xfa, 0xd0, 0xc0],
            [0xf5, 0xf6, 0xf6],
            [0xc4, 0xc7, 0xc7],
            [0xd4, 0xcf, 0xc7],
            [0xc7, 0xbe, 0xb2],
            [0xc5, 0xca, 0xce],
            [0x8a, 0x4b, 0x2a],
            [0x9c, 0x6b, 0x30],
            [0x4f, 0x7d, 0x6a],
            [0x76, 0xa5, 0x8f],
            [0x2a, 0x2c, 0x30],
            [0x4b, 0x50, 0x57],
            [0x6d, 0x3a, 0x22],
            [0x9a, 0x55, 0x2c],
        ],
    ),
];

impl Colors {
    /// Foreground becomes background and the other way round.
    pub fn swap(&mut self) {
        std::mem::swap(&mut self.foreground, &mut self.background);
    }

    /// Black in front of white.
    pub fn reset(&mut self) {
        (self.foreground, self.background) = ([0; 3], [255; 3]);
    }

    /// The foreground was used.
    pub fn used(&mut self) {
        let color = self.foreground;
        self.recent.retain(|&known| known != color);
        self.recent.insert(0, color);
        self.recent.truncate(MAX_RECENT);
    }

    /// The foreground as linear RGBA.
    pub fn linear(&self) -> Vec4 {
        linear_of(self.foreground)
    }
}

/// sRGB bytes as linear RGBA.
pub(crate) fn linear_of(color: [u8; 3]) -> Vec4 {
    let [r, g, b] = color.map(|c| linear_from_srgb(f32::from(c) / 255.0));
    Vec4::new(r, g, b, 1.0)
}

/// `#d8452e`.
pub fn text_hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Reads `#d8452e`, `d8452e` or `#d42`.
pub fn parse_hex(text: &str) -> Option<[u8; 3]> {
    let digits = text.trim().trim_start_matches('#');
    let digits: Vec<u8> = digits.chars().map(|c| c.to_digit(16).map(|d| d as u8)).collect::<Option<_>>()?;
    match *digits.as_slice() {
        [r, g, b] => Some([r, g, b].map(|d| 17 * d)),
        [a, b, c, d, e, f] => Some([16 * a + b, 16 * c + d, 16 * e + f]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexadecimal_colours_are_read_as_they_are_written() {
        for color in [[0, 0, 0], [255, 128, 3], [0xd8, 0x45, 0x2e]] {
            assert_eq!(parse_hex(&text_hex(color)), Some(color));
        }
        assert_eq!(parse_hex("f80"), Some([255, 136, 0]));
        assert_eq!(parse_hex("#12345"), None);
        assert_eq!(parse_hex("red"), None);
    }

    #[test]
    fn recent_colours_are_each_there_once_the_last_one_first() {
        let mut colors = Colors::default();
        for n in 0..40u8 {
            colors.foreground = [n % 20, 0, 0];
            colors.used();
        }
        assert_eq!(colors.recent.len(), MAX_RECENT);
        assert_eq!(colors.recent[0], [19, 0, 0]);
        colors.foreground = [10, 0, 0];
        colors.used();
        assert_eq!((colors.recent[0], colors.recent[1]), ([10, 0, 0], [19, 0, 0]));
    }
}
