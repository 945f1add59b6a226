//! The tables of a stroke file.

use std::path::PathBuf;
use std::sync::Arc;

use fantex_base::Result;
use fantex_store::ChannelKind;
use fantex_texture::color::linear_from_srgb;
use fantex_texture::{SolidTexture, solid_by_name};
use glam::{Vec3, Vec4};
use serde::{Deserialize, Serialize};

use crate::error::malformed;
use crate::replay::{PictureUse, Preparation};
use crate::{
    BlendMode, Brush, ColorFill, GroupKind, Layer, LayerMove, PaintColor, ProjectionView, Size, Surface,
    Symmetry, Tool,
};

/// A stroke file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrokeFile {
    /// 1.
    pub version: u32,
    /// Channels that the asset is given first, where it does not have them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub add_channels: Vec<KindName>,
    /// In order.
    pub strokes: Vec<StrokeSettings>,
}

impl StrokeFile {
    /// Whether a replay makes changes durable before the last stroke: channels that are added, and what tools that read the surface find
    /// there. (Before the first stroke there is nothing, unless it makes its layer; a fill by colour has begun by then.) Who wants all of the
    /// strokes or none replays them into a copy.
    pub fn commits_between(&self) -> bool {
        let commits = |(index, stroke): (usize, &StrokeSettings)| {
            let reads = matches!(
                stroke.tool,
                ToolSettings::Blur { .. } | ToolSettings::Smudge { .. } | ToolSettings::Clone { .. }
            );
            let is_first = index == 0 && stroke.layer.is_none();
            reads && !is_first || matches!(stroke.fill, Some(FillSettings::Color(_)))
        };
        !self.add_channels.is_empty() || self.strokes.iter().enumerate().any(commits)
    }
}

/// One stroke or fill.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StrokeSettings {
    /// Its name in the history.
    pub label: String,
    /// With what.
    pub brush: Brush,
    /// How.
    pub tool: ToolSettings,
    /// Into which channels, together.
    pub channels: Vec<ChannelSettings>,
    /// The way of the pen; for a fill its start; for decals and texts their middles.
    pub samples: Vec<SampleSettings>,
    /// Fills instead of painting along the samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fill: Option<FillSettings>,
    /// Lays a picture at each sample instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decal: Option<DecalSettings>,
    /// Writes at each sample instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub text: Option<TextSettings>,
    /// The camera through which colours that are pictures are seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projection: Option<ProjectionView>,
    /// A picture that the stroke is laid on through, in the camera of `projection`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stencil: Option<StencilSettings>,
    /// Paints only what the camera of `projection` sees, and of that what faces it by at most so many degrees, above 0 up to 90.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub only_seen: Option<f32>,
    /// Only the first and the last sample count.
    pub line: bool,
    /// Copies.
    pub symmetry: Symmetry,
    /// The layer to paint on, by its name; made on top of the others where there is none. Without it: under all layers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layer: Option<LayerSettings>,
    /// Touches of the brush, one by one, instead of samples: as they were recorded.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub dabs: Vec<DabSettings>,
    /// Replaces all layers, from the bottom to the top, and paints nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_layers: Option<Vec<Layer>>,
    /// What was painted on layers is copied and merged so before they are replaced.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub layer_moves: Vec<LayerMove>,
    /// What was painted could not be recorded: nothing is done but counting.
    pub unrecorded: bool,
}

impl Default for StrokeSettings {
    fn default() -> Self {
        Self {
            label: "stroke".to_owned(),
            brush: Brush::default(),
            tool: ToolSettings::default(),
            channels: Vec::new(),
            samples: Vec::new(),
            fill: None,
            decal: None,
            text: None,
            projection: None,
            stencil: None,
            only_seen: None,
            line: false,
            symmetry: Symmetry::None,
            layer: None,
            dabs: Vec::new(),
            set_layers: None,
            layer_moves: Vec::new(),
            unrecorded: false,
        }
    }
}

/// One touch of the brush.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DabSettings {
    /// Where.
    pub at: Where,
    /// World units along the surface.
    pub radius: f32,
    /// 0..1.
    pub hardness: f32,
    /// 0..1.
    pub flow: f32,
    /// Of the stamp, radians.
    #[serde(default)]
    pub angle: f32,
    /// Left and right of the stamp are changed, as in a mirror.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub mirrored: bool,
    /// Width over length.
    #[serde(default = "full")]
    pub aspect: f32,
    /// Whether it goes on beyond gaps of the mesh.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub across_gaps: bool,
    /// Of which copy that the stroke's `symmetry` makes it is; 0 is the stroke itself. A clone copies from the copy's own place.
    #[serde(default, skip_serializing_if = "is_default")]
    pub copy: u32,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// A layer to paint on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerSettings {
    /// Its name.
    pub name: String,
    /// How it lies over what is below; where the layer is made.
    #[serde(default)]
    pub blend: BlendMode,
    /// 0..1; where the layer is made.
    #[serde(default = "full")]
    pub opacity: f32,
    /// Its number, which goes before its name where there is a layer of both.
    pub id: Option<u64>,
    /// Paints on its mask: the luminance of the first channel's colour, 0 hides and 1 shows.
    #[serde(default)]
    pub mask: bool,
    /// The layer shows textures of a look instead of what is painted on it.
    pub fill: Option<FillLayerSettings>,
    /// It is a group; where it is made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<GroupKind>,
    /// The name of the group in which it is made; made on top of the others where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within: Option<String>,
}

