//! Colours at hand: foreground, background, those used last, palettes. All are sRGB bytes.

use fantex::glam::Vec4;
use fantex::texture::color::linear_from_srgb;
use serde::{Deserialize, Serialize};

/// Colours that were used last and are remembered.
const MAX_RECENT: usize = 16;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Colors {
    pub foreground: [u8; 3],
    /// What `X` brings to the front.
    pub background: [u8; 3],
    /// Those that were painted with, the last one first.
    pub recent: Vec<[u8; 3]>,
    pub palette: usize,
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

/// Names, and colours as `0xrrggbb`.
pub const PALETTES: [(&str, [u32; 16]); 4] = [
    (
        "Basic",
        [
            0x000000, 0x4d4d4d, 0x999999, 0xffffff, 0xd8452e, 0xf08a24, 0xf5cf3d, 0x7fb53c, 0x2f8f5b,
            0x2d9cb3, 0x2f6fc1, 0x3b3f9e, 0x7a46a8, 0xc24c93, 0xe88fa6, 0x7a4a2b,
        ],
    ),
    (
        "Earth",
        [
            0x2b211b, 0x4a3528, 0x6b4a34, 0x8a6243, 0xa87d57, 0xc49c72, 0xdbbd98, 0xeedfc6, 0x5a2a1c,
            0x8c3f26, 0xb55b35, 0xcf864d, 0x3c422b, 0x5f663e, 0x888d5a, 0xb6b584,
        ],
    ),
    (
        "Skin",
        [
            0x3a221a, 0x5a3729, 0x7b4e3a, 0x9b684e, 0xb88466, 0xcf9f80, 0xe2ba9d, 0xf1d5bf, 0x8f3b35,
            0xb55a50, 0xd08174, 0xe6ab9e, 0x5e3b45, 0x8a6068, 0x3f5a6b, 0x6f8b95,
        ],
    ),
    // Reflectances at normal incidence of common metals.
    (
        "Metal",
        [
            0xfcfaf6, 0xffd78a, 0xfad0c0, 0xf5f6f6, 0xc4c7c7, 0xd4cfc7, 0xc7beb2, 0xc5cace, 0x8a4b2a,
            0x9c6b30, 0x4f7d6a, 0x76a58f, 0x2a2c30, 0x4b5057, 0x6d3a22, 0x9a552c,
        ],
    ),
];

/// `0xrrggbb` as bytes.
pub fn color_of_hex(hex: u32) -> [u8; 3] {
    let [_, r, g, b] = hex.to_be_bytes();
    [r, g, b]
}

impl Colors {
    pub fn swap(&mut self) {
        std::mem::swap(&mut self.foreground, &mut self.background);
    }

    /// Black in front of white.
    pub fn reset(&mut self) {
        (self.foreground, self.background) = ([0; 3], [255; 3]);
    }

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
