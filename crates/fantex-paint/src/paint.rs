//! What a stroke does to the texels that it covers.

use std::sync::Arc;

use fantex_texture::Texture;
use glam::{Vec3, Vec4};

use crate::stroke::mesh_length;
use crate::{Picture, Projection, Sight, Size, Surface, Symmetry};

/// Dabs of a smudge should be no farther apart than this, in diameters: farther apart they show as stripes.
pub const SMUDGE_SPACING: f32 = 0.025;

/// What a covered texel becomes.
#[derive(Clone, Debug)]
pub enum Tool {
    /// A colour is laid over what is there.
    Paint(BlendMode),
    /// Alpha goes to zero.
    Erase,
    /// Alpha goes to a value, and colours stay: of base colours alone, on the base or a layer. Where nothing was painted on a layer, nothing
    /// changes.
    Opacity {
        /// That value, 0..1.
        to: f32,
    },
    /// What is seen around is averaged; the channels' colours do not matter.
    Blur {
        /// How far around, mesh units along the surface.
        radius: f32,
    },
    /// What is under the brush is dragged along; the channels' colours do not matter.
    Smudge {
        /// Share of the dragged colour that is left after a way of one brush radius, 0..1.
        strength: f32,
    },
    /// What is seen elsewhere is copied; the channels' colours do not matter.
    Clone {
        /// Mesh space: added to a point, and from there to the nearest point of the surface.
        offset: Vec3,
        /// Mesh units from there to the surface at most; beyond it nothing is copied.
        reach: f32,
        /// Of the stroke: dabs of its copies are moved away by the offset as the copy has it.
        symmetry: Symmetry,
    },
}

/// Mesh units from where a clone copies to the surface, at least as far as which it copies.
const MIN_CLONE_REACH: f32 = 0.1;

impl Tool {
    /// A clone that copies what lies at one place to another one (mesh space), and so on around it: where the surface is no farther
    /// from there than the brush is wide, or than a tenth of a mesh unit.
    pub fn clone_of(surface: &Surface, from: Vec3, to: Vec3, brush: Size, symmetry: Symmetry) -> Self {
        let reach = mesh_length(surface, brush).max(MIN_CLONE_REACH);
        Self::Clone { offset: from - to, reach, symmetry }
    }

    /// True where copies of a stroke do something else than the stroke itself.
    pub(crate) fn depends_on_copy(&self) -> bool {
        matches!(self, Self::Clone { symmetry, .. } if symmetry.count() > 1)
    }

    /// True where it asks for what was seen before the stroke.
    pub(crate) fn reads_surface(&self) -> bool {
        matches!(self, Self::Blur { .. } | Self::Clone { .. } | Self::Smudge { .. })
    }
}

/// A colour on the surface: linear RGBA with straight alpha.
#[derive(Clone, Debug)]
pub enum PaintColor {
    /// The same everywhere.
    Constant(Vec4),
    /// A function of object space (world units, origin at the centre of the model's bounding box).
    Texture(Arc<dyn Texture>),
    /// A picture in the coordinates of the [`Decal`](crate::Decal) that lays it; a brush leaves no trace with it.
    Image(Arc<Picture>),
    /// A picture through a camera, onto what the camera sees.
    Projected(Arc<Projection>),
    /// Normals follow the height that the same stroke paints. Strokes that paint height do so by themselves.
    Relief,
}

/// What is painted into one channel.
#[derive(Clone, Debug)]
pub struct ChannelPaint {
    /// Index of the channel.
    pub channel: usize,
    /// With what.
    pub color: PaintColor,
    /// Which of red, green and blue change (occlusion, roughness, metallic); where not all do, alpha stays, too.
    pub components: [bool; 3],
}

impl ChannelPaint {
    /// Paints all components.
    pub fn new(channel: usize, color: PaintColor) -> Self {
        Self { channel, color, components: [true; 3] }
    }

    /// A texel after the stroke, with the components that stay as they were.
    pub(crate) fn keep(&self, before: Vec4, after: Vec4) -> Vec4 {
        if self.components == [true; 3] {
            return after;
        }
        let kept = |k: usize| if self.components[k] { after[k] } else { before[k] };
        Vec4::new(kept(0), kept(1), kept(2), before.w)
    }
}