impl Default for LayerSettings {
    fn default() -> Self {
        Self {
            name: String::new(),
            blend: BlendMode::Normal,
            opacity: 1.0,
            id: None,
            mask: false,
            fill: None,
            group: None,
            within: None,
        }
    }
}

/// What a fill layer shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FillLayerSettings {
    /// Where the textures are.
    pub look: LookSettings,
    /// Their names by channel.
    pub textures: Vec<FillTextureSettings>,
    /// Outside of what is painted on its mask: 1 shows the layer, 0 hides it; without it there is no mask.
    pub outside: Option<f32>,
}

/// A texture in a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FillTextureSettings {
    /// Which channel.
    #[serde(with = "ChannelKindName")]
    pub kind: ChannelKind,
    /// The texture's name in the look.
    pub texture: String,
}

/// How far a fill goes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FillSettings {
    /// The whole surface.
    Whole,
    /// What hangs together with the start through edges across which triangles continue each other (`fantex_mesh::continued`).
    Connected,
    /// The same, across edges that bend by at most so many degrees.
    Angle(f32),
    /// What looks like the start.
    Color(ColorFill),
}

/// A picture at a place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecalSettings {
    /// A picture, relative to the stroke file, whose alpha (or brightness, where that is opaque everywhere) says where the decal covers; without
    /// it the alpha of the first channel's picture does.
    pub shape: Option<PathBuf>,
    /// Length of the picture's longer side.
    pub size: Size,
    /// Degrees, counter-clockwise; 0 is upright.
    #[serde(default)]
    pub angle: f32,
    /// Left and right are changed, for what is seen from behind the surface.
    #[serde(default)]
    pub mirrored: bool,
}

/// A text at a place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TextSettings {
    /// What; lines end with `\n`.
    pub text: String,
    /// A font (TrueType or OpenType), relative to the stroke file; without it the one that comes with the program.
    pub font: Option<PathBuf>,
    /// Distance of lines.
    pub size: Size,
    /// Degrees, counter-clockwise; 0 is upright.
    #[serde(default)]
    pub angle: f32,
    /// Left and right are changed, for what is seen from behind the surface.
    #[serde(default)]
    pub mirrored: bool,
}

/// A picture over the view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StencilSettings {
    /// The picture, relative to the stroke file.
    pub image: PathBuf,
    /// What of it counts.
    #[serde(default)]
    pub by: StencilBy,
}

/// How a picture becomes a stencil.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StencilBy {
    /// Its alpha; where that is opaque everywhere, its brightness.
    #[default]
    Shape,
    /// Its alpha; one without lets all through.
    Alpha,
}

/// What the stroke does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ToolSettings {
    /// Lays colour over what is there.
    Paint(BlendMode),
    /// Takes alpha away.
    Erase,
    /// Brings the alpha of the base colour to a value, 0..1.
    Opacity(f32),
    /// Averages what is seen within a radius.
    Blur {
        /// Radius.
        radius: Size,
    },
    /// Drags colour along.
    Smudge {
        /// Share of the dragged colour that is left after a way of one brush radius, 0..1.
        strength: f32,
    },
    /// Copies from elsewhere.
    Clone {
        /// What comes to lie under the first sample: a position in world space.
        from: [f64; 3],
    },
}

impl ToolSettings {
    /// Of what a stroke does; where a clone copies from is not known to it.
    pub fn of(tool: &Tool, surface: &Surface) -> Self {
        match *tool {
            Tool::Paint(mode) => Self::Paint(mode),
            Tool::Erase => Self::Erase,
            Tool::Opacity { to } => Self::Opacity(to),
            Tool::Smudge { strength } => Self::Smudge { strength },
            Tool::Blur { radius } => {
                let world = f64::from(radius) * surface.mesh().world_from_mesh.scale;
                Self::Blur { radius: Size::World(world as f32) }
            }
            Tool::Clone { .. } => Self::Clone { from: [0.0; 3] },
        }
    }
}

impl Default for ToolSettings {
    fn default() -> Self {
        Self::Paint(BlendMode::Normal)
    }
}

/// What goes into a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelSettings {
    /// Which.
    #[serde(with = "ChannelKindName")]
    pub kind: ChannelKind,
    /// What (an eraser needs none).
    #[serde(default)]
    pub color: ColorSettings,
    /// Which of red, green and blue change: occlusion, roughness, metallic.
    #[serde(default = "all_components", skip_serializing_if = "is_all")]
    pub components: [bool; 3],
}