/// What a stroke paints, into all its channels together.
#[derive(Clone, Debug)]
pub struct Paint {
    /// How.
    pub tool: Tool,
    /// Most that it covers, 0..1.
    pub opacity: f32,
    /// Where to; none twice.
    pub channels: Vec<ChannelPaint>,
    /// A picture through a camera that the stroke is laid on through: what it covers is multiplied by the picture's alpha, and
    /// nothing is covered beside the picture and where the camera does not see. Projected colours then count without
    /// their alpha.
    pub stencil: Option<Arc<Projection>>,
    /// Paints only what is seen from somewhere.
    pub sight: Option<Arc<Sight>>,
}

impl Paint {
    /// The texel after the stroke; `coverage` 0..1 is what the dabs have gathered.
    pub(crate) fn apply(&self, before: Vec4, color: Vec4, coverage: f32) -> Vec4 {
        let share = coverage * self.opacity.clamp(0.0, 1.0);
        match self.tool {
            Tool::Paint(mode) => mode.compose(before, color, share),
            Tool::Erase => before.truncate().extend(before.w * (1.0 - share)),
            Tool::Opacity { to } => {
                let alpha = before.w + (to.clamp(0.0, 1.0) - before.w) * share;
                before.truncate().extend(alpha)
            }
            Tool::Blur { .. } | Tool::Clone { .. } | Tool::Smudge { .. } => mixed(before, color, share),
        }
    }
}

/// Between two straight colours, each weighted by its alpha.
pub(crate) fn mixed(a: Vec4, b: Vec4, share: f32) -> Vec4 {
    let (wa, wb) = (a.w * (1.0 - share), b.w * share);
    if wa + wb > 0.0 { ((a.truncate() * wa + b.truncate() * wb) / (wa + wb)).extend(wa + wb) } else { a }
}

// Blend modes.
//
// "Compositing and Blending Level 1" (W3C, 2015), applied to linear light: with the backdrop's colour and alpha `Cb`, `ab`
// and the source's `Cs`, `as`,
//
// ```text
//     Cs' = (1 - ab) Cs + ab B(Cb, Cs)
//     ao  = as + ab (1 - as)
//     Co  = (as Cs' + (1 - as) ab Cb) / ao
// ```
//
// Erasing is none of it: `ao = ab (1 - as)`, `Co = Cb` ("destination out" of Porter and Duff, 1984).

/// `B(Cb, Cs)` of the recommendation, the addition of light, and erasing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BlendMode {
    /// `Cs`.
    #[default]
    Normal,
    /// `Cb Cs`.
    Multiply,
    /// `Cb + Cs - Cb Cs`.
    Screen,
    /// `HardLight(Cs, Cb)`.
    Overlay,
    /// `min(Cb, Cs)`.
    Darken,
    /// `max(Cb, Cs)`.
    Lighten,
    /// 0 where `Cb = 0`, 1 where `Cs = 1`, else `min(1, Cb / (1 - Cs))`.
    ColorDodge,
    /// 1 where `Cb = 1`, 0 where `Cs = 0`, else `1 - min(1, (1 - Cb) / Cs)`.
    ColorBurn,
    /// `Multiply(Cb, 2 Cs)` where `Cs <= 1/2`, else `Screen(Cb, 2 Cs - 1)`.
    HardLight,
    /// `Cb - (1 - 2 Cs) Cb (1 - Cb)` where `Cs <= 1/2`, else `Cb + (2 Cs - 1) (D(Cb) - Cb)`.
    SoftLight,
    /// `|Cb - Cs|`.
    Difference,
    /// `Cb + Cs - 2 Cb Cs`.
    Exclusion,
    /// The source's hue, the backdrop's saturation and luminosity.
    Hue,
    /// The source's saturation, the backdrop's hue and luminosity.
    Saturation,
    /// The source's hue and saturation, the backdrop's luminosity.
    Color,
    /// The source's luminosity, the backdrop's hue and saturation.
    Luminosity,
    /// `Cb + Cs` (not of the recommendation; may exceed 1 in float channels).
    Add,
    /// What a layer covers is taken from the opacity of the base colour below it, and the colour stays; other channels stay as they are.
    /// Of layers alone: brushes have [`Tool::Erase`] and [`Tool::Opacity`].
    Erase,
}