fn all_components() -> [bool; 3] {
    [true; 3]
}

fn is_all(components: &[bool; 3]) -> bool {
    *components == [true; 3]
}

/// A colour on the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ColorSettings {
    /// sRGB-encoded, opaque.
    Srgb([f32; 3]),
    /// Linear RGBA with straight alpha; for channels that hold no colour, their values.
    Linear([f32; 4]),
    /// A solid by its name, scaled to the model.
    Solid {
        /// wood, rings, marble, rock, granite, clouds, checker, brick or landscape.
        name: String,
        /// Of its noise.
        #[serde(default)]
        seed: u32,
    },
    /// A texture of a look.
    Texture {
        /// Where it is.
        look: LookSettings,
        /// Its name there.
        name: String,
    },
    /// A picture, relative to the stroke file: over a decal, or through a projection.
    Image(PathBuf),
}

/// Where a texture's look is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LookSettings {
    /// In a file, relative to the stroke file.
    File(PathBuf),
    /// Here, with the folder of the files that it mentions, relative to the stroke file.
    Inline {
        /// TOML.
        text: String,
        /// Folder.
        #[serde(default)]
        folder: PathBuf,
    },
}

impl Default for ColorSettings {
    /// Black.
    fn default() -> Self {
        Self::Srgb([0.0; 3])
    }
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "ChannelKind", rename_all = "snake_case")]
enum ChannelKindName {
    BaseColor,
    Normal,
    OcclusionRoughnessMetallic,
    Emission,
    Displacement,
    Light,
    Anisotropy,
}

/// A channel's name in stroke files, and the one that the option `--add-channel` takes; none where only a bake makes the channel.
pub(crate) fn names_of(kind: ChannelKind) -> (&'static str, Option<&'static str>) {
    match kind {
        ChannelKind::BaseColor => ("base_color", Some("base-color")),
        ChannelKind::Normal => ("normal", Some("normal")),
        ChannelKind::OcclusionRoughnessMetallic => ("occlusion_roughness_metallic", Some("orm")),
        ChannelKind::Emission => ("emission", Some("emission")),
        ChannelKind::Displacement => ("displacement", Some("displacement")),
        ChannelKind::Light => ("light", None),
        ChannelKind::Anisotropy => ("anisotropy", None),
    }
}

/// A kind of channel, by its name in stroke files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct KindName(#[serde(with = "ChannelKindName")] pub ChannelKind);

/// Where the pen was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleSettings {
    /// Where.
    pub at: Where,
    /// 0..1.
    #[serde(default = "full")]
    pub pressure: f32,
    /// Radians along the stamp's x and y axis.
    #[serde(default)]
    pub tilt: [f32; 2],
    /// Seconds.
    #[serde(default)]
    pub time: f32,
}

fn full() -> f32 {
    1.0
}

/// A place on the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Where {
    /// The surface's point nearest to one in world space.
    Position([f64; 3]),
    /// The first one that a ray in world space meets.
    Ray {
        /// Start.
        origin: [f64; 3],
        /// Of any length.
        direction: [f64; 3],
    },
    /// The nearest point whose normal agrees: on edited meshes and thin sheets.
    Surface {
        /// World space.
        position: [f64; 3],
        /// Of the triangle: outwards where the mesh is closed, else by its winding.
        normal: [f32; 3],
    },
    /// A point of a triangle of this very mesh.
    Point {
        /// Index.
        triangle: u32,
        /// Barycentric coordinates.
        lambda: [f32; 3],
    },
}

// Colours of stroke files.

/// What the settings of a colour mean.
pub(crate) fn color_of(
    preparation: &Preparation<'_>,
    kind: ChannelKind,
    settings: &ColorSettings,
) -> Result<PaintColor> {
    let surface = preparation.painter.surface();
    let color = match settings {
        ColorSettings::Srgb(color) => Vec3::from(color.map(linear_from_srgb)).extend(1.0),
        ColorSettings::Linear(color) => Vec4::from(*color),
        ColorSettings::Solid { name, seed } => {
            let solid = solid_by_name(name, surface.space().bounds(), *seed);
            let solid = solid.map_err(|source| preparation.of_stroke(malformed(source)))?;
            return Ok(PaintColor::Texture(Arc::new(SolidTexture(solid))));
        }
        ColorSettings::Texture { look, name } => {
            let texture = preparation.graph(look)?.texture(surface, name);
            let texture = texture.map_err(|error| preparation.of_stroke(error))?;
            return Ok(PaintColor::Texture(texture));
        }
        ColorSettings::Image(path) => {
            let picture = preparation.picture(path, PictureUse::of_kind(kind))?;
            let projection = preparation.projection(Arc::clone(&picture))?;
            return Ok(match projection {
                Some(projection) => PaintColor::Projected(Arc::new(projection)),
                None => PaintColor::Image(picture),
            });
        }
    };
    preparation.finite("a colour", &color.to_array())?;
    Ok(PaintColor::Constant(color))
}