impl BlendMode {
    /// All modes.
    pub const ALL: [Self; 18] = [
        Self::Normal,
        Self::Multiply,
        Self::Screen,
        Self::Overlay,
        Self::Darken,
        Self::Lighten,
        Self::ColorDodge,
        Self::ColorBurn,
        Self::HardLight,
        Self::SoftLight,
        Self::Difference,
        Self::Exclusion,
        Self::Hue,
        Self::Saturation,
        Self::Color,
        Self::Luminosity,
        Self::Add,
        Self::Erase,
    ];

    /// A source over a backdrop, both straight RGBA; `share` scales the source's alpha. With a share of 0 the backdrop stays,
    /// bit for bit.
    pub fn compose(self, backdrop: Vec4, source: Vec4, share: f32) -> Vec4 {
        let alpha = source.w * share;
        if alpha <= 0.0 {
            return backdrop;
        }
        if self == Self::Erase {
            return backdrop.with_w(backdrop.w * (1.0 - alpha));
        }
        let (cb, cs) = (backdrop.truncate(), source.truncate());
        let mixed = cs * (1.0 - backdrop.w) + self.blend(cb, cs) * backdrop.w;
        let out = alpha + backdrop.w * (1.0 - alpha);
        ((mixed * alpha + cb * ((1.0 - alpha) * backdrop.w)) / out).extend(out)
    }

    /// `B(Cb, Cs)`; of what erases the backdrop.
    pub fn blend(self, cb: Vec3, cs: Vec3) -> Vec3 {
        let each = |f: fn(f32, f32) -> f32| Vec3::new(f(cb.x, cs.x), f(cb.y, cs.y), f(cb.z, cs.z));
        match self {
            Self::Normal => cs,
            Self::Multiply => cb * cs,
            Self::Screen => cb + cs - cb * cs,
            Self::Overlay => each(|b, s| hard_light(s, b)),
            Self::Darken => cb.min(cs),
            Self::Lighten => cb.max(cs),
            Self::ColorDodge => each(color_dodge),
            Self::ColorBurn => each(color_burn),
            Self::HardLight => each(hard_light),
            Self::SoftLight => each(soft_light),
            Self::Difference => (cb - cs).abs(),
            Self::Exclusion => cb + cs - 2.0 * cb * cs,
            Self::Hue => with_luminosity(with_saturation(cs, saturation(cb)), luminosity(cb)),
            Self::Saturation => with_luminosity(with_saturation(cb, saturation(cs)), luminosity(cb)),
            Self::Color => with_luminosity(cs, luminosity(cb)),
            Self::Luminosity => with_luminosity(cb, luminosity(cs)),
            Self::Add => cb + cs,
            Self::Erase => cb,
        }
    }
}

fn hard_light(cb: f32, cs: f32) -> f32 {
    if cs <= 0.5 {
        cb * 2.0 * cs
    } else {
        let s = 2.0 * cs - 1.0;
        cb + s - cb * s
    }
}

fn color_dodge(cb: f32, cs: f32) -> f32 {
    if cb <= 0.0 {
        0.0
    } else if cs >= 1.0 {
        1.0
    } else {
        (cb / (1.0 - cs)).min(1.0)
    }
}

fn color_burn(cb: f32, cs: f32) -> f32 {
    if cb >= 1.0 {
        1.0
    } else if cs <= 0.0 {
        0.0
    } else {
        1.0 - ((1.0 - cb) / cs).min(1.0)
    }
}

fn soft_light(cb: f32, cs: f32) -> f32 {
    if cs <= 0.5 {
        cb - (1.0 - 2.0 * cs) * cb * (1.0 - cb)
    } else {
        let d = if cb <= 0.25 { ((16.0 * cb - 12.0) * cb + 4.0) * cb } else { cb.max(0.0).sqrt() };
        cb + (2.0 * cs - 1.0) * (d - cb)
    }
}

fn luminosity(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.3, 0.59, 0.11))
}

fn saturation(c: Vec3) -> f32 {
    c.max_element() - c.min_element()
}

fn with_luminosity(c: Vec3, l: f32) -> Vec3 {
    let c = c + (l - luminosity(c));
    let (l, low, high) = (luminosity(c), c.min_element(), c.max_element());
    let c = if low < 0.0 { l + (c - l) * (l / (l - low)) } else { c };
    if high > 1.0 { l + (c - l) * ((1.0 - l) / (high - l)) } else { c }
}

fn with_saturation(c: Vec3, s: f32) -> Vec3 {
    let (low, range) = (c.min_element(), saturation(c));
    if range > 0.0 { (c - low) * (s / range) } else { Vec3::ZERO }
}
